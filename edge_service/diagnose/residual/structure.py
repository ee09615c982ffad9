"""Structure of a gap: what smooth functions of the motion predict, whatever the name of its cause.

What a library leaves may be noise, or structure that no entry has: what smooth functions say of
held-out blocks is structure. Hats over speed, position, acceleration and time, each also turned
with the direction, and the strongest waves over the angle claim nothing but that the same motion
gives the same gap.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np

from ...messages.samples import Floats
from ...regression.run import FILTER_ORDER, Filter
from ..session.session import FOLDS, TORQUE_GAP, TRANSMISSION_GAP, Session

_HIGHEST_ORDER = {TORQUE_GAP: 96, TRANSMISSION_GAP: 12}
_MOST_WAVES = 4
"""Strongest orders that are kept, of those that turn with the direction and those that do not."""
_COUNTS = {"speed": 9, "place": 12, "hard": 9, "time": 8}
_PLAIN_COLUMNS, _PLAIN = 4, 30.0
"""A constant, direction, speed and acceleration come first: a ridge hardly holds them."""
_WAVE_ROWS = 20_000
_SLOW_RAD_S, _SOFT_RAD_S2 = 0.5, 20.0
"""Below these the hats over speed and acceleration lie evenly, above them by octaves."""
_RIDGES = (3e-4, 1e-2, 0.3)
"""Of the number of rows: columns have a mean square of 1, the plainest ones a greater one."""


@dataclass(frozen=True, slots=True, eq=False)
class SmoothFunctions:
    """Basis of smooth functions, spread over some rows, to be evaluated at any others.

    Attributes:
        spans: coordinate -> range in the rows that they were made for; beyond it they stay level.
        orders: of the waves over the angle, (even, turned).
        scale: of each column, (p,): its root mean square where they were made, or less.
        timed: forms over time are among them.
    """

    spans: Mapping[str, tuple[float, float]]
    orders: tuple[tuple[int, ...], tuple[int, ...]]
    scale: Floats
    low_pass: Filter
    timed: bool

    @classmethod
    def fitted(
        cls,
        variables: Mapping[str, Floats],
        values: Floats,
        channel: str,
        low_pass: Filter,
        *,
        timed: bool = True,
    ) -> tuple[Self, Floats]:
        """Basis for rows of some variables, (n,) each, and its columns at these, (n, p).

        Args:
            values: what is to be followed, (n,).
        """
        spans = {
            name: (float(each.min()), float(each.max()))
            for name, each in _coordinates(variables).items()
        }
        orders = _strongest(variables, values, _HIGHEST_ORDER[channel], low_pass)
        columns = cls(spans, orders, np.ones(1), low_pass, timed).columns(variables)
        scale = np.sqrt(np.mean(columns**2, axis=0))
        scale[:_PLAIN_COLUMNS] /= _PLAIN
        scale = np.where(scale > 0.0, scale, 1.0)
        return cls(spans, orders, scale, low_pass, timed), columns / scale

    def columns(self, variables: Mapping[str, Floats]) -> Floats:
        """Columns of the basis at some rows, (n, p)."""
        at = {
            name: np.clip(each, *self.spans[name]) for name, each in _coordinates(variables).items()
        }
        way = _way(variables)[:, None]
        smooth = [
            _hats(at[name], *self.spans[name], count)
            for name, count in _COUNTS.items()
            if self.timed or name != "time"
        ]
        fastest = _SLOW_RAD_S * np.expm1(max(map(abs, self.spans["speed"])))
        hardest = _SOFT_RAD_S2 * np.expm1(max(map(abs, self.spans["hard"])))
        speed = np.clip(variables["motor_speed_rad_s"], -fastest, fastest)
        acceleration = np.clip(variables["motor_acceleration_rad_s2"], -hardest, hardest)
        plain = np.column_stack((np.ones_like(speed), way, speed, acceleration))
        products = [speed * at["place"], acceleration * at["place"]]
        if self.timed:
            products += [at["time"] * x for x in (speed, at["place"], at["time"] * at["place"])]
        parts = [plain, *smooth, *(way * each for each in smooth)]
        parts += [x[:, None] for x in products]
        even, turned = self.orders
        parts += [_wave(variables, order, self.low_pass) for order in even]
        parts += [way * _wave(variables, order, self.low_pass) for order in turned]
        columns: Floats = np.column_stack(parts) / self.scale
        return columns


def _coordinates(variables: Mapping[str, Floats]) -> dict[str, Floats]:
    """Variables as the hats are spread over them: fine where friction and inertia change most."""
    speed, acceleration = variables["motor_speed_rad_s"], variables["motor_acceleration_rad_s2"]
    return {
        "speed": np.log1p(np.abs(speed) / _SLOW_RAD_S),
        "place": variables["table_position_m"],
        "hard": np.sign(acceleration) * np.log1p(np.abs(acceleration) / _SOFT_RAD_S2),
        "time": variables["time_s"],
    }


def _way(variables: Mapping[str, Floats]) -> Floats:
    return np.where(variables["direction"] < 0.0, -1.0, 1.0)


def _wave(variables: Mapping[str, Floats], order: int, low_pass: Filter) -> Floats:
    """Sine and cosine of an order, as weak as the low-pass leaves them at each speed, (n, 2)."""
    gain = _gain(variables, order, low_pass)
    turned = order * variables["motor_angle_rad"]
    return np.column_stack((gain * np.sin(turned), gain * np.cos(turned)))


def _gain(variables: Mapping[str, Floats], order: int, low_pass: Filter) -> Floats:
    """Part of an order's amplitude that passes at each speed, (n,)."""
    return passed_at(order * np.abs(variables["motor_speed_rad_s"]) / (2.0 * np.pi), low_pass)


def passed_at(frequency_hz: Floats, low_pass: Filter) -> Floats:
    """Part of an amplitude that passes at some frequencies, (n,)."""
    if len(low_pass.taps) == 1:
        return np.ones_like(frequency_hz)
    share = (frequency_hz / low_pass.cutoff_hz) ** 2
    passed: Floats = 1.0 / (1.0 + share**FILTER_ORDER)
    return passed


def _strongest(
    variables: Mapping[str, Floats], values: Floats, highest: int, low_pass: Filter
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Orders of the waves that follow the values best, each alone: even ones, and turned ones."""
    step = max(len(values) // _WAVE_ROWS, 1)
    few = {name: each[::step] for name, each in variables.items()}
    rest = values[::step] - float(np.mean(values))
    way = _way(few)
    wave, turn = np.ones(len(rest), np.complex128), np.exp(1j * few["motor_angle_rad"])
    even, turned = [], []
    for order in range(1, highest + 1):
        wave *= turn
        passed = _gain(few, order, low_pass) * wave
        energy = max(float(np.sum(np.abs(passed) ** 2)), 1e-300)
        even.append(abs(complex(passed @ rest)) ** 2 / energy)
        turned.append(abs(complex(passed @ (way * rest))) ** 2 / energy)
    return _leading(even), _leading(turned)


def _leading(strength: Sequence[float]) -> tuple[int, ...]:
    """Orders of the strongest of waves that begin with order 1."""
    ranked = np.argsort(-np.array(strength), kind="stable")[:_MOST_WAVES]
    return tuple(sorted(int(k) + 1 for k in ranked))


def _hats(values: Floats, low: float, high: float, count: int) -> Floats:
    """Piecewise linear functions that add up to 1, (n, count)."""
    knots = np.linspace(low, high + 1e-12 + 1e-9 * abs(high), count)
    reach = knots[1] - knots[0]
    hats: Floats = np.maximum(1.0 - np.abs(values[:, None] - knots) / reach, 0.0)
    return hats


def predicted_structure(
    session: Session, left: Mapping[str, Floats], *, timed: bool = True
) -> dict[str, Floats]:
    """Prediction of `left` by smooth functions on blocks that they were not fitted to, by channel.

    It is 0 in a channel where nothing follows better.

    Args:
        left: what something leaves of the gap, by channel, (n,).
        timed: functions of time are among them; otherwise of the motion alone.
    """
    low_pass, folds, predicted = session.runs[0].low_pass, session.fold, {}
    for channel, values in left.items():
        rows = session.channels[channel]
        fold = folds[channel]
        found = {ridge: np.zeros(len(values)) for ridge in _RIDGES}
        for k in range(FOLDS):
            mine = fold == k
            if not mine.any() or mine.all():
                continue
            here, there = rows.at(mine).variables, rows.at(~mine).variables
            forms, known = SmoothFunctions.fitted(
                there, values[~mine], channel, low_pass, timed=timed
            )
            asked = forms.columns(here)
            gram, cross = known.T @ known, known.T @ values[~mine]
            for ridge in _RIDGES:
                held = gram + ridge * len(known) * np.eye(len(gram))
                beta = np.linalg.solve(held, cross)
                found[ridge][mine] = asked @ beta
        best = min(found.values(), key=lambda each: float(np.sum((values - each) ** 2)))
        helps = np.sum((values - best) ** 2) < np.sum(values**2)
        predicted[channel] = best if helps else np.zeros(len(values))
    return predicted


@lru_cache(maxsize=1)
def structure_of_gap(session: Session) -> Mapping[str, Floats]:
    """Prediction of the gap itself, see `predicted_structure`; that of the last session is kept."""
    return predicted_structure(session, {name: each.gap for name, each in session.channels.items()})
