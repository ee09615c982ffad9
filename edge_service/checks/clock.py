"""Check of the clock: its rate, its gaps, and whether it counts seconds."""

import contextlib
import math
from collections.abc import Sequence

from ..messages.samples import (
    ANGLE,
    MOTOR_SPEED,
    TABLE_POSITION,
    TABLE_SPEED,
    TIME,
    TORQUE,
    SampleFrame,
)
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
    """Unit that every witness needs; nothing where there is none, or one contradicts.

    A speed is too large by the factor of the clock, an inertia by its square.
    """
    witnesses = []  # ratio to what it should be, and the factor by which it may be off
    for speed, position in ((MOTOR_SPEED, ANGLE), (TABLE_SPEED, TABLE_POSITION)):
        with contextlib.suppress(ValueError):
            factor = regress_channel(recordings, speed, position, derivative=1).factor
            if factor.determined and factor.low > 0.0:
                witnesses.append((factor.value, 1.0 + 5.0 * FACTOR_TOLERANCE))
    if any(TORQUE in frame.channels for frame in recordings):
        with contextlib.suppress(ValueError):
            inertia = measured_inertia(machine, recordings)
            if inertia.determined and inertia.low > 0.0:
                ratio = inertia.value / machine.model.inertia_kg_m2.value
                witnesses.append((math.sqrt(ratio), math.sqrt(INERTIA_FACTOR)))
    for unit, scale in UNITS.items():
        if witnesses and all(
            abs(math.log(ratio * float(scale))) < math.log(within) for ratio, within in witnesses
        ):
            return unit
    return ""
