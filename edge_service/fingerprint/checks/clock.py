"""Check of the clock: its rate, its gaps, and whether it counts seconds."""

import math
from collections.abc import Sequence

import numpy as np

from ...messages.channels import ANGLE, MOTOR_SPEED, TABLE_POSITION, TABLE_SPEED, TIME, TORQUE
from ...messages.samples import SampleFrame
from ...models.machine import Machine
from .channel_regression import regress_channel
from .check_result import FACTOR_TOLERANCE, CheckResult, Verdict
from .sampling import is_slow, sampling_period_s
from .torque import INERTIA_FACTOR, measured_inertia

FASTEST_HZ = 1e5
"""No controller records an axis faster; a clock in minutes or hours would seem to."""
UNITS = {1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds", 1.0 / 60.0: "minutes"}
"""Counts per second -> what is counted."""
_SCALES = {"milliseconds": "1e-3", "microseconds": "1e-6", "nanoseconds": "1e-9", "minutes": "60.0"}


def check_clock(machine: Machine, recordings: Sequence[SampleFrame]) -> CheckResult:
    """Tell rate, gaps and jitter, and a unit of time that speeds and inertia contradict."""
    period_s = sampling_period_s(recordings)
    steps = np.concatenate([np.diff(frame.time_s) for frame in recordings])
    forward = steps[steps > 0.0]
    gaps = int(np.count_nonzero(forward > 1.5 * period_s))
    jitter = float(np.percentile(np.abs(forward - period_s), 95.0)) / period_s
    sentence = f"{1.0 / period_s:.4g} samples/s, {gaps} gaps, jitter {100.0 * jitter:.2g} %"
    backwards = int(np.count_nonzero(steps <= 0.0))
    if backwards:
        sentence += f", {backwards} times repeated or running backwards"
    slow = is_slow(period_s)
    unit = _other_unit(machine, recordings) if slow or period_s < 1.0 / FASTEST_HZ else ""
    if unit:
        sentence = f"{TIME} looks like {unit}, not seconds: {sentence}"
        remedy = (
            f"give the unit in columns.{TIME}, as in {{ column = ..., scale = {_SCALES[unit]} }}"
        )
        return CheckResult("rate", Verdict.DOUBTFUL, sentence, remedy=remedy, forbids=True)
    if slow:
        sentence += "; too slow to follow the torque between samples: intervals will be wide"
        remedy = "record faster if the controller can"
        return CheckResult("rate", Verdict.DOUBTFUL, sentence, remedy=remedy)
    return CheckResult("rate", Verdict.FITS, sentence)


def _other_unit(machine: Machine, recordings: Sequence[SampleFrame]) -> str:
    """Unit that every witness needs; nothing where there is none, or one contradicts.

    A speed is too large by the factor of the clock, an inertia by its square.
    """
    witnesses = [*_by_speeds(recordings), *_by_inertia(machine, recordings)]
    for factor, unit in UNITS.items():
        if witnesses and all(
            abs(math.log(ratio / factor)) < math.log(within) for ratio, within in witnesses
        ):
            return unit
    return ""


def _by_speeds(recordings: Sequence[SampleFrame]) -> list[tuple[float, float]]:
    """Each recorded speed over the derivative of its position, and how far it may be off."""
    found = []
    for speed, position in ((MOTOR_SPEED, ANGLE), (TABLE_SPEED, TABLE_POSITION)):
        try:
            factor = regress_channel(recordings, speed, position, derivative=1).factor
        except ValueError:
            continue
        if factor.determined and factor.low > 0.0:
            found.append((factor.value, 1.0 + 5.0 * FACTOR_TOLERANCE))
    return found


def _by_inertia(machine: Machine, recordings: Sequence[SampleFrame]) -> list[tuple[float, float]]:
    """Root of the inertia over the stated one, and how far it may be off."""
    if not any(TORQUE in frame.channels for frame in recordings):
        return []
    try:
        inertia = measured_inertia(machine, recordings)
    except ValueError:
        return []
    if not inertia.determined or inertia.low <= 0.0:
        return []
    ratio = inertia.value / machine.model.inertia_kg_m2.value
    return [(math.sqrt(ratio), math.sqrt(INERTIA_FACTOR))]
