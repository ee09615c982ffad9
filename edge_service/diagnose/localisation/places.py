"""Location of the gap: over which variables it is a function, and in which intervals."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Booleans, Floats
from ..session.session import Integers, Rows
from .change_points import raised_intervals

UNITS = {
    "motor_speed_rad_s": "rad/s",
    "motor_acceleration_rad_s2": "rad/s^2",
    "table_position_m": "m",
    "motor_angle_rad": "rad",
    "time_s": "s",
    "temperature_c": "degC",
    "direction": "1",
}
FALSE_DISCOVERIES = 0.05
"""Rate of false discoveries among the variables named (Benjamini and Hochberg, 1995)."""
_OVER_FLOOR = 1.5
_SIMPLER = 0.93
"""Part of another variable's share from which on the direction alone says as much."""
_ONE_WAY = 0.8
"""Part of the energy that lies in one direction where the gap is one-sided."""
_CHUNK = 50
"""Rows that are held out together."""
_SHUFFLES = 199
_SHUFFLED_ROWS = 3000
_SHUFFLED_BLOCKS = 100
_BINS = 24
_FINE_BINS = 96
_CLOCKS = ("time_s", "temperature_c")
_LEAST_SHARE = 0.05


@dataclass(frozen=True, slots=True)
class Place:
    """Interval of a variable in which a gap lives.

    Attributes:
        share: of the gap's energy that a function of the variable explains.
        energy: of the gap's energy that lies in the interval.
        p_value: chance that a gap without regard to the variable seems to follow it as well.
    """

    channel: str
    variable: str
    low: float
    high: float
    unit: str
    share: float
    energy: float
    p_value: float


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """Rows sorted into cells of a variable.

    Attributes:
        bins: cell of each row, (n,).
        sign: 1, or the direction where the gap turns with it, (n,).
        half: which half of the stretches of time a row belongs to, (n,).
    """

    bins: Integers
    count: int
    sign: Floats
    half: Booleans

    def explained(self, gap: Floats) -> float:
        """Share of the energy of either half that the cell means of the other explain."""
        joint = self.bins + self.count * self.half
        rows = np.bincount(joint, minlength=2 * self.count).reshape(2, -1)
        sums = np.bincount(joint, gap * self.sign, minlength=2 * self.count).reshape(2, -1)
        other = (sums / np.maximum(rows, 1))[::-1]
        gained = float(np.sum(2.0 * other * sums - rows * other**2))
        return gained / (float(gap @ gap) or 1.0)

    def p_value(self, gap: Floats) -> float:
        """Chance that the gap, its blocks of time in another order, is explained as well."""
        step = -(-len(gap) // _SHUFFLED_ROWS)
        few = _Cells(self.bins[::step], self.count, self.sign[::step], self.half[::step])
        thin = gap[::step]
        reached = few.explained(thin)
        blocks = np.array_split(np.arange(len(thin)), _SHUFFLED_BLOCKS)
        random = np.random.default_rng(11)
        beaten = 0
        for _ in range(_SHUFFLES):
            order = np.concatenate([blocks[k] for k in random.permutation(len(blocks))])
            beaten += few.explained(thin[order]) >= reached
        return (1.0 + beaten) / (1.0 + _SHUFFLES)


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    channel: str
    variable: str
    rows: Rows
    share: float
    p_value: float

    @property
    def standing(self) -> float:
        return self.share / _SIMPLER if self.variable == "direction" else self.share


def where(
    channels: Mapping[str, Rows], floors: Mapping[str, float] | None = None, most: int = 3
) -> list[Place]:
    """Variables that explain most of the gap in each channel, the best first.

    A function of the variable, or one that turns with the direction, is fitted to every other
    stretch of time and held against the rest. The intervals of a variable follow one another.

    Args:
        floors: gap of a healthy axis by channel; a channel that hardly exceeds it holds no gap.
    """
    tried = [
        _tried(channel, name, rows)
        for channel, rows in channels.items()
        if rows.rms > _OVER_FLOOR * (floors or {}).get(channel, 0.0)
        for name in UNITS
    ]
    found = _real([each for each in tried if each is not None])
    found.sort(key=lambda each: -each.standing)
    kept = [
        each
        for number, each in enumerate(found)
        if sum(other.channel == each.channel for other in found[:number]) < most
    ]
    return [place for each in kept for place in _places(each)]


def _tried(channel: str, name: str, rows: Rows) -> _Found | None:
    values = rows.variables.get(name)
    if values is None:
        return None
    direction = np.sign(rows.variables["direction"])
    signs = (
        (np.ones_like(direction),) if name == "direction" else (1.0 + 0.0 * direction, direction)
    )
    bins, count = _binned(name, values)
    if count < 2:
        return None
    half = np.arange(len(bins)) // _CHUNK % 2 == 0
    cells = [_Cells(bins, count, sign, half) for sign in signs]
    share, best = max(((each.explained(rows.gap), k) for k, each in enumerate(cells)))
    if share < _LEAST_SHARE:
        return None
    return _Found(channel, name, rows, share, cells[best].p_value(rows.gap))


def _binned(name: str, values: Floats) -> tuple[Integers, int]:
    if name == "direction":
        return (values > 0.0).astype(np.int64), 2
    edges = _edges(values, _BINS // 2 if name in _CLOCKS else _BINS)
    return _bins(values, edges), len(edges) - 1


def _edges(values: Floats, count: int) -> Floats:
    edges: Floats = np.unique(np.quantile(values, np.linspace(0.0, 1.0, count + 1)))
    return edges


def _bins(values: Floats, edges: Floats) -> Integers:
    bins = np.searchsorted(edges, values, side="right").astype(np.int64) - 1
    return np.clip(bins, 0, max(len(edges) - 2, 0))


def _real(tried: Sequence[_Found]) -> list[_Found]:
    """Findings among which the rate of false discoveries is bounded."""
    ranked = sorted(tried, key=lambda each: each.p_value)
    passed = [
        number
        for number, each in enumerate(ranked, start=1)
        if each.p_value <= FALSE_DISCOVERIES * number / len(ranked)
    ]
    return ranked[: max(passed, default=0)]


def _places(found: _Found) -> list[Place]:
    rows, name = found.rows, found.variable
    values, square = rows.variables[name], rows.gap**2
    total = float(square.sum()) or 1.0
    places = []
    for low, high in _intervals(name, values, square):
        inside = (values >= low) & (values <= high)
        energy = float(square[inside].sum()) / total
        places.append(
            Place(found.channel, name, low, high, UNITS[name], found.share, energy, found.p_value)
        )
    return places


def _intervals(name: str, values: Floats, square: Floats) -> list[tuple[float, float]]:
    if name == "direction":
        forth = float(square[values > 0.0].sum()) / (float(square.sum()) or 1.0)
        return [(-1.0 if forth < _ONE_WAY else 0.0, 1.0 if forth > 1.0 - _ONE_WAY else 0.0)]
    edges = _edges(values, _FINE_BINS)
    bins = _bins(values, edges)
    weight = np.bincount(bins, minlength=len(edges) - 1).astype(np.float64)
    level = np.bincount(bins, square, minlength=len(edges) - 1) / np.maximum(weight, 1.0)
    return [
        (float(edges[low]), float(edges[high])) for low, high in raised_intervals(level, weight)
    ]
