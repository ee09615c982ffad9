"""Positions and speeds of a recording: which encoder, in which unit, and the lead they tell."""

import math
from collections.abc import Iterable, Mapping

import numpy as np

from ...messages.samples import (
    ANGLE,
    MOTOR_SPEED,
    SETPOINT,
    SI,
    TABLE_POSITION,
    TABLE_SPEED,
    ColumnMap,
    Floats,
)
from .guess import Known, Understanding
from .names import ColumnName, Quantity
from .relations import (
    Proportion,
    changes,
    lags,
    proportion,
    smoothed_speed,
    travelled,
    usual_step,
    whole_windows,
)
from .unnamed import known_of

TABLE_SPEEDS_M_S = (1e-3, 3.0)
"""Rapid moves that feed drives with ball screws make."""
TABLE_UNITS = ("mm", "m", "um")
TURN = 2.0 * math.pi
LEADS_M = (5e-4, 0.1)
SURE = 0.9
SAME = 0.02
_ROTARY_M = 0.36
"""Lead of a rotary axis whose degrees are read as mm: one to one."""
_WINDOW_S, _SAMPLES = 0.1, (5, 100)
MOTOR_SPEEDS_RAD_S = (3.0, 1000.0)
_ANGLE_UNITS = ("rad", "deg", "rev")
_TABLE_SPEED_UNITS = ("mm/s", "m/s", "mm/min", "m/min")
_MOTOR_SPEED_UNITS = ("rad/s", "rev/min", "deg/s", "rev/s")
_DERIVED = 0.02
"""Of the usual difference between two encoders: less is rounding, so one was made of the other."""
_USUAL_STRETCH_M = 1e-6
_ROUNDINGS = 16.0
"""Of double precision, which arithmetic may have added up."""


class Motion:
    """Positions and speeds of one axis, found one after the other.

    Values are as they stand in the file, by column, shape (n,) each.
    """

    def __init__(
        self,
        names: Iterable[ColumnName],
        values: Mapping[str, Floats],
        time_s: Floats,
        known: Known,
        found: Understanding,
    ) -> None:
        self._names, self._values, self._time_s = list(names), values, time_s
        self._known, self._found, self._columns = known, found, found.columns
        window = int(np.clip(_WINDOW_S / (usual_step(time_s) or 1.0), *_SAMPLES))
        self._windows = whole_windows(time_s, window)

    def speed(self) -> Floats | None:
        """Speed of the axis in any unit, with the direction of its position, shape (n,)."""
        able = [name for name in (TABLE_POSITION, ANGLE, SETPOINT) if name in self._columns]
        return smoothed_speed(self._si(able[0]), self._time_s) if able else None

    def find(self) -> None:
        """Find position channels, their units, the lead, and the speeds."""
        motor = self._best(Quantity.MOTOR_POSITION)
        table = self._best(Quantity.TABLE_POSITION)
        plain = self._best(Quantity.POSITION)  # on which side of the screw, its name does not say
        if table is None and plain is not None:
            link = None if motor is None else self._link(plain.name, motor.name)
            table = plain if motor is None or (link and link.correlation > SURE) else None
        setpoint = self._best_setpoint(table or motor)
        if table is not None:
            self._table(table, setpoint)
        if motor is not None:
            self._motor(motor)
        if table is None and motor is None:
            self._from_error(setpoint)
        if setpoint is not None:
            self._setpoint(setpoint)
        if self._lead is None and {ANGLE, SETPOINT} <= self._columns.keys():
            why = "from the set point over the motor's angle"
            self._lead_by_travel(SETPOINT, "the set point", why)
        self._table_speed()
        self._motor_speed()
        if self._lead is None:
            self._ask_lead()

    def _si(self, channel: str) -> Floats:
        choice = self._columns[channel]
        values = self._values[choice.column]
        if choice.minus:
            values = values - self._values[choice.minus]
        result: Floats = choice.scale * values
        return result

    def _moving(self, quantity: Quantity) -> list[ColumnName]:
        fitting = [each for each in self._names if each.quantity is quantity]
        return [e for e in fitting if np.ptp(known_of(self._values[e.name])) > 0.0]

    def _best(self, quantity: Quantity) -> ColumnName | None:
        return min(self._moving(quantity), key=lambda each: each.rank, default=None)

    def _link(self, target: str, source: str, least: float = 0.0) -> Proportion | None:
        link = proportion(*(changes(self._values[n], self._windows) for n in (target, source)))
        return link if link is not None and abs(link.correlation) >= least else None

    def _top_speed(self, name: str) -> float:
        speed = np.abs(smoothed_speed(self._values[name], self._time_s))
        return float(np.percentile(known_of(speed), 99.0))

    def _length_unit(self, column: ColumnName, other: ColumnName | None) -> tuple[str, str]:
        if column.si_unit == "rad":
            return "mm", "assumed: a rotary axis, whose degrees are read as mm, 360 a turn"
        for each in (column, other):
            if each is not None and each.si_unit == "m":
                return each.unit, each.why if each is column else f"as {each.name!r}"
        top = self._top_speed(column.name)
        low, high = TABLE_SPEEDS_M_S
        able = [unit for unit in TABLE_UNITS if low <= SI[unit][0] * top <= high]
        if len(able) == 1:
            return able[0], f"{SI[able[0]][0] * top:.2g} m/s is a speed of a table in no other unit"
        return "mm", "assumed, as controllers have it"

    @property
    def _lead(self) -> float | None:
        return self._found.lead_m if self._known.lead_m is None else self._known.lead_m

    def _set_lead(self, lead_m: float, sigma_m: float, why: str) -> None:
        given = self._known.lead_m
        found = f"{1e3 * lead_m:.5g} mm +- {1e3 * 2.0 * sigma_m:.2g} per revolution, {why}"
        if given is not None and abs(lead_m / given - 1.0) > max(SAME, 3.0 * sigma_m / given):
            self._found.say("lead_m", f"{1e3 * given:g} mm as given, but {found}", assumed=True)
        elif given is None:
            self._found.lead_m = lead_m
            rotary = ": a rotary axis, one to one" if abs(lead_m / _ROTARY_M - 1.0) < SAME else ""
            self._found.say("lead_m", found + rotary, assumed=lead_m > LEADS_M[1])

    def _ask_lead(self) -> None:
        self._found.ask(
            "--lead", "Travel per revolution of the motor, mm", "torque and force go together by it"
        )

    def _choose(self, channel: str, column: ColumnName, unit: str, why: str) -> None:
        self._columns[channel] = ColumnMap(column.name, SI[unit][0])
        words = f"{column.name!r} in {unit} ({why})"
        self._found.say(channel, words, assumed=why.startswith("assumed"))

    def _best_setpoint(self, position: ColumnName | None) -> ColumnName | None:
        moving = self._moving(Quantity.SETPOINT)
        if position is None or not moving:
            return moving[0] if moving else None
        links = {each.name: self._link(position.name, each.name) for each in moving}
        close = {name: link.correlation for name, link in links.items() if link is not None}
        able = [each for each in moving if close.get(each.name, 0.0) > 0.8]
        return max(able, key=lambda each: close[each.name], default=None)

    def _table(self, table: ColumnName, setpoint: ColumnName | None) -> None:
        if not table.unit and (self._known.lead_m or 0.0) > LEADS_M[1]:
            why = "no screw has such a lead, and an angle has no unit that all drives use"
            self._found.ask("--column", f'"{ANGLE}={table.name}:UNIT"', why)
            return
        self._choose(TABLE_POSITION, table, *self._length_unit(table, setpoint))
        named = {each.quantity for each in self._names}
        if table.quantity is Quantity.POSITION and Quantity.MOTOR_POSITION not in named:
            words = "is taken for the table's; if it is the motor's encoder, it has no stretch"
            if not table.unit:
                words += f', if it is an angle, say --column "{ANGLE}={table.name}:UNIT"'
            self._found.say(TABLE_POSITION, f"{table.name!r} {words}", assumed=True)

    def _motor(self, motor: ColumnName) -> None:
        lead = self._lead
        if motor.si_unit == "m" and lead is None:
            words = f"as travel ({motor.name!r} in {motor.unit})"
            words = f"cannot be told: the controller gives the motor's encoder {words}"
            self._found.say("lead_m", words)
            self._ask_lead()
        elif motor.si_unit == "m" and lead is not None:
            self._columns[ANGLE] = ColumnMap(motor.name, SI[motor.unit][0] * TURN / lead)
            self._found.say(ANGLE, f"{motor.name!r} in {motor.unit} of travel, by the lead")
            self._drop_derived(motor.name)
        elif (unit := self._angle_unit(motor)) is not None:
            self._choose(ANGLE, motor, *unit)
            table = self._columns.get(TABLE_POSITION)
            if table is None:
                return
            why = f"from {table.column!r} over {motor.name!r}"
            if self._lead_by_travel(TABLE_POSITION, "the table", why):
                self._drop_derived(motor.name)
            else:
                self._found.say("lead_m", f"{table.column!r} does not follow {motor.name!r}")

    def _angle_unit(self, motor: ColumnName) -> tuple[str, str] | None:
        """Unit of the motor's angle, and why; None where none fits."""
        if motor.si_unit == "rad":
            return motor.unit, motor.why
        top, lead, table = self._top_speed(motor.name), self._known.lead_m, None
        if (known := self._columns.get(TABLE_POSITION)) is not None:
            table = self._link(known.column, motor.name, SURE)
        able = []
        for unit in _ANGLE_UNITS:
            factor = SI[unit][0]
            turns_well = MOTOR_SPEEDS_RAD_S[0] <= factor * top <= MOTOR_SPEEDS_RAD_S[1]
            told_m = None
            if known is not None and table is not None:
                told_m = TURN * abs(known.scale * table.factor) / factor
            if told_m is not None and lead is not None:
                if abs(told_m / lead - 1.0) < SAME:
                    return unit, "the lead that was given fits no other unit"
            elif told_m is None or LEADS_M[0] <= told_m <= LEADS_M[1]:
                able += [unit] if turns_well else []
        if len(able) == 1:
            speed = f"{SI[able[0]][0] * top:.3g} rad/s"
            return able[0], f"{speed} is a speed of a motor in no other unit"
        if not able:
            self._found.say(ANGLE, f"{motor.name!r} fits no unit of an angle; it is left out")
            return None
        return able[0], f"assumed; {' and '.join(able[1:])} would fit as well"

    def _lead_by_travel(self, channel: str, against: str, why: str) -> bool:
        """Lead from a travel over the motor's angle, which is turned to count with it."""
        travel, angle = self._columns[channel], self._columns[ANGLE]
        link = self._link(travel.column, angle.column, SURE)
        if link is None:
            return False
        lead = TURN * travel.scale * link.factor / angle.scale
        if lead < 0.0:
            self._columns[ANGLE] = ColumnMap(angle.column, -angle.scale)
            self._found.say(ANGLE, f"sign reversed: it counts against {against}")
        self._set_lead(abs(lead), abs(lead * link.sigma / link.factor), why)
        return True

    def _drop_derived(self, motor: str) -> None:
        """Leave the table out if it was computed from the motor's encoder: it tells no stretch."""
        table = self._columns.get(TABLE_POSITION)
        link = self._link(table.column, motor) if table else None
        if table is None or link is None:
            return
        of_motor = abs(link.factor) * _resolution(self._values[motor])
        resolution = abs(table.scale) * max(_resolution(self._values[table.column]), of_motor)
        if abs(table.scale) * link.residual < max(0.6 * resolution, _DERIVED * _USUAL_STRETCH_M):
            del self._columns[TABLE_POSITION]
            words = f"left out: {table.column!r} is {motor!r} times a number, so no second encoder"
            self._found.say(TABLE_POSITION, words)

    def _from_error(self, setpoint: ColumnName | None) -> None:
        """Position as set point less error, where no column holds it."""
        error = self._best(Quantity.POSITION_ERROR)
        if setpoint is None or error is None:
            return
        unit, why = self._length_unit(setpoint, error)
        commanded, missing = self._values[setpoint.name], self._values[error.name]
        late = lags(commanded - missing, commanded)
        if late < 0.0:
            self._found.say(TABLE_POSITION, f"{error.name!r} leads: it is position less set point")
            return
        self._columns[TABLE_POSITION] = ColumnMap(setpoint.name, SI[unit][0], minus=error.name)
        words = f"it comes {late:.0f} samples after the set point"
        words = f"{setpoint.name!r} less {error.name!r}, in {unit} ({why}): {words}"
        self._found.say(TABLE_POSITION, words)

    def _setpoint(self, setpoint: ColumnName) -> None:
        table = self._columns.get(TABLE_POSITION)
        if table is not None and not table.minus:
            link = self._link(table.column, setpoint.name)
            factor = table.scale * link.factor if link else 0.0
            near = [unit for unit in TABLE_UNITS if abs(factor / SI[unit][0] - 1.0) < 0.2]
            if near and setpoint.si_unit != "m":
                self._choose(SETPOINT, setpoint, near[0], f"it leads {table.column!r}")
                return
        self._choose(SETPOINT, setpoint, *self._length_unit(setpoint, None))

    def _table_speed(self) -> None:
        speed = self._best(Quantity.SPEED)
        if speed is None:
            return
        if speed.si_unit == "m/s":
            self._choose(TABLE_SPEED, speed, speed.unit, speed.why)
            return
        position = TABLE_POSITION if TABLE_POSITION in self._columns else ANGLE
        if position not in self._columns:
            return
        units = _TABLE_SPEED_UNITS if position == TABLE_POSITION else _MOTOR_SPEED_UNITS[:3]
        unit = self._speed_unit(speed, position, units)
        if unit:
            channel = TABLE_SPEED if position == TABLE_POSITION else MOTOR_SPEED
            self._choose(channel, speed, unit, f"it is the derivative of {position}")
        elif position == TABLE_POSITION:
            self._turning_speed(speed)

    def _motor_speed(self) -> None:
        motor = self._best(Quantity.MOTOR_SPEED)
        if motor is None or MOTOR_SPEED in self._columns:
            return
        unit = motor.unit if motor.si_unit == "rad/s" else ""
        if not unit and ANGLE in self._columns:
            unit = self._speed_unit(motor, ANGLE, _MOTOR_SPEED_UNITS)
        if not unit:
            return
        self._choose(MOTOR_SPEED, motor, unit, motor.why if motor.unit else "by the angle")
        if self._found.lead_m is None and TABLE_POSITION in self._columns:
            link = self._speed_link(TABLE_POSITION, motor)
            if link is not None:
                turn = TURN / SI[unit][0]
                why = f"from the position over {motor.name!r}"
                self._set_lead(turn * abs(link.factor), turn * link.sigma, why)

    def _speed_link(self, position: str, speed: ColumnName) -> Proportion | None:
        """Changes of a position over the integral of a speed; None if they do not go together."""
        link = proportion(
            changes(self._si(position), self._windows),
            travelled(self._values[speed.name], self._time_s, self._windows),
        )
        return link if link is not None and abs(link.correlation) >= SURE else None

    def _speed_unit(self, speed: ColumnName, position: str, units: tuple[str, ...]) -> str:
        """Unit in which a speed is the derivative of a position; empty if in none."""
        link = self._speed_link(position, speed)
        factor = 0.0 if link is None else abs(link.factor)
        return next((unit for unit in units if abs(factor / SI[unit][0] - 1.0) < 0.05), "")

    def _turning_speed(self, speed: ColumnName) -> None:
        """A speed that is no speed of the table: what it would be as one of the motor."""
        link = self._speed_link(TABLE_POSITION, speed)
        if link is None:
            self._found.say("speed", f"{speed.name!r} is not the speed of the position; left out")
            return
        lead = 60.0 * link.factor
        if not LEADS_M[0] <= abs(lead) <= LEADS_M[1]:
            self._found.say("speed", f"{speed.name!r}: its unit cannot be told; left out")
            return
        scale = math.copysign(SI["rev/min"][0], lead)
        self._columns[MOTOR_SPEED] = ColumnMap(speed.name, scale)
        self._found.say(MOTOR_SPEED, f"{speed.name!r} taken as rev/min", assumed=True)
        why = f"from the position over {speed.name!r} as rev/min"
        self._set_lead(abs(lead), 60.0 * link.sigma, why)


def _resolution(values: Floats) -> float:
    """Smallest step between the greater values that occur: fewer digits are left to those."""
    known = np.unique(values[np.isfinite(values)])
    if not known.size:
        return 0.0
    greatest = float(np.quantile(np.abs(known), 0.95))
    great = np.abs(known) >= 0.5 * greatest
    steps = np.diff(known)[great[1:] & great[:-1]]
    steps = steps[steps > _ROUNDINGS * np.spacing(greatest)]
    return float(steps.min()) if steps.size else 0.0
