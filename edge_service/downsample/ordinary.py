"""Ordinary behaviour of a channel: the step it makes and how long it holds a value."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..messages.arrays import decoded, encoded
from ..messages.samples import Floats

_FORGET = 1.0 + 1.0 / 256.0
"""Growth per interval of what was least so far: a channel may become coarser."""
_SMOOTH = 1.0 / 16.0
_LEAST_CHANGES = 5
_HELD = 1.5
"""Periods from which a channel is slower than the rows."""


@dataclass(slots=True)
class Ordinary:
    """A channel's own manner, learned while it is believed; NaN before.

    The least over the intervals is taken: motion only adds to the step, coarse steps at slow
    motion only add to the hold.

    Attributes:
        step_m: least usual step, as way of the axis: resolution or noise.
        hold_s: least usual time between two steps of the moving axis.
    """

    step_m: float = math.nan
    hold_s: float = math.nan

    def learn(self, way_m: Floats, moved_s: float) -> None:
        """Take a channel (n,) of an interval with motion in one direction for `moved_s`."""
        steps = np.abs(np.diff(way_m))
        steps = steps[steps > 0.0]
        if len(steps) < _LEAST_CHANGES:
            return
        self.step_m = _less(self.step_m, _middle(steps))
        if moved_s > 0.0:
            self.hold_s = _less(self.hold_s, moved_s / len(steps))

    def way_m(self, speed_m_s: float) -> float:
        """Most ordinary way between two steps, m; infinite while nothing is known."""
        way = self.step_m + self.hold_s * speed_m_s
        return math.inf if math.isnan(way) else way


@dataclass(slots=True)
class Manners:
    """Behaviour of the position channels while they are believed."""

    table: Ordinary
    angle: Ordinary
    noise_m: float = 0.0

    @classmethod
    def unknown(cls) -> "Manners":
        """Before the first interval."""
        return cls(Ordinary(), Ordinary())

    def learn(self, table_m: Floats, way_m: Floats, moved_s: float) -> None:
        """Take both channels (n,) of an interval that is believed."""
        self.table.learn(table_m, moved_s)
        self.angle.learn(way_m, moved_s)
        noise_m = _middle(np.abs(np.diff(way_m - table_m)))
        self.noise_m += _SMOOTH * (noise_m - self.noise_m)

    def run_m(self, speed_m_s: float) -> float:
        """Most way during one value of either channel that may be ordinary, m."""
        return 4.0 * (self.table.way_m(speed_m_s) + self.angle.way_m(speed_m_s))

    def lag_s(self, period_s: float) -> float:
        """Lag of a channel slower than the rows, s."""
        held = [each.hold_s for each in (self.table, self.angle) if each.hold_s > _HELD * period_s]
        return sum(held)

    def snapshot(self) -> str:
        """State as text."""
        table, angle = self.table, self.angle
        numbers = [table.step_m, table.hold_s, angle.step_m, angle.hold_s, self.noise_m]
        return encoded(np.array(numbers))

    @classmethod
    def restored(cls, snapshot: Any) -> "Manners":
        """From a snapshot."""
        numbers = decoded(snapshot, np.float64).tolist()
        return cls(Ordinary(*numbers[:2]), Ordinary(*numbers[2:4]), numbers[4])


def _middle(values: Floats) -> float:
    return float(np.sort(values)[len(values) // 2])


def _less(known: float, new: float) -> float:
    return new if math.isnan(known) else min(_FORGET * known, new)
