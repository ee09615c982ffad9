"""Check that a torque changes with the direction: the amount of a current does not."""

from collections.abc import Sequence

import numpy as np

from ...messages.channels import TORQUE
from ...messages.samples import Floats, SampleFrame
from ..regression.prepared_run import PreparationSettings, prepare
from .check_result import CheckResult, Verdict

ONE_SIDE = 0.05
"""Share of the greatest torque that the other side may reach by noise and an offset."""
CLEARLY = 0.8
"""Squared residual over that of the rival, from which on one model is the better one.

A load that hangs may keep torque on one side, but then it still follows the signed acceleration and
friction; a magnitude follows their absolute values.
"""
LEAST_ROWS = 40


def judge_sign(
    recordings: Sequence[SampleFrame], settings: PreparationSettings
) -> CheckResult | None:
    """Finding on a torque that stays on one side both ways; None of one that does not."""
    torque, speed, acceleration = _rows(recordings, settings)
    way = np.sign(speed)
    if len(torque) < LEAST_ROWS or not {-1.0, 1.0} <= set(way.tolist()):
        return None
    low, high = (float(each) for each in np.quantile(torque, (0.02, 0.98)))
    nearest, furthest = sorted((low, high), key=abs)
    if nearest * np.sign(furthest) < -ONE_SIDE * abs(furthest):
        return None
    one = np.ones_like(torque)
    signed = _left(torque, np.column_stack([way, acceleration, speed, one]))
    amount = _left(torque, np.column_stack([one, way * acceleration, np.abs(speed), way]))
    if signed < CLEARLY * amount:
        return None
    sure = amount < CLEARLY * signed
    what = "a magnitude, not a load that hangs" if sure else "a magnitude, or a load that hangs"
    sentence = (
        f"{TORQUE} stays on one side both ways ({low:.3g} to {high:.3g} N m) and does not follow "
        f"the signed acceleration: {what}"
    )
    remedy = f"needs signed torque or current in columns.{TORQUE}, and moves that accelerate"
    return CheckResult("torque", Verdict.DOUBTFUL, sentence, remedy=remedy, forbids=sure)


def _rows(
    recordings: Sequence[SampleFrame], settings: PreparationSettings
) -> tuple[Floats, Floats, Floats]:
    """Torque, speed and acceleration in motion, (n,) each."""
    runs = [run for frame in recordings for run in prepare(frame, settings)]
    found = [np.empty((0, 3))]
    for run in runs:
        columns = np.column_stack([run.channels[TORQUE], run.speed_rad_s, run.acceleration_rad_s2])
        found.append(columns[run.moving][:: settings.decimation])
    torque, speed, acceleration = np.concatenate(found).T
    return torque, speed, acceleration


def _left(target: Floats, columns: Floats) -> float:
    """Residual sum of squares, and what rounding leaves of any."""
    value = np.linalg.lstsq(columns, target, rcond=None)[0]
    return float(np.sum((target - columns @ value) ** 2) + 1e-12 * np.sum(target**2))
