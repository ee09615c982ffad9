"""Sufficient statistics of one interval of contiguous rows."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..checks.live.channel_check import ChannelCheck
from ..checks.live.channel_limits import ChannelLimits
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
from ..messages.stored import Number
from . import interval_kernels as kernels


@dataclass(frozen=True, slots=True)
class DownsampleSettings:
    """Settings for the reduction of samples to intervals."""

    interval_s: float = 0.1  # length of an interval, s
    max_torque_nm: float | None = None  # the drive's torque limit; None if unknown
    min_speed_rad_s: float = 2.0  # slower rows are not steady (Stribeck friction, creeping jogs)
    cruise_rad_s2: float = 30.0  # up to this acceleration the axis cruises
    channels: ChannelLimits | None = None  # between the encoders; of the lead alone unless given


STANDSTILL_RAD_S = 0.05
"""Slower than this is standstill."""
MAX_SPEED_RAD_S = 1500.0
"""A faster step of the encoder is no motion."""
GATE_S = 0.05
"""Time after a reversal or a start that is not steady (presliding, wind-up)."""
_EVEN_SHARE = 0.2
"""Rows whose window is less even than this are not steady (a hole in it)."""
WILDEST_ANGLE_RAD = 1e8
WILDEST_TORQUE_NM = 1e5
_UNKNOWN = (math.nan, math.nan, math.nan)
_OF_TORQUE = tuple(f"torque_{each}_nm" for each in ("mean", "lever", "min", "max", "std"))
_OF_MOTION = (
    *("angle_mean_rad", "speed_min_rad_s", "speed_max_rad_s"),
    *("direction_mean", "direction_lever", "moving_fraction"),
)


@dataclass(frozen=True, slots=True)
class MotionHistory:
    """Motion at the start of an interval, by the rows before it."""

    direction: float = 0.0  # last known direction of motion, -1, 0 or 1
    moving_since_s: Number = np.inf  # start of the unbroken motion; inf at standstill


def summarise(
    segment: Floats,
    first: int,
    end: int,
    reach: int,
    fault: Fault,
    history: MotionHistory,
    settings: DownsampleSettings,
    channels: ChannelCheck,
) -> tuple[FeatureBlock, MotionHistory]:
    """Statistics of an interval.

    Args:
        segment: (n, 8) contiguous rows, also before and after the interval.
        first, end: row indices; row `end` is the first of the next interval.
        reach: half width in rows of the differences that give direction and acceleration.
        fault: faults already found by time and missing values.
        history: motion before the interval.
        channels: checks which channels are to be believed.

    Returns:
        The block, and the motion history at its end.
    """
    inside, ahead = segment[first : end + 1], segment[end + 1 : end + 1 + reach]
    torque, edges = inside[:-1, U], np.ascontiguousarray(inside[:, T])
    direction = kernels.directions(segment, first, end, reach, STANDSTILL_RAD_S)
    reversal_count, known = kernels.reversals(direction, history.direction)
    since_s = kernels.moving_since(direction, edges, history.direction, history.moving_since_s)
    verdict = channels.check(inside, ahead)
    found = _plausibility(inside, settings.max_torque_nm)
    if channels.torque_stays(torque, Fault.TORQUE_STUCK in found):
        found |= Fault.STUCK | Fault.TORQUE_STUCK
    fault |= found | verdict.fault
    if kernels.fastest_step(segment[max(first - 1, 0) : end + 2]) > MAX_SPEED_RAD_S:
        fault |= Fault.IMPLAUSIBLE  # faster than any axis, in or beside the interval
    table = kernels.table(inside).tolist() if verdict.has_table else _UNKNOWN
    has_table = not math.isnan(table[2])
    if not has_table:  # missing, holed or not believed
        fault, table = fault | Fault.NO_TABLE, _UNKNOWN
    since = edges[0] - history.moving_since_s if direction[0] == history.direction else 0.0
    temperature_c, external_force_n = kernels.surroundings(inside)
    motion = dict(zip(_OF_MOTION, kernels.motion(inside, direction).tolist(), strict=True))
    limits = np.array([GATE_S, settings.min_speed_rad_s, settings.cruise_rad_s2, _EVEN_SHARE])
    steady_direction, phases = kernels.phases(segment, first, end, reach, since_s, limits)
    steady: dict[str, Any] = {"steady_direction": steady_direction}
    if steady_direction != 0.0:
        if not (has_table and verdict.has_stretch):
            phases[:, -1] = math.nan
        rows = zip(PHASES, phases.tolist(), strict=True)
        steady |= {name: Phase(*row) for name, row in rows if row[0]}
    block = FeatureBlock(
        time_s=float(edges[-1]),
        duration_s=float(edges[-1] - edges[0]),
        sample_count=end - first,
        fault=fault,
        **dict(zip(_OF_TORQUE, kernels.torque(inside).tolist(), strict=True)),
        angle_start_rad=float(inside[0, THETA]),
        angle_end_rad=float(inside[-1, THETA]),
        speed_start_rad_s=_speed_at(segment, first),
        speed_end_rad_s=_speed_at(segment, end),
        **motion,
        reversal_count=reversal_count,
        since_reversal_s=max(0.0, float(since)),
        table_start_m=table[0],
        table_end_m=table[1],
        table_mean_m=table[2],
        temperature_c=temperature_c,
        external_force_n=external_force_n,
        **steady,
    )
    return block, MotionHistory(known, float(since_s[-1]))


def absent_block(interval: int, interval_s: float, fault: Fault) -> FeatureBlock:
    """An interval of the grid in which no row had the values that are needed."""
    unknown: dict[str, Any] = dict.fromkeys(FEATURE_FIELDS, np.nan)
    counts = {"sample_count": 0, "reversal_count": 0, "moving_fraction": 0.0}
    known = {"time_s": (interval + 1) * interval_s, "duration_s": interval_s, "fault": fault}
    return FeatureBlock(**(unknown | counts | known))


def _speed_at(segment: Floats, row: int) -> float:
    before, behind = segment[max(row - 1, 0)], segment[min(row + 1, len(segment) - 1)]
    return float((behind[THETA] - before[THETA]) / (behind[T] - before[T]))


def _plausibility(inside: Floats, max_torque_nm: float | None) -> Fault:
    fault = Fault.NONE
    time_s, torque, theta = inside[:, T], inside[:, U], inside[:, THETA]
    angle_rad, torque_nm, way_rad, is_missing = kernels.extremes(inside)
    if angle_rad > WILDEST_ANGLE_RAD or torque_nm > WILDEST_TORQUE_NM:
        fault |= Fault.IMPLAUSIBLE
    if is_missing:
        fault |= Fault.NO_TORQUE
    limit_nm = math.inf if max_torque_nm is None else max_torque_nm
    saturated = torque_nm >= LIMIT_SHARE * limit_nm
    if saturated:
        fault |= Fault.SATURATED
    if torque_nm > 1.5 * limit_nm:
        fault |= Fault.IMPLAUSIBLE
    stood_s, start, stop = kernels.longest_run(theta, time_s)
    if stood_s >= STUCK_S:  # the linear encoder is asked elsewhere
        stood = inside[start:stop]
        with np.errstate(invalid="ignore"):
            setpoint_moved = np.ptp(stood[:, SET]) > MOVED_SETPOINT_M
            speed_rad_s = np.abs(np.mean(stood[:, OMEGA]))
        if setpoint_moved or speed_rad_s > 10.0 * STANDSTILL_RAD_S:
            fault |= Fault.STUCK | Fault.ANGLE_STUCK
    torque_stuck = kernels.longest_run(torque, time_s)[0] >= STUCK_S and not saturated
    if torque_stuck and way_rad > MOVED_ANGLE_RAD:
        fault |= Fault.STUCK | Fault.TORQUE_STUCK
    return fault
