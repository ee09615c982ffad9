"""Sufficient statistics of one interval of contiguous rows."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..checks.live.channel_check import ChannelCheck
from ..messages.features import FEATURE_FIELDS, PHASES, Fault, FeatureBlock, Phase
from ..messages.row_faults import (
    LIMIT_SHARE,
    MOVED_ANGLE_RAD,
    MOVED_SETPOINT_M,
    OMEGA,
    SET,
    STUCK_S,
    THETA,
    T,
    U,
)
from ..messages.samples import Floats
from . import interval_kernels as kernels


@dataclass(frozen=True, slots=True, eq=False)
class IntervalRows:
    """Rows of one interval, with those before and after it that its differences need.

    Attributes:
        segment: (n, 8) contiguous rows.
        first, end: row indices; row `end` is the first of the next interval.
        reach: half width in rows of the differences that give direction and acceleration.
    """

    segment: Floats
    first: int
    end: int
    reach: int

    @property
    def inside(self) -> Floats:
        """Rows of the interval and the first of the next, which ends it."""
        return self.segment[self.first : self.end + 1]

    @property
    def ahead(self) -> Floats:
        """Rows after the interval, as many as a difference reaches."""
        return self.segment[self.end + 1 : self.end + 1 + self.reach]

    @property
    def around(self) -> Floats:
        """Rows of the interval with one more on either side."""
        return self.segment[max(self.first - 1, 0) : self.end + 2]


@dataclass(frozen=True, slots=True)
class PhaseSettings:
    """Criteria for rows of steady motion.

    Attributes:
        gate_s: time after a reversal or a start that is left out (presliding, wind-up).
        min_speed_rad_s: slower rows are left out (Stribeck friction, creeping jogs).
        cruise_rad_s2: up to this acceleration the axis cruises.
        even_share: rows whose window is less even than this are left out (a hole in it).
    """

    gate_s: float = 0.05
    min_speed_rad_s: float = 2.0
    cruise_rad_s2: float = 30.0
    even_share: float = 0.2

    @property
    def limits(self) -> Floats:
        """The criteria as the arithmetic takes them, (4,)."""
        return np.array([self.gate_s, self.min_speed_rad_s, self.cruise_rad_s2, self.even_share])


@dataclass(frozen=True, slots=True)
class PlausibilitySettings:
    """Limits between a faulty channel and a moving axis.

    Attributes:
        standstill_speed_rad_s: slower than this is standstill.
        direction_window_s: half width of the difference that gives the direction of motion.
        stuck_s: a channel that repeats one value for this long while the axis moves is stuck.
        max_speed_rad_s: a faster step of the encoder is no motion.
        max_torque_nm: the drive's torque limit; None if unknown.
    """

    standstill_speed_rad_s: float = 0.05
    direction_window_s: float = 0.004
    stuck_s: float = STUCK_S
    max_speed_rad_s: float = 1500.0
    max_torque_nm: float | None = None
    phases: PhaseSettings = field(default_factory=PhaseSettings)


WILDEST_ANGLE_RAD = 1e8
WILDEST_TORQUE_NM = 1e5
_UNKNOWN = (math.nan, math.nan, math.nan)
_OF_TORQUE = (
    *("torque_mean_nm", "torque_lever_nm", "torque_min_nm", "torque_max_nm", "torque_std_nm"),
)
_OF_MOTION = (
    *("angle_mean_rad", "speed_min_rad_s", "speed_max_rad_s"),
    *("direction_mean", "direction_lever", "moving_fraction"),
)


@dataclass(frozen=True, slots=True)
class MotionHistory:
    """Motion at the start of an interval, by the rows before it."""

    direction: float = 0.0  # last known direction of motion, -1, 0 or 1
    moving_since_s: float = np.inf  # start of the unbroken motion; inf at standstill


def summarise(
    interval: IntervalRows,
    fault: Fault,
    history: MotionHistory,
    settings: PlausibilitySettings,
    channels: ChannelCheck,
) -> tuple[FeatureBlock, MotionHistory]:
    """Statistics of an interval.

    Args:
        interval: its rows.
        fault: faults already found by time and missing values.
        history: motion before the interval.
        channels: checks which channels are to be believed.

    Returns:
        The block, and the motion history at its end.
    """
    inside, torque = interval.inside, interval.inside[:-1, U]
    edges = np.ascontiguousarray(inside[:, T])
    direction = kernels.directions(
        interval.segment,
        interval.first,
        interval.end,
        interval.reach,
        settings.standstill_speed_rad_s,
    )
    reversal_count, known = kernels.reversals(direction, history.direction)
    since_s = kernels.moving_since(direction, edges, history.direction, history.moving_since_s)
    verdict = channels.check(inside, interval.ahead)
    found = _plausibility(inside, settings)
    if channels.torque_stays(torque, Fault.TORQUE_STUCK in found):
        found |= Fault.STUCK | Fault.TORQUE_STUCK
    fault |= found | verdict.fault
    if kernels.fastest_step(interval.around) > settings.max_speed_rad_s:
        fault |= Fault.IMPLAUSIBLE  # faster than any axis, in or beside the interval
    table = kernels.table(inside).tolist() if verdict.has_table else _UNKNOWN
    has_table = not math.isnan(table[2])
    if not has_table:  # missing, holed or not believed
        fault, table = fault | Fault.NO_TABLE, _UNKNOWN
    since = edges[0] - history.moving_since_s if direction[0] == history.direction else 0.0
    temperature_c, external_force_n = kernels.surroundings(inside)
    motion = dict(zip(_OF_MOTION, kernels.motion(inside, direction).tolist(), strict=True))
    block = FeatureBlock(
        time_s=float(edges[-1]),
        duration_s=float(edges[-1] - edges[0]),
        sample_count=interval.end - interval.first,
        fault=fault,
        **dict(zip(_OF_TORQUE, kernels.torque(inside).tolist(), strict=True)),
        angle_start_rad=float(inside[0, THETA]),
        angle_end_rad=float(inside[-1, THETA]),
        speed_start_rad_s=_speed_at(interval.segment, interval.first),
        speed_end_rad_s=_speed_at(interval.segment, interval.end),
        **motion,
        reversal_count=reversal_count,
        since_reversal_s=max(0.0, float(since)),
        table_start_m=table[0],
        table_end_m=table[1],
        table_mean_m=table[2],
        temperature_c=temperature_c,
        external_force_n=external_force_n,
        **_steady_phases(interval, since_s, has_table and verdict.has_stretch, settings.phases),
    )
    if direction[-1] == 0.0:
        return block, MotionHistory(known)
    return block, MotionHistory(known, float(since_s[-1]))


def _steady_phases(
    interval: IntervalRows, since_s: Floats, has_table: bool, settings: PhaseSettings
) -> dict[str, Any]:
    """Direction and phases of an interval, as fields of FeatureBlock.

    Args:
        interval: its rows.
        since_s: (end - first,), when the motion of each row began, s; inf at standstill.
        has_table: the linear encoder may be read.
        settings: criteria of steady motion.
    """
    direction, found = kernels.phases(
        interval.segment, interval.first, interval.end, interval.reach, since_s, settings.limits
    )
    if direction == 0.0:
        return {}
    if not has_table:
        found[:, -1] = math.nan
    rows = zip(PHASES, found.tolist(), strict=True)
    return {"steady_direction": direction} | {name: Phase(*row) for name, row in rows if row[0]}


def absent_block(interval: int, interval_s: float, fault: Fault) -> FeatureBlock:
    """An interval of the grid in which no row had the values that are needed."""
    unknown: dict[str, Any] = dict.fromkeys(FEATURE_FIELDS, np.nan)
    counts = {"sample_count": 0, "reversal_count": 0, "moving_fraction": 0.0}
    known = {"time_s": (interval + 1) * interval_s, "duration_s": interval_s, "fault": fault}
    return FeatureBlock(**(unknown | counts | known))


def _speed_at(segment: Floats, row: int) -> float:
    before, behind = max(row - 1, 0), min(row + 1, len(segment) - 1)
    return float(
        (segment[behind, THETA] - segment[before, THETA])
        / (segment[behind, T] - segment[before, T])
    )


def _plausibility(inside: Floats, settings: PlausibilitySettings) -> Fault:
    fault = Fault.NONE
    time_s, torque, theta = inside[:, T], inside[:, U], inside[:, THETA]
    angle_rad, torque_nm, way_rad, is_missing = kernels.extremes(inside)
    if angle_rad > WILDEST_ANGLE_RAD or torque_nm > WILDEST_TORQUE_NM:
        fault |= Fault.IMPLAUSIBLE
    if is_missing:
        fault |= Fault.NO_TORQUE
    limit_nm = math.inf if settings.max_torque_nm is None else settings.max_torque_nm
    saturated = torque_nm >= LIMIT_SHARE * limit_nm
    if saturated:
        fault |= Fault.SATURATED
    if torque_nm > 1.5 * limit_nm:
        fault |= Fault.IMPLAUSIBLE
    stood_s, start, stop = kernels.longest_run(theta, time_s)
    if stood_s >= settings.stuck_s:  # the linear encoder is asked elsewhere
        stood = inside[start:stop]
        with np.errstate(invalid="ignore"):
            setpoint_moved = np.ptp(stood[:, SET]) > MOVED_SETPOINT_M
            speed_rad_s = np.abs(np.mean(stood[:, OMEGA]))
        if setpoint_moved or speed_rad_s > 10.0 * settings.standstill_speed_rad_s:
            fault |= Fault.STUCK | Fault.ANGLE_STUCK
    torque_stuck = kernels.longest_run(torque, time_s)[0] >= settings.stuck_s and not saturated
    if torque_stuck and way_rad > MOVED_ANGLE_RAD:
        fault |= Fault.STUCK | Fault.TORQUE_STUCK
    return fault
