"""Runs of one repeated value with the travel meanwhile, and what resolution explains of them."""

import math
from dataclasses import dataclass, field

import numpy as np

from ...messages.samples import Floats
from ...messages.stored import Number
from ...models.compiled import compiled

LEAST_ROWS = 4
"""Rows from which a value counts as repeated; a slow channel holds each for long."""
_FORGET = 1.0 + 1.0 / 256.0
"""Growth of the least step per interval: a channel may become coarser."""
_SMOOTH = 1.0 / 16.0
_LEAST_CHANGES = 5
_HELD = 1.5
"""Periods from which a channel is slower than the rows."""


@dataclass(frozen=True, slots=True)
class OpenRun:
    """Run of one value in which the rows so far end.

    Attributes:
        value: repeated.
        rows: that hold it.
        low_m, high_m: reach of the other channel meanwhile.
    """

    value: Number = np.nan
    rows: int = 0
    low_m: Number = np.inf
    high_m: Number = -np.inf


def standing(values: Floats, other_m: Floats, before: OpenRun) -> tuple[float, float]:
    """Longest travel of another channel (n,) while one, (n,), n > 0, stood still, m.

    At most that in runs that are still open or end in a leap as far; and that in the open run, 0 if
    it is no repeat.

    Args:
        before: run in which the earlier rows end.
    """
    return _caught_up(values, other_m, before.value, before.rows, before.low_m, before.high_m)


@compiled
def _caught_up(
    values: Floats, other_m: Floats, value: float, earlier: int, low_m: float, high_m: float
) -> tuple[float, float]:
    """See `standing`; `earlier` rows of `value` came before, the other within its reach."""
    caught_up_m, count = 0.0, len(values)
    rows, low, high = 0, np.inf, -np.inf
    if values[0] == value:
        rows, low, high = earlier, low_m, high_m
    for row in range(count):
        rows += 1
        low, high = min(low, other_m[row]), max(high, other_m[row])
        if row + 1 < count and values[row + 1] - values[row] == 0.0:
            continue
        way_m = high - low if rows >= LEAST_ROWS else 0.0
        ends = row + 1 < count
        if not ends or abs(values[row + 1] - values[row]) > 0.5 * way_m:
            caught_up_m = max(caught_up_m, way_m)
        if ends:
            rows, low, high = 0, np.inf, -np.inf
    return caught_up_m, (high - low if rows > 1 else 0.0)


def followed(values: Floats, other_m: Floats, before: OpenRun) -> OpenRun:
    """Run of one value in which rows (n,), n > 0, end."""
    changes = np.flatnonzero(values != values[-1])
    first = int(changes[-1]) + 1 if changes.size else 0
    rows = len(values) - first
    low, high = float(other_m[first:].min()), float(other_m[first:].max())
    if first == 0 and before.value == values[-1]:
        return OpenRun(
            before.value, rows + before.rows, min(low, before.low_m), max(high, before.high_m)
        )
    return OpenRun(float(values[-1]), rows, low, high)


@dataclass(slots=True)
class ChannelResolution:
    """Usual step and hold time of one channel; NaN before they are known.

    The least over the intervals is taken: motion only adds to the step, coarse steps at slow
    motion only add to the hold.

    Attributes:
        step_m: least usual step, as way of the axis: resolution or noise.
        hold_s: least usual time between two steps of the moving axis.
    """

    step_m: Number = math.nan
    hold_s: Number = math.nan

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
        """Longest usual way between two steps, m; infinite while nothing is known."""
        way = self.step_m + self.hold_s * speed_m_s
        return math.inf if math.isnan(way) else way


@dataclass(slots=True)
class EncoderResolution:
    """Resolution of both position channels, and the noise of their difference."""

    table: ChannelResolution = field(default_factory=ChannelResolution)
    angle: ChannelResolution = field(default_factory=ChannelResolution)
    noise_m: Number = 0.0

    def learn(self, table_m: Floats, way_m: Floats, moved_s: float) -> None:
        """Take both channels (n,) of an interval that is believed."""
        self.table.learn(table_m, moved_s)
        self.angle.learn(way_m, moved_s)
        noise_m = _middle(np.abs(np.diff(way_m - table_m)))
        self.noise_m += _SMOOTH * (noise_m - self.noise_m)

    def run_m(self, speed_m_s: float) -> float:
        """Longest way during one value of either channel that resolution explains, m."""
        return 4.0 * (self.table.way_m(speed_m_s) + self.angle.way_m(speed_m_s))

    def lag_s(self, period_s: float) -> float:
        """Lag of a channel slower than the rows, s."""
        held = [each.hold_s for each in (self.table, self.angle) if each.hold_s > _HELD * period_s]
        return sum(held)


def _middle(values: Floats) -> float:
    return float(np.sort(values)[len(values) // 2])


def _less(known: float, new: float) -> float:
    return new if math.isnan(known) else min(_FORGET * known, new)
