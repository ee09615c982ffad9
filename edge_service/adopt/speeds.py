"""Speeds of a recording: their units, and the lead that they tell."""

import math

from ..messages.channels import ANGLE, MOTOR_SPEED, TABLE_POSITION, TABLE_SPEED
from ..messages.units import SI
from .guess import Choice
from .motion_columns import LEADS_M, SURE, TURN, MotionColumns
from .names import ColumnName, Quantity
from .relations import changes, proportion, travelled

_SPEED_UNITS = ("mm/s", "m/s", "mm/min", "m/min")


class Speeds(MotionColumns):
    """Speeds beside positions that were found."""

    def _speeds(self) -> None:
        self._table_speed()
        motor = self._best(Quantity.MOTOR_SPEED)
        if motor is None or MOTOR_SPEED in self._found.columns:
            return
        unit = motor.unit if SI.get(motor.unit, (0.0, ""))[1] == "rad/s" else ""
        if not unit and ANGLE in self._found.columns:
            unit = self._speed_unit(motor, ANGLE, ("rad/s", "rev/min", "deg/s", "rev/s"))
        if unit:
            self._choose(MOTOR_SPEED, motor, unit, "by its name" if motor.unit else "by the angle")
            self._lead_from_speed(motor, unit)

    def _table_speed(self) -> None:
        speed = self._best(Quantity.SPEED)
        if speed is None or TABLE_SPEED in self._found.columns:
            return
        if SI.get(speed.unit, (0.0, ""))[1] == "m/s":
            self._choose(TABLE_SPEED, speed, speed.unit, "by its name")
            return
        position = TABLE_POSITION if TABLE_POSITION in self._found.columns else ANGLE
        if position not in self._found.columns:
            return
        units = _SPEED_UNITS if position == TABLE_POSITION else ("rad/s", "rev/min", "deg/s")
        unit = self._speed_unit(speed, position, units)
        if unit:
            channel = TABLE_SPEED if position == TABLE_POSITION else MOTOR_SPEED
            self._choose(channel, speed, unit, f"it is the derivative of {position}")
        elif position == TABLE_POSITION:
            self._turning_speed(speed)

    def _speed_unit(self, speed: ColumnName, position: str, units: tuple[str, ...]) -> str:
        """Unit in which a speed is the derivative of a position; empty if in none."""
        link = proportion(
            changes(self.si(position), self._windows),
            travelled(self._values[speed.name], self._time_s, self._windows),
        )
        if link is None or abs(link.correlation) < SURE:
            return ""
        near = [unit for unit in units if abs(abs(link.factor) / SI[unit][0] - 1.0) < 0.05]
        return near[0] if near else ""

    def _turning_speed(self, speed: ColumnName) -> None:
        """A speed that is no speed of the table: what it would be as one of the motor."""
        link = proportion(
            changes(self.si(TABLE_POSITION), self._windows),
            travelled(self._values[speed.name], self._time_s, self._windows),
        )
        if link is None or abs(link.correlation) < SURE:
            self._found.say("speed", f"{speed.name!r} is not the speed of the position; left out")
            return
        lead = 60.0 * link.factor
        if not LEADS_M[0] <= abs(lead) <= LEADS_M[1]:
            self._found.say("speed", f"{speed.name!r}: its unit cannot be told; left out")
            return
        scale = math.copysign(SI["rev/min"][0], lead)
        self._found.columns[MOTOR_SPEED] = Choice(speed.name, scale)
        self._found.say(MOTOR_SPEED, f"{speed.name!r} taken as rev/min", assumed=True)
        sigma = 60.0 * link.sigma
        self._set_lead(abs(lead), sigma, f"from the position over {speed.name!r} as rev/min")

    def _lead_from_speed(self, motor: ColumnName, unit: str) -> None:
        if self._found.lead_m is not None or TABLE_POSITION not in self._found.columns:
            return
        link = proportion(
            changes(self.si(TABLE_POSITION), self._windows),
            SI[unit][0] * travelled(self._values[motor.name], self._time_s, self._windows),
        )
        if link is not None and abs(link.correlation) > SURE:
            lead = TURN * abs(link.factor)
            sigma = TURN * link.sigma
            self._set_lead(lead, sigma, f"from the position over {motor.name!r}")
