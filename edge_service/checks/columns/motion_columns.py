"""Columns of one axis while its motion is understood: what is chosen, and what moves alike."""

import math
from collections.abc import Iterable, Mapping

import numpy as np

from ...messages.channels import ANGLE, SETPOINT, TABLE_POSITION
from ...messages.samples import Floats
from ...messages.units import SI
from .guess import Choice, Known, Understanding
from .names import ColumnName, Quantity
from .relations import Proportion, changes, proportion, smoothed_speed, whole_windows

TABLE_SPEEDS_M_S = (1e-3, 3.0)
"""Rapid moves that feed drives with ball screws make."""
TABLE_UNITS = ("mm", "m", "um")
TURN = 2.0 * math.pi
LEADS_M = (5e-4, 0.1)
SURE = 0.9
SAME = 0.02
_WINDOW_S, _SAMPLES = 0.1, (5, 100)


class MotionColumns:
    """Columns of one axis, and the channels that were chosen among them.

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
        self._windows = whole_windows(time_s, _window(time_s))
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
        moving = [each for each in fitting if moves(self._values[each.name])]
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
            if each is not None and SI.get(each.unit, (0.0, ""))[1] == "m":
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

    def _has(self, quantity: Quantity) -> bool:
        return any(each.quantity is quantity for each in self._names)

    def _choose(self, channel: str, column: ColumnName, unit: str, why: str) -> None:
        self._units[channel] = unit
        self._found.columns[channel] = Choice(column.name, SI[unit][0])
        words = f"{column.name!r} in {unit} ({why})"
        self._found.say(channel, words, assumed=why.startswith("assumed"))


def _window(time_s: Floats) -> int:
    """Samples of about `_WINDOW_S`."""
    steps = np.diff(time_s)
    forward = steps[steps > 0.0]
    usual = float(np.median(forward)) if forward.size else 1.0
    return int(np.clip(_WINDOW_S / usual, _SAMPLES[0], _SAMPLES[1]))


def moves(values: Floats) -> bool:
    known = values[np.isfinite(values)]
    return known.size > 0 and float(np.ptp(known)) > 0.0
