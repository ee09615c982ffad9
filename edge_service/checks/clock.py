"""Check of the clock: its rate, its gaps, and whether it counts seconds."""

import math
from collections.abc import Sequence

from ..messages.channels import ANGLE, MOTOR_SPEED, TABLE_POSITION, TABLE_SPEED, TIME, TORQUE
from ..messages.samples import SampleFrame
from ..models.machine import Machine
from .channel_regression import regress_channel
from .finding import FACTOR_TOLERANCE, Finding, Verdict
from .sampling import clock_of
from .torque import INERTIA_FACTOR, measured_inertia

FASTEST_HZ = 1e5
"""No controller records an axis faster; a clock in minutes or hours would seem to."""
UNITS = {"milliseconds": "1e-3", "microseconds": "1e-6", "nanoseconds": "1e-9", "minutes": "60.0"}
"""Unit that a clock may count in place of seconds -> its scale to seconds."""


def check_clock(machine: Machine, recordings: Sequence[SampleFrame]) -> Finding:
    """Rate, gaps and jitter, and a unit of time that speeds and inertia contradict."""
    clock = clock_of([frame.time_s for frame in recordings])
    said = clock.as_text()
    odd = clock.is_slow or clock.rate_hz > FASTEST_HZ
    unit = _other_unit(machine, recordings) if odd else ""
    if unit:
        remedy = f"give the unit in columns.{TIME}, as in {{ column = ..., scale = {UNITS[unit]} }}"
        sentence = f"{TIME} looks like {unit}, not seconds: {said}"
        return Finding("rate", Verdict.DOUBTFUL, sentence, remedy=remedy, forbids=True)
    if clock.is_slow:
        said += "; too slow to follow the torque between samples: intervals will be wide"
        remedy = "record faster if the controller can"
        return Finding("rate", Verdict.DOUBTFUL, said, remedy=remedy)
    return Finding("rate", Verdict.FITS, said)


def _other_unit(machine: Machine, recordings: Sequence[SampleFrame]) -> str:
    """Unit that every witness needs; nothing where there is none, or one contradicts."""
    witnesses = [*_by_speeds(recordings), *_by_inertia(machine, recordings)]
    for unit, scale in UNITS.items():
        if witnesses and all(
            abs(math.log(ratio * float(scale))) < math.log(within) for ratio, within in witnesses
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
