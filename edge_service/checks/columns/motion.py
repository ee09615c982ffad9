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
    Floats,
)
from .guess import Choice, Known, Understanding
from .names import ColumnName, Quantity
from .relations import (
    Proportion,
    changes,
    lags,
    proportion,
    smoothed_speed,
    travelled,
    whole_windows,
)

TABLE_SPEEDS_M_S = (1e-3, 3.0)
"""Rapid moves that feed drives with ball screws make."""
TABLE_UNITS = ("mm", "m", "um")
TURN = 2.0 * math.pi
LEADS_M = (5e-4, 0.1)
SURE = 0.9
SAME = 0.02
_WINDOW_S, _SAMPLES = 0.1, (5, 100)
MOTOR_SPEEDS_RAD_S = (3.0, 1000.0)
_ANGLE_UNITS = ("rad", "deg", "rev")
_SPEED_UNITS = ("mm/s", "m/s", "mm/min", "m/min")
_DERIVED = 0.02
"""Of the usual difference between two encoders: less is rounding, so one was made of the other."""
_USUAL_STRETCH_M = 1e-6
_ROUNDINGS = 16.0
"""Of double precision, which arithmetic may have added up."""


class Motion:
    """Positions and speeds of one axis, found one after the other.

    Args:
        names: columns of the axis.
        values: column -> values as they stand in the file, shape (n,).
        time_s: of every sample.
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
        self._known, self._found = known, found
        forward = np.diff(time_s)
        forward = forward[forward > 0.0]
        usual_s = float(np.median(forward)) if forward.size else 1.0
        window = int(np.clip(_WINDOW_S / usual_s, *_SAMPLES))
        self._windows = whole_windows(time_s, window)
        self._units: dict[str, str] = {}
        """Channel -> unit of its column."""

    def speed(self) -> Floats | None:
        """Speed of the axis in any unit, with the direction of its position, shape (n,)."""
        for channel in (TABLE_POSITION, ANGLE, SETPOINT):
            if channel in self._found.columns:
                return smoothed_speed(self.si(channel), self._time_s)
        return None

    def si(self, channel: str) -> Floats:
        """Values of a chosen channel in SI units, shape (n,)."""
        choice = self._found.columns[channel]
        values = self._values[choice.column]
        if choice.minus:
            values = values - self._values[choice.minus]
        result: Floats = choice.scale * values
        return result

    def _best(self, quantity: Quantity) -> ColumnName | None:
        """The moving column of a quantity that serves best."""
        fitting = [each for each in self._names if each.quantity is quantity]
        moving = [each for each in fitting if _moves(self._values[each.name])]
        return min(moving, key=lambda each: each.rank, default=None)

    def _link(self, target: str, source: str) -> Proportion | None:
        return proportion(
            *(changes(self._values[name], self._windows) for name in (target, source))
        )

    def _top_speed(self, name: str) -> float:
        speed = np.abs(smoothed_speed(self._values[name], self._time_s))
        known = speed[np.isfinite(speed)]
        return float(np.percentile(known, 99.0)) if known.size else 0.0

    def _length_unit(self, column: ColumnName, other: ColumnName | None) -> tuple[str, str]:
        for each in (column, other):
            if each is not None and each.si_unit == "m":
                return each.unit, "by its name" if each is column else f"as {each.name!r}"
        top = self._top_speed(column.name)
        able = [
            unit
            for unit in TABLE_UNITS
            if TABLE_SPEEDS_M_S[0] <= SI[unit][0] * top <= TABLE_SPEEDS_M_S[1]
        ]
        if len(able) == 1:
            return able[0], f"{SI[able[0]][0] * top:.2g} m/s is a speed of a table in no other unit"
        return "mm", "assumed, as controllers have it"

    def _lead(self) -> float | None:
        if self._known.lead_m is not None:
            return self._known.lead_m
        return self._found.lead_m

    def _set_lead(self, lead_m: float, sigma_m: float, why: str) -> None:
        given = self._known.lead_m
        found = f"{1e3 * lead_m:.5g} mm +- {1e3 * 2.0 * sigma_m:.2g} per revolution, {why}"
        if given is not None and abs(lead_m / given - 1.0) > max(SAME, 3.0 * sigma_m / given):
            self._found.say("lead_m", f"{1e3 * given:g} mm as given, but {found}", assumed=True)
        elif given is None:
            self._found.lead_m, self._found.lead_sigma_m = lead_m, sigma_m
            self._found.say("lead_m", found)

    def _ask_lead(self) -> None:
        self._found.ask(
            "--lead", "Travel per revolution of the motor, mm", "torque and force go together by it"
        )

    def _choose(self, channel: str, column: ColumnName, unit: str, why: str) -> None:
        self._units[channel] = unit
        self._found.columns[channel] = Choice(column.name, SI[unit][0])
        words = f"{column.name!r} in {unit} ({why})"
        self._found.say(channel, words, assumed=why.startswith("assumed"))

    def find(self) -> None:
        """Find position channels, their units, the lead, and the speeds."""
        motor = self._best(Quantity.MOTOR_POSITION)
        table = self._best(Quantity.TABLE_POSITION) or self._plain_position(motor)
        setpoint = self._best_setpoint(table or motor)
        self._table(table, setpoint)
        self._motor(motor)
        if table is None and motor is None:
            self._from_error(setpoint)
        self._setpoint(setpoint)
        self._lead_from_setpoint()
        self._speeds()
        if self._lead() is None:
            self._ask_lead()

    def _plain_position(self, motor: ColumnName | None) -> ColumnName | None:
        """A position whose name does not say on which side of the screw it is measured."""
        plain = self._best(Quantity.POSITION)
        if plain is None or motor is None:
            return plain
        link = self._link(plain.name, motor.name)
        return plain if link and link.correlation > SURE else None

    def _best_setpoint(self, position: ColumnName | None) -> ColumnName | None:
        fitting = [each for each in self._names if each.quantity is Quantity.SETPOINT]
        moving = [each for each in fitting if _moves(self._values[each.name])]
        if position is None or not moving:
            return moving[0] if moving else None
        links = {each.name: self._link(position.name, each.name) for each in moving}
        able = [each for each in moving if (link := links[each.name]) and link.correlation > 0.8]
        return max(able, key=lambda each: links[each.name].correlation, default=None)  # type: ignore[union-attr]

    def _table(self, table: ColumnName | None, setpoint: ColumnName | None) -> None:
        if table is None or TABLE_POSITION in self._found.columns:
            return
        unit, why = self._length_unit(table, setpoint)
        self._choose(TABLE_POSITION, table, unit, why)
        if table.quantity is Quantity.POSITION and all(
            each.quantity is not Quantity.MOTOR_POSITION for each in self._names
        ):
            self._found.say(
                TABLE_POSITION,
                f"{table.name!r} is taken as measured at the table; if it is the motor's encoder, "
                "there is no stretch of the screw in it",
                assumed=True,
            )

    def _motor(self, motor: ColumnName | None) -> None:
        if motor is None or ANGLE in self._found.columns:
            return
        lead = self._lead()
        if motor.si_unit == "m" and lead is None:
            self._found.say(
                "lead_m",
                f"cannot be told: the controller gives the motor's encoder as travel "
                f"({motor.name!r} in {motor.unit})",
            )
            self._ask_lead()
            return
        if motor.si_unit == "m" and lead is not None:
            self._found.columns[ANGLE] = Choice(motor.name, SI[motor.unit][0] * TURN / lead)
            self._found.say(ANGLE, f"{motor.name!r} in {motor.unit} of travel, by the lead")
            self._derived(motor.name)
            return
        unit, why = self._angle_unit(motor)
        if unit:
            self._choose(ANGLE, motor, unit, why)
            self._lead_from_encoders(motor)

    def _angle_unit(self, motor: ColumnName) -> tuple[str, str]:
        if motor.si_unit == "rad":
            return motor.unit, "by its name"
        top, ratio = self._top_speed(motor.name), self._table_per(motor.name)
        able = []
        for unit in _ANGLE_UNITS:
            factor = SI[unit][0]
            turns_well = MOTOR_SPEEDS_RAD_S[0] <= factor * top <= MOTOR_SPEEDS_RAD_S[1]
            lead = self._known.lead_m
            if ratio is not None and lead is not None:
                if abs(TURN * abs(ratio) / factor / lead - 1.0) < SAME:
                    return unit, "the lead that was given fits no other unit"
            elif ratio is None or LEADS_M[0] <= TURN * abs(ratio) / factor <= LEADS_M[1]:
                able += [unit] if turns_well else []
        if len(able) == 1:
            speed = f"{SI[able[0]][0] * top:.3g} rad/s"
            return able[0], f"{speed} is a speed of a motor in no other unit"
        if not able:
            self._found.say(ANGLE, f"{motor.name!r} fits no unit of an angle; it is left out")
            return "", ""
        return able[0], f"assumed; {' and '.join(able[1:])} would fit as well"

    def _table_per(self, motor: str) -> float | None:
        """Metres of the table per unit of the motor's column; None without a table."""
        table = self._found.columns.get(TABLE_POSITION)
        if table is None:
            return None
        link = self._link(table.column, motor)
        return table.scale * link.factor if link and abs(link.correlation) > SURE else None

    def _lead_from_encoders(self, motor: ColumnName) -> None:
        table = self._found.columns.get(TABLE_POSITION)
        if table is None:
            return
        link = self._link(table.column, motor.name)
        if link is None or abs(link.correlation) < SURE:
            self._found.say("lead_m", f"{table.column!r} does not follow {motor.name!r}")
            return
        angle = self._found.columns[ANGLE]
        lead = TURN * table.scale * link.factor / angle.scale
        sigma = abs(lead * link.sigma / link.factor)
        if lead < 0.0:
            self._found.columns[ANGLE] = Choice(motor.name, -angle.scale)
            self._found.say(ANGLE, "sign reversed: it counts against the table")
        self._set_lead(abs(lead), sigma, f"from {table.column!r} over {motor.name!r}")
        self._derived(motor.name)

    def _derived(self, motor: str) -> None:
        """Leave the table out if it was computed from the motor's encoder: it tells no stretch."""
        table = self._found.columns.get(TABLE_POSITION)
        link = self._link(table.column, motor) if table else None
        if table is None or link is None:
            return
        resolution = max(
            abs(table.scale) * _resolution(self._values[table.column]),
            abs(table.scale * link.factor) * _resolution(self._values[motor]),
        )
        if abs(table.scale) * link.residual < max(0.6 * resolution, _DERIVED * _USUAL_STRETCH_M):
            del self._found.columns[TABLE_POSITION]
            self._found.say(
                TABLE_POSITION,
                f"left out: {table.column!r} is {motor!r} times a number, so no second encoder",
            )

    def _from_error(self, setpoint: ColumnName | None) -> None:
        """Position as set point less error, where no column holds it."""
        error = self._best(Quantity.POSITION_ERROR)
        if setpoint is None or error is None or TABLE_POSITION in self._found.columns:
            return
        unit, why = self._length_unit(setpoint, error)
        commanded, missing = self._values[setpoint.name], self._values[error.name]
        late = lags(commanded - missing, commanded)
        if late < 0.0:
            self._found.say(TABLE_POSITION, f"{error.name!r} leads: it is position less set point")
            return
        self._found.columns[TABLE_POSITION] = Choice(setpoint.name, SI[unit][0], error.name)
        self._units[TABLE_POSITION] = unit
        self._found.say(
            TABLE_POSITION,
            f"{setpoint.name!r} less {error.name!r}, in {unit} ({why}): it comes "
            f"{late:.0f} samples after the set point",
        )

    def _setpoint(self, setpoint: ColumnName | None) -> None:
        if setpoint is None or SETPOINT in self._found.columns:
            return
        table = self._found.columns.get(TABLE_POSITION)
        if table is not None and not table.minus:
            link = self._link(table.column, setpoint.name)
            factor = table.scale * link.factor if link else 0.0
            near = [unit for unit in TABLE_UNITS if abs(factor / SI[unit][0] - 1.0) < 0.2]
            if near and setpoint.si_unit != "m":
                self._choose(SETPOINT, setpoint, near[0], f"it leads {table.column!r}")
                return
        self._choose(SETPOINT, setpoint, *self._length_unit(setpoint, None))

    def _lead_from_setpoint(self) -> None:
        """Lead from what the motor turns for a commanded travel, where no table is measured."""
        columns = self._found.columns
        if self._lead() is not None or not {ANGLE, SETPOINT} <= columns.keys():
            return
        link = self._link(columns[SETPOINT].column, columns[ANGLE].column)
        if link is None or abs(link.correlation) < SURE:
            return
        per_rad = columns[SETPOINT].scale / columns[ANGLE].scale
        lead, sigma = TURN * per_rad * link.factor, TURN * per_rad * link.sigma
        if lead < 0.0:
            angle = columns[ANGLE]
            columns[ANGLE] = Choice(angle.column, -angle.scale)
            self._found.say(ANGLE, "sign reversed: it counts against the set point")
        self._set_lead(abs(lead), abs(sigma), "from the set point over the motor's angle")

    def _speeds(self) -> None:
        self._table_speed()
        motor = self._best(Quantity.MOTOR_SPEED)
        if motor is None or MOTOR_SPEED in self._found.columns:
            return
        unit = motor.unit if motor.si_unit == "rad/s" else ""
        if not unit and ANGLE in self._found.columns:
            unit = self._speed_unit(motor, ANGLE, ("rad/s", "rev/min", "deg/s", "rev/s"))
        if unit:
            self._choose(MOTOR_SPEED, motor, unit, "by its name" if motor.unit else "by the angle")
            self._lead_from_speed(motor, unit)

    def _table_speed(self) -> None:
        speed = self._best(Quantity.SPEED)
        if speed is None or TABLE_SPEED in self._found.columns:
            return
        if speed.si_unit == "m/s":
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

    def _speed_link(self, position: str, speed: ColumnName) -> Proportion | None:
        """Changes of a position over the integral of a speed; None if they do not go together."""
        link = proportion(
            changes(self.si(position), self._windows),
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
        self._found.columns[MOTOR_SPEED] = Choice(speed.name, scale)
        self._found.say(MOTOR_SPEED, f"{speed.name!r} taken as rev/min", assumed=True)
        sigma = 60.0 * link.sigma
        self._set_lead(abs(lead), sigma, f"from the position over {speed.name!r} as rev/min")

    def _lead_from_speed(self, motor: ColumnName, unit: str) -> None:
        if self._found.lead_m is not None or TABLE_POSITION not in self._found.columns:
            return
        link = self._speed_link(TABLE_POSITION, motor)
        if link is not None:
            turn = TURN / SI[unit][0]
            why = f"from the position over {motor.name!r}"
            self._set_lead(turn * abs(link.factor), turn * link.sigma, why)


def _moves(values: Floats) -> bool:
    known = values[np.isfinite(values)]
    return known.size > 0 and float(np.ptp(known)) > 0.0


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
