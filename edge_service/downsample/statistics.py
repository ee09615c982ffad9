"""Sufficient statistics of one interval of contiguous rows."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..messages.features import FEATURE_FIELDS, Fault, FeatureBlock
from ..messages.row_faults import (
    LIMIT_SHARE,
    MOVED_ANGLE_RAD,
    MOVED_SETPOINT_M,
    STUCK_S,
    run_starts,
)
from ..messages.samples import Floats
from .channels.channel_check import ChannelCheck
from .channels.repeats import LEAST_ROWS
from .interval_rows import IntervalRows
from .phases import PhaseSettings, steady_phases
from .rows import FORCE, OMEGA, SET, TEMP, THETA, T, U, X


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


@dataclass(frozen=True, slots=True)
class MotionHistory:
    """Motion at the start of an interval, by the rows before it."""

    direction: float = 0.0  # last known direction of motion, -1, 0 or 1
    moving_since_s: float = np.inf  # start of the unbroken motion; inf at standstill


def lever(values: Floats, edges_s: Floats) -> tuple[float, float]:
    """Mean and lever of a held quantity.

    Args:
        values: (n,), each held from its edge to the next.
        edges_s: (n + 1,), s.

    Returns:
        (1/T) int q dt and (1/T^2) int (T - s) q ds over the interval of length T.
    """
    rest = edges_s[-1] - edges_s
    duration = rest[0]
    mean = float(values @ -np.diff(rest)) / float(duration)
    return mean, float(values @ -np.diff(rest**2)) / (2.0 * float(duration) ** 2)


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
    inside = interval.inside
    edges = inside[:, T]
    direction = _directions(interval, settings.standstill_speed_rad_s)
    reversals, after = _follow_motion(direction, edges, history)
    verdict = channels.check(inside, interval.ahead)
    table_fault, table = _table_statistics(inside, verdict.has_table)
    fault |= _faults(interval, settings, channels) | table_fault | verdict.fault
    since = edges[0] - history.moving_since_s if direction[0] == history.direction else 0.0
    return FeatureBlock(
        time_s=float(edges[-1]),
        duration_s=float(edges[-1] - edges[0]),
        sample_count=interval.end - interval.first,
        fault=fault,
        **_torque_statistics(inside),
        **_motion_statistics(interval, direction),
        reversal_count=reversals,
        since_reversal_s=max(0.0, float(since)),
        table_start_m=table[0],
        table_end_m=table[1],
        table_mean_m=table[2],
        temperature_c=_mean(inside[:-1, TEMP]),
        external_force_n=_mean(inside[:-1, FORCE]),
        **steady_phases(
            interval,
            since_s=_moving_since(direction, edges, history),
            has_table=not table_fault and verdict.has_stretch,
            settings=settings.phases,
        ),
    ), after


def _faults(
    interval: IntervalRows, settings: PlausibilitySettings, channels: ChannelCheck
) -> Fault:
    """Faults of torque and angle in an interval."""
    inside = interval.inside
    found = _plausibility(inside, settings)
    if channels.torque_stays(inside[:-1, U], Fault.TORQUE_STUCK in found):
        found |= Fault.STUCK | Fault.TORQUE_STUCK
    return found | _wild_steps(interval.around, settings.max_speed_rad_s)


def _torque_statistics(inside: Floats) -> dict[str, Any]:
    """Statistics of the torque, held from row to row, as fields of FeatureBlock."""
    torque = inside[:-1, U]
    mean, moment = lever(torque, inside[:, T])
    return {
        "torque_mean_nm": mean,
        "torque_lever_nm": moment,
        "torque_min_nm": float(torque.min()),
        "torque_max_nm": float(torque.max()),
        "torque_std_nm": float(torque.std()),
    }


def _motion_statistics(interval: IntervalRows, direction: Floats) -> dict[str, Any]:
    """Statistics of angle, speed and direction, (end - first,), as fields of FeatureBlock."""
    inside = interval.inside
    edges, theta = inside[:, T], inside[:, THETA]
    steps, duration = np.diff(edges), float(edges[-1] - edges[0])
    step_speed = np.diff(theta) / steps
    direction_mean, direction_lever = lever(direction, edges)
    return {
        "angle_start_rad": float(theta[0]),
        "angle_end_rad": float(theta[-1]),
        "angle_mean_rad": float((theta[1:] + theta[:-1]) @ steps) / (2.0 * duration),
        "speed_start_rad_s": _speed_at(interval.segment, interval.first),
        "speed_end_rad_s": _speed_at(interval.segment, interval.end),
        "speed_min_rad_s": float(step_speed.min()),
        "speed_max_rad_s": float(step_speed.max()),
        "direction_mean": direction_mean,
        "direction_lever": direction_lever,
        "moving_fraction": float((direction != 0.0) @ steps) / duration,
    }


def absent_block(interval: int, interval_s: float, fault: Fault) -> FeatureBlock:
    """An interval of the grid in which no row had the values that are needed."""
    unknown: dict[str, Any] = dict.fromkeys(FEATURE_FIELDS, np.nan)
    counts = {"sample_count": 0, "reversal_count": 0, "moving_fraction": 0.0}
    known = {"time_s": (interval + 1) * interval_s, "duration_s": interval_s, "fault": fault}
    return FeatureBlock(**(unknown | counts | known))


def _directions(interval: IntervalRows, standstill: float) -> Floats:
    """Direction of motion of each row's interval, -1, 0 or 1, from a centred difference."""
    segment, reach = interval.segment, interval.reach
    time_s, theta = segment[:, T], segment[:, THETA]
    rows = np.arange(interval.first, interval.end)
    before = np.maximum(rows - reach + 1, 0)
    behind = np.minimum(rows + reach, len(segment) - 1)
    speed = (theta[behind] - theta[before]) / (time_s[behind] - time_s[before])
    return np.sign(speed) * (np.abs(speed) > standstill)


def _speed_at(segment: Floats, row: int) -> float:
    before, behind = max(row - 1, 0), min(row + 1, len(segment) - 1)
    return float(
        (segment[behind, THETA] - segment[before, THETA])
        / (segment[behind, T] - segment[before, T])
    )


def _follow_motion(
    direction: Floats, edges: Floats, history: MotionHistory
) -> tuple[int, MotionHistory]:
    """Number of reversals, and the history at the interval's end."""
    moved = direction[direction != 0.0]
    known = moved if history.direction == 0.0 else np.concatenate([[history.direction], moved])
    reversals = int(np.count_nonzero(np.diff(known))) if known.size else 0
    if direction[-1] == 0.0:
        return reversals, MotionHistory(float(known[-1]) if known.size else 0.0)
    broken = np.flatnonzero(direction != direction[-1])
    if broken.size:
        since = float(edges[broken[-1] + 1])
    elif direction[0] == history.direction and np.isfinite(history.moving_since_s):
        since = history.moving_since_s
    else:
        since = float(edges[0])
    return reversals, MotionHistory(float(direction[-1]), since)


def _moving_since(direction: Floats, edges: Floats, history: MotionHistory) -> Floats:
    """For each row the time at which its unbroken motion began, s; inf at standstill, (n,)."""
    before = np.concatenate([[history.direction], direction[:-1]])
    known = direction[0] == history.direction and np.isfinite(history.moving_since_s)
    starts = np.where(direction != before, edges[:-1], -np.inf)
    starts[0] = history.moving_since_s if known else edges[0]
    since = np.maximum.accumulate(starts)
    return np.where(direction == 0.0, np.inf, since)


def _table_statistics(inside: Floats, believed: bool) -> tuple[Fault, tuple[float, float, float]]:
    """Linear encoder at start and end and its mean, m; NaN if missing, holed or not believed."""
    table = inside[:, X]
    if not believed or np.isnan(table).any():
        return Fault.NO_TABLE, (np.nan, np.nan, np.nan)
    steps = np.diff(inside[:, T])
    mean = float((table[1:] + table[:-1]) @ steps) / (2.0 * float(steps.sum()))
    return Fault.NONE, (float(table[0]), float(table[-1]), mean)


def _wild_steps(rows: Floats, max_speed_rad_s: float) -> Fault:
    """Fault if the angle steps faster than any axis, in or beside the interval."""
    speed = np.diff(rows[:, THETA]) / np.diff(rows[:, T])
    return Fault.IMPLAUSIBLE if np.abs(speed).max() > max_speed_rad_s else Fault.NONE


def _plausibility(inside: Floats, settings: PlausibilitySettings) -> Fault:
    fault = Fault.NONE
    time_s, torque, theta = inside[:, T], inside[:, U], inside[:, THETA]
    wild = (
        np.abs(theta).max() > WILDEST_ANGLE_RAD
        or np.nanmax(np.abs(torque), initial=0.0) > WILDEST_TORQUE_NM
    )
    if wild:
        fault |= Fault.IMPLAUSIBLE
    if np.isnan(torque).any():
        fault |= Fault.NO_TORQUE
    limit = settings.max_torque_nm
    saturated = limit is not None and np.nanmax(np.abs(torque), initial=0.0) >= LIMIT_SHARE * limit
    if saturated:
        fault |= Fault.SATURATED
    if limit is not None and np.nanmax(np.abs(torque), initial=0.0) > 1.5 * limit:
        fault |= Fault.IMPLAUSIBLE
    stood_s, stood = _longest_run(theta, time_s)
    if stood_s >= settings.stuck_s and _others_moved(inside[stood], settings):
        fault |= Fault.STUCK | Fault.ANGLE_STUCK
    torque_stuck = _longest_run(torque, time_s)[0] >= settings.stuck_s and not saturated
    if torque_stuck and np.ptp(theta) > MOVED_ANGLE_RAD:
        fault |= Fault.STUCK | Fault.TORQUE_STUCK
    return fault


def _others_moved(inside: Floats, settings: PlausibilitySettings) -> bool:
    """True if setpoint or speed say that the axis moved; the linear encoder is asked elsewhere."""
    with np.errstate(invalid="ignore"):
        setpoint = np.ptp(inside[:, SET]) > MOVED_SETPOINT_M
        speed = np.abs(np.mean(inside[:, OMEGA])) > 10.0 * settings.standstill_speed_rad_s
    return bool(setpoint or speed)


def _longest_run(values: Floats, time_s: Floats) -> tuple[float, slice]:
    """Longest time for which one value is repeated, s, and its rows."""
    edges = np.append(run_starts(values), len(values) - 1)
    lasting = time_s[np.minimum(edges[1:], len(values) - 1)] - time_s[edges[:-1]]
    lasting = np.where(np.diff(edges) >= LEAST_ROWS, lasting, 0.0)
    run = int(np.argmax(lasting))
    return float(lasting[run]), slice(int(edges[run]), max(int(edges[run + 1]), edges[run] + 1))


def _mean(values: Floats) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else np.nan
