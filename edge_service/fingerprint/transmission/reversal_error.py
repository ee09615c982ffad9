"""Quadrant error: what following and both encoders show when the axis turns back slowly."""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from ...messages.samples import ANGLE, SETPOINT, TABLE_POSITION
from ...regression.interval_estimate import IntervalEstimate, undetermined
from ...regression.prepared_run import PreparedRun
from ..result import Contents, mean_of

SLOW_M_S = 0.02
"""Faster reversals show the inertia, not the contact."""
LEAST_TRAVEL_M = 2e-4
"""Shorter moves may not wind the contacts up fully."""
_ONE = "one slow reversal; its scatter needs 2 or more"
_AFTER_S = 0.1
_MEAN_S = 0.05


def measure_reversal_error(runs: Iterable[PreparedRun]) -> Contents:
    """Following error and encoder difference at slow reversals. Raises ValueError: none."""
    found = [reversal for run in runs for reversal in reversals(run)]
    if not found:
        raise ValueError(
            f"no reversal below {SLOW_M_S:g} m/s with {LEAST_TRAVEL_M:g} m of travel on both sides"
        )
    peaks, steps = (
        [each for each in column if math.isfinite(each)] for column in zip(*found, strict=True)
    )
    figures = {
        "following_peak_m": _mean(peaks, f"needs {SETPOINT} and a position"),
        "encoder_step_m": _mean(steps, f"needs {TABLE_POSITION} beside {ANGLE}"),
    }
    return figures, ()


def _mean(values: Sequence[float], lacking: str) -> IntervalEstimate:
    if len(values) > 1:
        return mean_of(values, [0.0] * len(values), "m")
    return undetermined("m", _ONE if values else lacking, len(values))


def reversals(run: PreparedRun) -> list[tuple[float, float]]:
    """Slow reversals of a run, a rest between the two directions or not.

    Of each the greatest following error within 0.1 s after it, NaN without setpoints, and the
    change of motor encoder less table encoder, positive where the table stays behind, NaN with one
    encoder; m.
    """
    way = np.where(run.moving, np.sign(run.speed_rad_s), 0.0)
    moving = np.flatnonzero(way)
    turns = np.flatnonzero(way[moving[1:]] != way[moving[:-1]])
    ratio = run.settings.ratio_m_per_rad
    motor = run.channels[ANGLE] * ratio
    table, setpoint = run.channels.get(TABLE_POSITION), run.channels.get(SETPOINT)
    margin, mean = math.ceil(_AFTER_S / run.period_s), math.ceil(_MEAN_S / run.period_s)
    edges = [moving[0], *(moving[turn] for turn in turns), moving[-1]] if len(moving) else []
    found = []
    for k, turn in enumerate(turns, start=1):
        before, after = int(moving[turn]), int(moving[turn + 1])
        window = slice(max(before - margin, 0), after + margin)
        next_stop = int(edges[k + 1])
        travels = abs(motor[before] - motor[edges[k - 1]]), abs(motor[next_stop] - motor[after])
        slow = float(np.max(np.abs(run.speed_rad_s[window]))) * ratio < SLOW_M_S
        if not (slow and min(travels) > LEAST_TRAVEL_M and after + margin < len(run)):
            continue
        peak = step = math.nan
        earlier, later = slice(max(before - mean, 0), before), slice(before, after + margin)
        if setpoint is not None:
            error = setpoint - (motor if table is None else table)
            error = error - np.mean(error[earlier])
            peak = float(np.max(np.abs(error[later])))
        if table is not None:
            stretch = motor - table
            now = np.mean(stretch[after + margin - mean : after + margin])
            change = float(now - np.mean(stretch[earlier]))
            step = change * math.copysign(1.0, run.speed_rad_s[after])
        found.append((peak, step))
    return found
