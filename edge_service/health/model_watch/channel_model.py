"""Linear model of one channel, learned from stretches of motion, and its innovations."""

import math
from dataclasses import dataclass

import numpy as np

from ...messages.features import Phase
from ...messages.samples import Floats
from ...messages.stored import StoredFloats

CHANNELS = ("torque_nm", "transmission_m")
LEARNED = 8
"""Stretches that the model is learned from before the first is compared."""
COMPARED = 8
"""Stretches, not learned from, that the limits rest on."""
MOST_LEARNED = 5000
"""Then the model stands still."""
LEAST_RATIO = 3.0
"""Mean squared innovation, over that of an average stretch, from which on a stretch counts."""
BEYOND_WORST = 1.5
"""The same over that of the worst stretch so far."""
LEAST_TORQUE_SHARE = 0.03
"""Of the torque's root mean square: a smaller innovation is immaterial."""
LEAST_TRANSMISSION_M = 3e-7
LEAST_WIND_UP_SHARE = 0.25
"""Of what friction winds up: so much of it a new lubricant takes away or brings back."""
_FOLLOWED = {"torque_nm": 3, "transmission_m": 6}
"""Leading regressors that the estimator follows by itself, payload and uneven growth among them."""
_REGRESSORS = {"torque_nm": 10, "transmission_m": 9}
_RIDGE = 1e-6
_WILD = 1e3
_SPEED_RAD_S, _ACCELERATION_RAD_S2, _POSITION_M = 100.0, 1000.0, 0.4
_SLOW_RAD_S = (2.0, 8.0)


def torque_row(phase: Phase, direction: float, ratio_m_per_rad: float) -> tuple[Floats, float]:
    """Regressors (10,), the followed ones first, and the torque, N m."""
    speed, there = phase.speed_rad_s / _SPEED_RAD_S, _place(phase, ratio_m_per_rad)
    slow = [direction * math.exp(-abs(phase.speed_rad_s) / scale) for scale in _SLOW_RAD_S]
    row = [direction, speed, phase.acceleration_rad_s2 / _ACCELERATION_RAD_S2, 1.0]
    row += [speed * abs(speed), *slow, there, direction * there, direction * there**2]
    return np.array(row), phase.torque_nm


def transmission_row(
    phase: Phase, direction: float, ratio_m_per_rad: float
) -> tuple[Floats, float]:
    """Regressors (9,), the followed ones first, and table less motor, m."""
    speed, there = phase.speed_rad_s / _SPEED_RAD_S, _place(phase, ratio_m_per_rad)
    push = phase.acceleration_rad_s2 / _ACCELERATION_RAD_S2
    row = [1.0, there, there**2, there**3, push, push * there, direction, speed, direction * there]
    return np.array(row), phase.table_m - phase.angle_rad * ratio_m_per_rad


def _place(phase: Phase, ratio_m_per_rad: float) -> float:
    """Position of the table; the angle, whose zero a restart may shift, stands in for it."""
    known = math.isfinite(phase.table_m)
    return (phase.table_m if known else phase.angle_rad * ratio_m_per_rad) / _POSITION_M


ROWS = {"torque_nm": torque_row, "transmission_m": transmission_row}


@dataclass(frozen=True, slots=True, eq=False)
class LearnedChannel:
    """Learned state of a channel.

    Attributes:
        gram, cross: normal equations, (p, p) and (p,); empty before the first stretch.
        numbers: stretches learned from and compared, their mean and worst mean square, and the mean
            square of the channel itself.
    """

    gram: StoredFloats
    cross: StoredFloats
    numbers: tuple[int, int, float, float, float]


class ChannelModel:
    """Model of one channel, the stretch that is being collected, and what stretches were like."""

    def __init__(self, name: str) -> None:
        self._name, self._followed = name, _FOLLOWED[name]
        self._is_torque = name == "torque_nm"
        self.square = 0.0
        self.gram: Floats = np.zeros((0, 0))
        self.cross: Floats = np.zeros(0)
        self.learned = 0
        self.compared = 0
        self.mean = 0.0
        self.worst = 0.0
        self._rows: list[Floats] = []
        self._values: list[float] = []
        self._times: list[float] = []

    def add(self, row: Floats, value: float, time_s: float) -> None:
        """Take a phase into the stretch."""
        if math.isfinite(value) and np.isfinite(row).all():
            self._rows.append(row)
            self._values.append(value)
            self._times.append(time_s)

    def drop(self) -> None:
        """Begin the stretch anew."""
        self._rows, self._values, self._times = [], [], []

    def innovations(self) -> Floats | None:
        """Normalised squares over the stretch, (n,), in the unit of the channel squared.

        A regressor that was never seen before widens what is expected: e^2 / (1 + x' G^-1 x).
        """
        if self.gram.size == 0 or len(self._rows) < 4 * self._followed:
            return None
        rows, values = self._unfollowed()
        gram = self._ridged()
        left = values - rows @ np.linalg.solve(gram, self.cross)
        leverage = np.einsum("ij,ji->i", rows, np.linalg.solve(gram, rows.T))
        squares: Floats = left**2 / (1.0 + np.clip(leverage, 0.0, _WILD))
        return squares * len(squares) / (len(squares) - self._followed)

    def _unfollowed(self) -> tuple[Floats, Floats]:
        """Other regressors (n, p) and values (n,), without what the followed ones make of them."""
        rows, values = np.array(self._rows), np.array(self._values)
        followed, others = rows[:, : self._followed], rows[:, self._followed :]
        both = np.column_stack((others, values))
        both = both - followed @ np.linalg.lstsq(followed, both, rcond=None)[0]
        return both[:, :-1], both[:, -1]

    @property
    def times_s(self) -> Floats:
        """Of the phases of the stretch, s."""
        return np.array(self._times)

    @property
    def limit(self) -> float:
        """Mean square from which on a stretch counts; infinite while that is not known."""
        if self.compared < COMPARED:
            return math.inf
        return max(LEAST_RATIO * self.mean, BEYOND_WORST * self.worst, self._material)

    @property
    def _material(self) -> float:
        """Mean square up to which a change does not matter."""
        if self._is_torque:
            return LEAST_TORQUE_SHARE**2 * self.square
        return max(LEAST_TRANSMISSION_M, LEAST_WIND_UP_SHARE * abs(self._wind_up_m)) ** 2

    @property
    def _wind_up_m(self) -> float:
        """Learned shift of the table by the direction of motion, in mid-stroke, m."""
        by_direction, _, along = np.linalg.solve(self._ridged(), self.cross)
        return float(by_direction + along)

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
        """Go on from a snapshot; learn anew from one of other regressors. Raises ValueError."""
        gram, cross = snapshot.gram, snapshot.cross
        if cross.size:
            if gram.shape != (cross.size, cross.size):
                raise ValueError("a consistency watch of another version")
            if cross.size != _REGRESSORS[self._name] - self._followed:
                return  # an older version followed less
            self.gram, self.cross = gram, cross
        self.learned, self.compared, self.mean, self.worst, self.square = snapshot.numbers
