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
_REVERSALS, _TABLE = 15, slice(17, 20)  # places in a block, from the torque's mean on


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
    limits = np.array([GATE_S, settings.min_speed_rad_s, settings.cruise_rad_s2, _EVEN_SHARE])
    before = (history.direction, float(history.moving_since_s), STANDSTILL_RAD_S)
    row, shown, phases = kernels.of_interval(segment, first, end, reach, before, limits)
    time_s, duration_s, *numbers = row.tolist()
    direction, since_s, fastest, steady_direction, *seen = shown.tolist()
    verdict = channels.check(inside, ahead)
    found = _plausibility(inside, seen, settings.max_torque_nm)
    if channels.torque_stays(inside[:-1, U], Fault.TORQUE_STUCK in found):
        found |= Fault.STUCK | Fault.TORQUE_STUCK
    fault |= found | verdict.fault
    if fastest > MAX_SPEED_RAD_S:
        fault |= Fault.IMPLAUSIBLE  # faster than any axis, in or beside the interval
    has_table = verdict.has_table and not math.isnan(numbers[_TABLE.stop - 1])
    if not has_table:  # missing, holed or not believed
        fault, numbers[_TABLE] = fault | Fault.NO_TABLE, _UNKNOWN
    numbers[_REVERSALS] = int(numbers[_REVERSALS])
    steady: dict[str, Any] = {"steady_direction": steady_direction}
    if steady_direction != 0.0:
        if not (has_table and verdict.has_stretch):
            phases[:, -1] = math.nan
        rows = zip(PHASES, phases.tolist(), strict=True)
        steady |= {name: Phase(*row) for name, row in rows if row[0]}
    block = FeatureBlock(time_s, duration_s, end - first, fault, *numbers, **steady)
    return block, MotionHistory(direction, since_s)


def absent_block(interval: int, interval_s: float, fault: Fault) -> FeatureBlock:
    """An interval of the grid in which no row had the values that are needed."""
    unknown: dict[str, Any] = dict.fromkeys(FEATURE_FIELDS, np.nan)
    counts = {"sample_count": 0, "reversal_count": 0, "moving_fraction": 0.0}
    known = {"time_s": (interval + 1) * interval_s, "duration_s": interval_s, "fault": fault}
    return FeatureBlock(**(unknown | counts | known))


def _plausibility(inside: Floats, seen: list[float], max_torque_nm: float | None) -> Fault:
    """Faults of an interval by its rows (n, 8) and what `of_interval` has seen in them."""
    fault = Fault.NONE
    angle_rad, torque_nm, way_rad, is_missing, stays_s, stood_s, start, stop = seen
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
    if stood_s >= STUCK_S:  # the linear encoder is asked elsewhere
        stood = inside[int(start) : int(stop)]
        with np.errstate(invalid="ignore"):
            setpoint_moved = np.ptp(stood[:, SET]) > MOVED_SETPOINT_M
            speed_rad_s = np.abs(np.mean(stood[:, OMEGA]))
        if setpoint_moved or speed_rad_s > 10.0 * STANDSTILL_RAD_S:
            fault |= Fault.STUCK | Fault.ANGLE_STUCK
    if stays_s >= STUCK_S and not saturated and way_rad > MOVED_ANGLE_RAD:
        fault |= Fault.STUCK | Fault.TORQUE_STUCK
    return fault
