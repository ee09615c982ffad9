"""Resolution of the encoders in way and in time, learned while they are believed."""

import math
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats

_FORGET = 1.0 + 1.0 / 256.0
"""Growth of the least step per interval: a channel may become coarser."""
_SMOOTH = 1.0 / 16.0
_LEAST_CHANGES = 5
_HELD = 1.5
"""Periods from which a channel is slower than the rows."""


@dataclass(slots=True)
class ChannelResolution:
    """Usual step and hold time of one channel; NaN before they are known.

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
        """Longest usual way between two steps, m; infinite while nothing is known."""
        way = self.step_m + self.hold_s * speed_m_s
        return math.inf if math.isnan(way) else way


@dataclass(slots=True)
class EncoderResolution:
    """Resolution of both position channels, and the noise of their difference."""

    table: ChannelResolution
    angle: ChannelResolution
    noise_m: float = 0.0

    @classmethod
    def unknown(cls) -> "EncoderResolution":
        """Before the first interval."""
        return cls(ChannelResolution(), ChannelResolution())

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
