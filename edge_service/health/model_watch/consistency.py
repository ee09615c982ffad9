"""Consistency of an axis with its behaviour when it was learned: innovations over sustained motion.

Two channels are watched: torque, and table against motor. Of each a linear model is learned from
ordinary work; afterwards the normalised innovation squared of every stretch of motion is held
against those of the stretches that came before. What the estimator follows by itself, or what
follows from it (drag, viscous friction, growth of the screw, stiffness of the nut), is fitted anew
in every stretch and so never counts; neither does what is sure but too small to matter.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...messages.features import FeatureBlock
from ...messages.health import Consistency, ConsistencyState
from ...messages.samples import Floats
from .channel_model import CHANNELS, LEAST_RATIO, ROWS, ChannelModel, LearnedChannel

STRETCH_S = 8.0
"""Steady motion that one innovation statistic is taken over, s."""
STRETCHES = 3
"""So many in a row must count before model and axis disagree."""
CALM = 3
"""So many in a row must not before they agree again."""
AGREES_BELOW = 0.8
_LEAST_STEADY_S = 0.02

CHANNEL_WORDS = {"torque_nm": "the torque", "transmission_m": "the table against the motor"}


@dataclass(frozen=True, slots=True)
class Disagreement:
    """A change of the verdict.

    Attributes:
        disagrees: what it changed to.
        channel: where the innovations grew most.
        ratio: how many times the expected they are.
        since_s: when that began, on the axis' clock, s.
    """

    disagrees: bool
    channel: str
    ratio: float
    since_s: float


class ConsistencyWatch:
    """Watches one axis.

    Args:
        ratio_m_per_rad: way of the table per angle of the motor; None watches the torque alone.
    """

    def __init__(self, ratio_m_per_rad: float | None) -> None:
        self._ratio = ratio_m_per_rad
        self.restart()

    def restart(self) -> None:
        """Learn anew: the axis is another one from now on."""
        names = CHANNELS if self._ratio is not None else CHANNELS[:1]
        self._channels = {name: ChannelModel(name) for name in names}
        self._steady_s = 0.0
        self._counting, self._calm = 0, 0
        self._recent: list[tuple[float, float]] = []
        self._last: Disagreement | None = None
        self._ratios: dict[str, float] = {}
        self._newest_s = -math.inf

    def add(self, block: FeatureBlock) -> Disagreement | None:
        """Take an interval in; what changed, if anything."""
        if block.time_s < self._newest_s:
            self._begin_stretch()  # a new clock
            self._counting = 0
        self._newest_s = block.time_s
        if not block.usable or block.steady_direction == 0.0:
            return None
        for phase in block.phases:
            if phase.steady_s >= _LEAST_STEADY_S:
                for name, channel in self._channels.items():
                    row, value = ROWS[name](phase, block.steady_direction, self._ratio or 1.0)
                    channel.add(row, value, block.time_s)
        self._steady_s += sum(phase.steady_s for phase in block.phases)
        return self._end_stretch() if self._steady_s >= STRETCH_S else None

    def shown(self) -> Consistency:
        """The verdict for people; `add` has returned when it began."""
        if self._last is not None and self._last.disagrees:
            state = ConsistencyState.DISAGREES
            return Consistency(state=state, ratio=self._ratios, channel=self._last.channel)
        learned = [each for each in self._channels.values() if each.learned]
        known = bool(learned) and all(math.isfinite(each.limit) for each in learned)
        state = ConsistencyState.AGREES if known else ConsistencyState.LEARNING
        return Consistency(state=state, ratio=self._ratios)

    def _end_stretch(self) -> Disagreement | None:
        """Compare a stretch with those before, and learn from it; the change, if any."""
        squares = {name: each.innovations() for name, each in self._channels.items()}
        means = {n: None if s is None else float(np.mean(s)) for n, s in squares.items()}
        over = self._over(means)
        self._ratios = {
            name: float(f"{mean / self._channels[name].mean:.3g}")
            for name, mean in means.items()
            if mean is not None and self._channels[name].mean > 0.0
        }
        worst = max(over, key=lambda name: over[name], default=None)
        counts = worst is not None and over[worst] > 1.0
        if worst is not None and (counts or self._counting):
            self._remember(worst, squares[worst])
        change = self._change(worst, counts=counts, over=0.0 if worst is None else over[worst])
        disagreeing = self._last is not None and self._last.disagrees
        for name, channel in self._channels.items():
            if not counts and not disagreeing:
                channel.accept(means[name])
        self._begin_stretch()
        return change

    def _begin_stretch(self) -> None:
        for channel in self._channels.values():
            channel.drop()
        self._steady_s = 0.0

    def _over(self, means: Mapping[str, float | None]) -> dict[str, float]:
        """Mean squares over their limits, where both are known."""
        return {
            name: mean / self._channels[name].limit
            for name, mean in means.items()
            if mean is not None and math.isfinite(self._channels[name].limit)
        }

    def _remember(self, name: str, squares: Floats | None) -> None:
        """Innovations since things began to differ, in units of what is expected."""
        channel = self._channels[name]
        if squares is not None:
            if not self._counting:
                self._recent = []
            scaled = squares / max(channel.mean, 1e-300)
            self._recent += list(zip(channel.times_s.tolist(), scaled.tolist(), strict=True))

    def _change(self, worst: str | None, *, counts: bool, over: float) -> Disagreement | None:
        disagreeing = self._last is not None and self._last.disagrees
        self._counting = self._counting + 1 if counts else 0
        self._calm = self._calm + 1 if over < AGREES_BELOW else 0
        if not disagreeing and self._counting >= STRETCHES and worst is not None:
            self._last = Disagreement(True, worst, self._ratios[worst], _onset_s(self._recent))
            return self._last
        if disagreeing and self._calm >= CALM and worst is not None and self._last is not None:
            self._last = Disagreement(
                False, self._last.channel, self._ratios[worst], self._last.since_s
            )
            return self._last
        return None

    def snapshot(self) -> dict[str, LearnedChannel]:
        """Learned state of each channel."""
        return {name: channel.snapshot() for name, channel in self._channels.items()}

    def restore(self, snapshot: Mapping[str, LearnedChannel]) -> None:
        """Go on from a snapshot. Raises ValueError."""
        if not self._channels.keys() <= snapshot.keys():
            raise ValueError("a consistency watch of other channels")
        self.restart()
        for name, channel in self._channels.items():
            channel.restore(snapshot[name])


def _onset_s(recent: list[tuple[float, float]]) -> float:
    """Onset of large innovations (time s, normalised square), s: the foot of their sum.

    What a stretch fits anew smears a change over the whole of it; half of the level that holds in
    the end parts before from after.
    """
    squares = np.array([square for _, square in recent])
    level = max(LEAST_RATIO, 0.5 * float(squares[len(squares) // 2 :].mean()))
    climbed = np.concatenate(([0.0], np.cumsum(squares - level)))
    return recent[min(int(np.argmin(climbed)), len(recent) - 1)][0]
