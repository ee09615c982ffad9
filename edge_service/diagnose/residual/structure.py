"""Structure of a gap: what smooth functions of the motion predict, whatever the name of its cause.

What they say of held-out blocks is no noise. Hats over speed, position, acceleration and time, also
turned with the direction, and waves over the angle claim but that like motion gives a like gap.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Self

import numpy as np

from ...messages.samples import Floats, Integers
from ...regression.run import FILTER_ORDER, Filter
from ..session.session import TORQUE_GAP, TRANSMISSION_GAP, Rows, Session

_HIGHEST_ORDER = {TORQUE_GAP: 96, TRANSMISSION_GAP: 12}
_MOST_WAVES = 4
"""Strongest orders that are kept, of those that turn with the direction and those that do not."""
_COUNTS = {"speed": 9, "place": 12, "hard": 9, "time": 8}
_PLAIN_COLUMNS, _PLAIN = 4, 30.0
"""A constant, direction, speed and acceleration come first: a ridge hardly holds them."""
_WAVE_ROWS = 20_000
_SLOW_RAD_S, _SOFT_RAD_S2 = 0.5, 20.0
"""Below these the hats over speed and acceleration lie evenly, above them by octaves."""
_LEAST_SHOWN = 0.03
"""Root mean square below which a column counts as hardly there: others rows may show it in full."""
_RIDGES = (3e-4, 1e-2, 0.3, 1e9)
"""Columns have a mean square of 1, the plainest ones a greater one; the last ridge holds all at 0,
where nothing that they say helps."""


@dataclass(frozen=True, slots=True, eq=False)
class SmoothFunctions:
    """Basis of smooth functions, spread over some rows, to be evaluated at any others.

    Attributes:
        spans: coordinate -> range in the rows that they were made for; beyond it they stay level.
        orders: of the waves over the angle, (even, turned).
        scale: of each column, (p,): its root mean square where they were made, or less.
    """

    spans: Mapping[str, tuple[float, float]]
    orders: tuple[tuple[int, ...], tuple[int, ...]]
    scale: Floats
    low_pass: Filter

    @classmethod
    def fitted(
        cls, rows: Rows, channel: str, low_pass: Filter, *, timed: bool
    ) -> tuple[Self, Floats]:
        """Basis that is to follow the gap of some rows, and its columns at these, (n, p)."""
        at = _coordinates(rows.variables)
        names = [name for name in at if timed or name != "time"]
        spans = {name: (float(at[name].min()), float(at[name].max())) for name in names}
        orders = _strongest(rows, _HIGHEST_ORDER[channel], low_pass)
        columns = cls(spans, orders, np.ones(1), low_pass).columns(rows.variables)
        scale = np.sqrt(np.mean(columns**2, axis=0))
        scale[:_PLAIN_COLUMNS] /= _PLAIN
        scale = np.maximum(scale, _LEAST_SHOWN)
        return cls(spans, orders, scale, low_pass), columns / scale

    def columns(self, variables: Mapping[str, Floats]) -> Floats:
        """Columns of the basis at some rows, (n, p)."""
        known, way = _coordinates(variables), _way(variables)[:, None]
        at = {name: np.clip(known[name], *span) for name, span in self.spans.items()}
        smooth = [_hats(at[name], *span, _COUNTS[name]) for name, span in self.spans.items()]
        fastest = _SLOW_RAD_S * np.expm1(max(map(abs, self.spans["speed"])))
        hardest = _SOFT_RAD_S2 * np.expm1(max(map(abs, self.spans["hard"])))
        speed = np.clip(variables["motor_speed_rad_s"], -fastest, fastest)
        acceleration = np.clip(variables["motor_acceleration_rad_s2"], -hardest, hardest)
        plain = np.column_stack((np.ones_like(speed), way, speed, acceleration))
        products = [speed * at["place"], acceleration * at["place"]]
        if "time" in at:
            products += [at["time"] * x for x in (speed, at["place"], at["time"] * at["place"])]
        parts = [plain, *smooth, *(way * each for each in smooth), *(x[:, None] for x in products)]
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
    rows: Rows, highest: int, low_pass: Filter
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Orders of the waves that follow the gap best, each alone: even ones, and turned ones."""
    few = rows.at(slice(None, None, max(len(rows.gap) // _WAVE_ROWS, 1)))
    rest = few.gap - float(np.mean(rows.gap))
    wave, turn = np.ones(len(rest), np.complex128), np.exp(1j * few.variables["motor_angle_rad"])
    strength = []
    for order in range(1, highest + 1):
        wave *= turn
        passed = _gain(few.variables, order, low_pass) * wave
        energy = max(float(np.sum(np.abs(passed) ** 2)), 1e-300)
        sums = passed @ np.column_stack((rest, _way(few.variables) * rest))
        strength.append(np.abs(sums) ** 2 / energy)
    ranked = np.argsort(-np.array(strength), axis=0, kind="stable")[:_MOST_WAVES] + 1
    even, turned = np.sort(ranked, axis=0).T.tolist()
    return tuple(even), tuple(turned)


def _hats(values: Floats, low: float, high: float, count: int) -> Floats:
    """Piecewise linear functions that add up to 1, (n, count)."""
    knots = np.linspace(low, high + 1e-12 + 1e-9 * abs(high), count)
    reach = knots[1] - knots[0]
    hats: Floats = np.maximum(1.0 - np.abs(values[:, None] - knots) / reach, 0.0)
    return hats


def ridge_fits(columns: Floats, values: Floats, ridges: Sequence[float]) -> Floats:
    """Coefficients of columns (n, p) that follow values (n,), held by each of some ridges, (r, p).

    Args:
        ridges: of the number of rows.
    """
    held = np.array(ridges)[:, None, None] * len(columns) * np.eye(columns.shape[1])
    normal, target = columns.T @ columns + held, (columns.T @ values)[:, None]
    return np.linalg.solve(normal, target)[..., 0].astype(np.float64)


def predicted_groups(
    rows: Rows, group: Integers, channel: str, low_pass: Filter, *, timed: bool
) -> tuple[float, Floats]:
    """Ridge that predicts each group of rows best from the others, and the prediction, (n,)."""
    found = np.zeros((len(_RIDGES), len(rows.gap)))
    for number in np.unique(group).tolist():
        mine = group == number
        if not mine.all():
            forms, known = SmoothFunctions.fitted(rows.at(~mine), channel, low_pass, timed=timed)
            asked = forms.columns(rows.at(mine).variables)
            found[:, mine] = ridge_fits(known, rows.gap[~mine], _RIDGES) @ asked.T
    best = int(np.argmin(np.sum((rows.gap - found) ** 2, axis=1)))
    return _RIDGES[best], found[best]


def predicted_structure(
    session: Session, left: Mapping[str, Floats], *, timed: bool = True
) -> dict[str, Floats]:
    """Prediction by smooth functions on blocks not fitted, by channel; 0 where none helps.

    Args:
        left: what something leaves of the gap, by channel, (n,).
        timed: functions of time are among them; otherwise of the motion alone.
    """
    low_pass, folds, predicted = session.runs[0].low_pass, session.fold, {}
    for channel, values in left.items():
        rows = replace(session.channels[channel], gap=values)
        _, best = predicted_groups(rows, folds[channel], channel, low_pass, timed=timed)
        predicted[channel] = best
    return predicted


@lru_cache(maxsize=1)
def structure_of_gap(session: Session) -> Mapping[str, Floats]:
    """Prediction of the gap itself, see `predicted_structure`; that of the last session is kept."""
    return predicted_structure(session, {name: each.gap for name, each in session.channels.items()})
