"""Consistency of an axis with its behaviour when it was learned: innovations over sustained motion.

Two channels are watched: torque, and table against motor. Of each a linear model is learned from
ordinary work; afterwards the normalised innovation squared of every stretch of motion is held
against those of the stretches that came before. What the estimator follows by itself, or what
follows from it (drag, viscous friction, growth of the screw, stiffness of the nut), is fitted anew
in every stretch and so never counts; neither does what is sure but too small to matter.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..messages.features import FeatureBlock, Phase
from ..messages.health import Consistency, ConsistencyState
from ..messages.samples import Floats
from ..messages.stored import StoredFloats
from ..regression import FALSE_ALARMS, chance_of_misfit

STRETCH_S = 8.0
"""Steady motion that one innovation statistic is taken over, s."""
STRETCHES = 3
"""So many in a row must count before model and axis disagree."""
CALM = 3
"""So many in a row must not before they agree again."""
AGREES_FROM = 0.05
"""Chance from which on a stretch agrees again."""
_LEAST_STEADY_S = 0.02

CHANNELS = ("torque_nm", "transmission_m")
LEARNED = 8
"""Stretches that the model is learned from before the first is compared."""
COMPARED = 8
"""Stretches, not learned from, that the floor rests on."""
MOST_LEARNED = 5000
"""Then the model stands still."""
LEAST_TORQUE_SHARE = 0.03
"""Of the torque's root mean square: so large an innovation is tolerated."""
LEAST_TRANSMISSION_M = 3e-7
LEAST_WIND_UP_SHARE = 0.25
"""Of what friction winds up: so much of it a new lubricant takes away or brings back."""
_FOLLOWED = {"torque_nm": 3, "transmission_m": 6}
"""Leading regressors that the estimator follows by itself, payload and uneven growth among them."""
_UNFOLLOWED = {"torque_nm": 7, "transmission_m": 3}
_RIDGE = 1e-6
_WILD = 1e3
_SPEED_RAD_S, _ACCELERATION_RAD_S2, _POSITION_M = 100.0, 1000.0, 0.4
_SLOW_RAD_S = (2.0, 8.0)
CHANNEL_WORDS = {"torque_nm": "the torque", "transmission_m": "the table against the motor"}


def _torque_row(phase: Phase, direction: float, ratio_m_per_rad: float) -> tuple[Floats, float]:
    """Regressors (10,), the followed ones first, and the torque, N m."""
    speed, there = phase.speed_rad_s / _SPEED_RAD_S, _place(phase, ratio_m_per_rad)
    slow = [direction * math.exp(-abs(phase.speed_rad_s) / scale) for scale in _SLOW_RAD_S]
    row = [direction, speed, phase.acceleration_rad_s2 / _ACCELERATION_RAD_S2, 1.0]
    row += [speed * abs(speed), *slow, there, direction * there, direction * there**2]
    return np.array(row), phase.torque_nm


def _stretch_row(phase: Phase, direction: float, ratio_m_per_rad: float) -> tuple[Floats, float]:
    """Regressors (9,), the followed ones first, and table less motor, m."""
    speed, there = phase.speed_rad_s / _SPEED_RAD_S, _place(phase, ratio_m_per_rad)
    push = phase.acceleration_rad_s2 / _ACCELERATION_RAD_S2
    row = [1.0, there, there**2, there**3, push, push * there, direction, speed, direction * there]
    return np.array(row), phase.table_m - phase.angle_rad * ratio_m_per_rad


def _place(phase: Phase, ratio_m_per_rad: float) -> float:
    """Position of the table; the angle, whose zero a restart may shift, stands in for it."""
    known = math.isfinite(phase.table_m)
    return (phase.table_m if known else phase.angle_rad * ratio_m_per_rad) / _POSITION_M


_ROWS = {"torque_nm": _torque_row, "transmission_m": _stretch_row}


@dataclass(frozen=True, slots=True, eq=False)
class LearnedChannel:
    """Learned state of a channel."""

    # gram, cross: normal equations, (p, p) and (p,); empty before the first stretch
    gram: StoredFloats
    cross: StoredFloats
    # stretches learned from and compared, their mean and worst mean square, and the mean square of
    # the channel itself
    numbers: tuple[int, int, float, float, float]


class ChannelModel:
    """Model of one channel, the stretch that is being collected, and what stretches were like."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._followed, self._unfollowed_count = _FOLLOWED[name], _UNFOLLOWED[name]
        self.gram: Floats = np.zeros((0, 0))
        self.cross: Floats = np.zeros(0)
        self.learned, self.compared, self.mean, self.worst, self.square = 0, 0, 0.0, 0.0, 0.0
        self.drop()

    def add(self, row: Floats, value: float) -> None:
        """Take a phase into the stretch."""
        if math.isfinite(value) and np.isfinite(row).all():
            self._rows.append(row)
            self._values.append(value)

    def drop(self) -> None:
        """Begin the stretch anew."""
        self._rows: list[Floats] = []
        self._values: list[float] = []

    def mean_innovation(self) -> float | None:
        """Mean normalised square over the stretch, in the unit of the channel squared.

        A regressor that was never seen before widens what is expected: e^2 / (1 + x' G^-1 x).
        """
        if self.gram.size == 0 or len(self._rows) < 4 * self._followed:
            return None
        rows, values = self._unfollowed()
        gram = self._ridged()
        left = values - rows @ np.linalg.solve(gram, self.cross)
        leverage = np.einsum("ij,ji->i", rows, np.linalg.solve(gram, rows.T))
        squares: Floats = left**2 / (1.0 + np.clip(leverage, 0.0, _WILD))
        return float(np.sum(squares)) / (squares.size - self._followed)

    def _unfollowed(self) -> tuple[Floats, Floats]:
        """Other regressors (n, p) and values (n,), without what the followed ones make of them."""
        rows, values = np.array(self._rows), np.array(self._values)
        followed, others = rows[:, : self._followed], rows[:, self._followed :]
        both = np.column_stack((others, values))
        both = both - followed @ np.linalg.lstsq(followed, both, rcond=None)[0]
        return both[:, :-1], both[:, -1]

    def chance(self, mean_square: float) -> float:
        """Chance that a healthy axis, with floor and tolerance, leaves as much in a stretch.

        It is that of a diagnosis (`chance_of_misfit`); the floor is the worst stretch so far.
        """
        if self._name == "torque_nm":
            tolerated = LEAST_TORQUE_SHARE**2 * self.square
        else:  # the shift of the table by the direction of motion, in mid-stroke
            by_direction, _, along = np.linalg.solve(self._ridged(), self.cross)
            wind_up_m = float(by_direction + along)
            tolerated = max(LEAST_TRANSMISSION_M, LEAST_WIND_UP_SHARE * abs(wind_up_m)) ** 2
        return chance_of_misfit(mean_square, self.worst + tolerated, len(self._rows))

    def _ridged(self) -> Floats:
        ridged: Floats = self.gram + _RIDGE * np.diag(np.maximum(np.diag(self.gram), _RIDGE))
        return ridged

    def accept(self, mean_square: float | None) -> None:
        """The stretch is as it should be: learn from it."""
        if mean_square is not None and self.learned >= LEARNED:
            self.compared += 1
            self.mean += (mean_square - self.mean) / self.compared
            self.worst = max(self.worst, mean_square)
        if self.learned < MOST_LEARNED and len(self._rows) >= 4 * self._followed:
            rows, values = self._unfollowed()
            if self.gram.size == 0:
                self.gram, self.cross = np.zeros((rows.shape[1],) * 2), np.zeros(rows.shape[1])
            self.gram = self.gram + rows.T @ rows
            self.cross = self.cross + rows.T @ values
            self.learned += 1
            self.square += (float(np.mean(np.square(self._values))) - self.square) / self.learned

    def snapshot(self) -> LearnedChannel:
        """Learned state."""
        numbers = (self.learned, self.compared, self.mean, self.worst, self.square)
        return LearnedChannel(self.gram, self.cross, numbers)

    def restore(self, snapshot: LearnedChannel) -> None:
        """Go on from a snapshot. Raises ValueError."""
        size = snapshot.cross.size
        if snapshot.gram.size != size**2 or size not in (0, self._unfollowed_count):
            raise ValueError("a consistency watch of another version")
        self.gram, self.cross = snapshot.gram.reshape(size, size), snapshot.cross
        self.learned, self.compared, self.mean, self.worst, self.square = snapshot.numbers


@dataclass(frozen=True, slots=True)
class Disagreement:
    """A change of the verdict."""

    disagrees: bool  # what it changed to
    channel: str  # where the innovations grew most
    ratio: float  # how many times the expected they are
    since_s: float  # beginning of the first stretch that counted, on the axis' clock, s


class ConsistencyWatch:
    """Watches one axis; its torque alone where the way per angle is not known."""

    def __init__(self, ratio_m_per_rad: float | None) -> None:
        self._ratio = ratio_m_per_rad
        self.restart()

    def restart(self) -> None:
        """Learn anew: the axis is another one from now on."""
        names = CHANNELS if self._ratio is not None else CHANNELS[:1]
        self._channels = {name: ChannelModel(name) for name in names}
        self._steady_s = 0.0
        self._begun_s = self._newest_s = -math.inf
        self._counting = self._calm = 0
        self._since_s = 0.0
        self._now: Disagreement | None = None
        self._ratios: dict[str, float] = {}

    def add(self, block: FeatureBlock) -> Disagreement | None:
        """Take an interval in; what changed, if anything."""
        if block.time_s < self._newest_s:
            self._begin_stretch()  # a new clock
            self._counting = 0
        self._newest_s = block.time_s
        if not block.usable or block.steady_direction == 0.0:
            return None
        if self._steady_s == 0.0:
            self._begun_s = block.time_s
        for phase in block.phases:
            if phase.steady_s >= _LEAST_STEADY_S:
                for name, channel in self._channels.items():
                    channel.add(*_ROWS[name](phase, block.steady_direction, self._ratio or 1.0))
        self._steady_s += sum(phase.steady_s for phase in block.phases)
        return self._end_stretch() if self._steady_s >= STRETCH_S else None

    def shown(self) -> Consistency:
        """The verdict for people; `add` has returned when it began."""
        if self._now is not None:
            state, channel = ConsistencyState.DISAGREES, self._now.channel
            return Consistency(state=state, ratio=self._ratios, channel=channel)
        learned = [each for each in self._channels.values() if each.learned]
        known = bool(learned) and all(each.compared >= COMPARED for each in learned)
        state = ConsistencyState.AGREES if known else ConsistencyState.LEARNING
        return Consistency(state=state, ratio=self._ratios)

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

    def _begin_stretch(self) -> None:
        for channel in self._channels.values():
            channel.drop()
        self._steady_s = 0.0

    def _end_stretch(self) -> Disagreement | None:
        """Compare a stretch with those before, and learn from it; the change, if any."""
        means = {name: each.mean_innovation() for name, each in self._channels.items()}
        chances, self._ratios = dict[str, float](), {}
        for name, mean in means.items():
            channel = self._channels[name]
            if mean is not None and channel.compared >= COMPARED:
                chances[name] = channel.chance(mean)
            if mean is not None and channel.mean > 0.0:
                self._ratios[name] = float(f"{mean / channel.mean:.3g}")
        worst = min(chances, key=lambda name: chances[name], default=None)
        counts = worst is not None and chances[worst] < FALSE_ALARMS
        change = None if worst is None else self._change(worst, chances[worst])
        if not counts and self._now is None:
            for name, channel in self._channels.items():
                channel.accept(means[name])
        self._begin_stretch()
        return change

    def _change(self, worst: str, chance: float) -> Disagreement | None:
        self._counting = self._counting + 1 if chance < FALSE_ALARMS else 0
        self._calm = self._calm + 1 if chance > AGREES_FROM else 0
        if self._counting == 1:
            self._since_s = self._begun_s
        ratio = self._ratios[worst]
        if self._now is None and self._counting >= STRETCHES:
            self._now = Disagreement(True, worst, ratio, self._since_s)
            return self._now
        if self._now is not None and self._calm >= CALM:
            over_now, self._now = replace(self._now, disagrees=False, ratio=ratio), None
            return over_now
        return None
