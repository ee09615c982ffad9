"""Examination of recordings: every check that holds them against the machine file and each other.

Commands that learn from a recording or judge it ask this before they answer; `doctor` prints it.
Every finding is a number with an interval, held against the machine file, in one sentence:
"torque sign looks inverted", "lead looks like 10 mm, not 20".
"""

from collections.abc import Callable, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace

import numpy as np

from ..messages.samples import (
    ANGLE,
    MOTOR_SPEED,
    SETPOINT,
    TABLE_POSITION,
    TABLE_SPEED,
    TEMPERATURE,
    TORQUE,
    SampleFrame,
)
from ..models.machine import Machine
from . import positions, signals, torque
from .finding import Finding, Verdict

SLACK_S = 1.0
"""Shorter halves of a recording are not asked whether they show a mistake as well."""


@dataclass(frozen=True, slots=True)
class Check:
    """One entry of the registry.

    Attributes:
        compared: what is held against what.
        remedy: what to do where it doubts.
        needed: channels without which there is nothing to check.
    """

    run: Callable[[Machine, Sequence[SampleFrame]], Finding]
    compared: str
    remedy: str
    needed: AbstractSet[str] = frozenset()

    @property
    def name(self) -> str:
        """Name by which it is told."""
        return self.run.__name__.removeprefix("check_")


CHECKS: tuple[Check, ...] = (
    Check(
        signals.check_rate,
        "steps of time_s; speeds and inertia that would need another unit of time",
        "give the unit in columns.time_s, as in { column = ..., scale = 1e-3 }",
    ),
    Check(
        signals.check_signals,
        "every channel against its own first value",
        "check that the device is switched on and the right channel is recorded",
    ),
    Check(
        signals.check_samples,
        "every sample of torque and positions against its neighbours",
        "look for lost or late telegrams, overflows and slow channels; record all at one rate",
    ),
    Check(
        positions.check_lead,
        "table_position_m over motor_angle_rad against axis.lead_m",
        "check axis.lead_m, and the scales of columns.motor_angle_rad and .table_position_m",
        {ANGLE, TABLE_POSITION},
    ),
    Check(
        positions.check_encoder_lag,
        "times of table_position_m and motor_angle_rad",
        "record both encoders at the same instant",
        {ANGLE, TABLE_POSITION},
    ),
    Check(
        positions.check_setpoint,
        "position against position_setpoint_m, in motion and at rest",
        "check axis.lead_m and the scales of the position and of columns.position_setpoint_m",
        {SETPOINT},
    ),
    Check(
        positions.check_motor_speed,
        "motor_speed_rad_s against the rate of motor_angle_rad",
        "check the scale of columns.motor_speed_rad_s",
        {ANGLE, MOTOR_SPEED},
    ),
    Check(
        positions.check_table_speed,
        "table_speed_m_s against the rate of table_position_m",
        "check the scale of columns.table_speed_m_s",
        {TABLE_POSITION, TABLE_SPEED},
    ),
    Check(
        torque.check_torque,
        "torque_command_nm against acceleration and direction, and model.inertia_kg_m2",
        "check sign and scale of columns.torque_command_nm, axis.lead_m and model.inertia_kg_m2, "
        "or whether it needs faster samples",
        {TORQUE},
    ),
    Check(
        signals.check_limits,
        "greatest speed and torque against axis.max_speed_rad_s and axis.max_torque_nm",
        "check the scales of the columns, or the limits in the machine file",
    ),
    Check(
        signals.check_stroke,
        "range of table_position_m against axis.stroke_m",
        "check the zero and the scale of columns.table_position_m, and axis.stroke_m",
        {TABLE_POSITION},
    ),
    Check(
        signals.check_temperature,
        "range of temperature_c against what a machine can have",
        "check the scale and the offset of columns.temperature_c",
        {TEMPERATURE},
    ),
)
"""Checks in the order in which they are told: what spoils the others comes first."""


def check_plausibility(
    machine: Machine, recordings: Sequence[SampleFrame], unread: Sequence[str] | None = None
) -> list[Finding]:
    """Every check that the channels allow, in a fixed order.

    Args:
        recordings: of one axis; a longer one may come in pieces.
        unread: columns of the files that are no channel; None where there are no files.
    """
    channels = {name for frame in recordings for name in frame.channels}
    found = [] if unread is None else [signals.check_columns(channels, unread)]
    has_limits = bool(machine.axis.max_speed_rad_s or machine.axis.max_torque_nm)
    for check in CHECKS:
        if check.needed <= channels and (check.name != "limits" or has_limits):
            found.append(_lasting(check, machine, recordings))
    return found


def _lasting(check: Check, machine: Machine, recordings: Sequence[SampleFrame]) -> Finding:
    """Finding of a check; a mistake of unit or sign is in the first half and in the second.

    What comes or goes in between is a fault of the machine or of a sensor, and for the answer.
    """
    found = _judged(check, machine, recordings)
    if not found.forbids:
        return found
    long = [frame for frame in recordings if np.ptp(frame.time_s) > 2.0 * SLACK_S]
    first = [frame.part(slice(0, len(frame) // 2)) for frame in long]
    second = [frame.part(slice(len(frame) // 2, None)) for frame in long]
    halves = [_judged(check, machine, half).verdict for half in (first, second) if half]
    return replace(found, forbids=Verdict.FITS not in halves)


def _judged(check: Check, machine: Machine, recordings: Sequence[SampleFrame]) -> Finding:
    try:
        found = check.run(machine, recordings)
    except ValueError as error:
        sentence = f"cannot tell: {' '.join(str(error).split())}"
        found = Finding(check.name, Verdict.UNKNOWN, sentence)
    remedy = check.remedy if found.is_doubtful and not found.remedy else found.remedy
    return replace(found, name=check.name, compared=check.compared, remedy=remedy)
