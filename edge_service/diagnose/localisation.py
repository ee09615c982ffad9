"""Location of the gap: over which variables it is a function, and in which intervals."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import ndimage, stats

from ..messages.samples import Booleans, Floats, Integers
from .result import Place
from .session.recordings import STILL_RAD_S
from .session.session import Rows

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
_LEAST_WARMING_K = 0.5  # a sensor's own noise is no warmth
_LEAST_SHARE = 0.05
_MOST_VARIABLES = 3
_NEIGHBOURS, _ROUNDS, _MOST_INTERVALS = 5, 30, 4


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """Rows sorted into cells of a variable."""

    bins: Integers  # cell of each row, (n,)
    count: int
    sign: Floats  # 1, or the direction where the gap turns with it, (n,)
    half: Booleans  # which half of the stretches of time a row belongs to, (n,)

    def explained(self, gap: Floats) -> float:
        """Share of the energy of either half that the cell means of the other explain."""
        joint, size = self.bins + self.count * self.half, 2 * self.count
        rows = np.bincount(joint, minlength=size).reshape(2, -1)
        sums = np.bincount(joint, gap * self.sign, minlength=size).reshape(2, -1)
        other = (sums / np.maximum(rows, 1))[::-1]
        gained = float(np.sum(2.0 * other * sums - rows * other**2))
        return gained / (float(gap @ gap) or 1.0)

    def p_value(self, gap: Floats) -> float:
        """Chance that the gap, its blocks of time in another order, is explained as well."""
        step, random = -(-len(gap) // _SHUFFLED_ROWS), np.random.default_rng(11)
        few = _Cells(self.bins[::step], self.count, self.sign[::step], self.half[::step])
        blocks = np.array_split(gap[::step], _SHUFFLED_BLOCKS)
        orders = (random.permutation(len(blocks)) for _ in range(_SHUFFLES))
        others = (few.explained(np.concatenate([blocks[k] for k in each])) for each in orders)
        reached = few.explained(gap[::step])
        return (1.0 + sum(each >= reached for each in others)) / (1.0 + _SHUFFLES)


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """Variable that a gap seems to follow."""

    channel: str
    variable: str
    rows: Rows
    share: float
    p_value: float  # chance that a gap without regard to the variable seems to follow it as well

    @classmethod
    def tried(cls, channel: str, name: str, rows: Rows) -> "_Found | None":
        """Fit of a function of a variable, or one that turns with the direction, if any helps."""
        values = rows.variables.get(name)
        if values is None or (name == "temperature_c" and np.ptp(values) < _LEAST_WARMING_K):
            return None
        signs = [np.ones(len(values)), np.sign(rows.variables["direction"])]
        edges, bins = _cells(values, _BINS // 2 if name in _CLOCKS else _BINS)
        count = len(edges) - 1
        if name == "direction":
            signs, bins, count = signs[:1], (values > 0.0).astype(np.int64), 2
        if count < 2:
            return None
        half = np.arange(len(bins)) // _CHUNK % 2 == 0
        cells = [_Cells(bins, count, sign, half) for sign in signs]
        share, best = max(((each.explained(rows.gap), k) for k, each in enumerate(cells)))
        if share < _LEAST_SHARE:
            return None
        return cls(channel, name, rows, share, cells[best].p_value(rows.gap))

    def places(self) -> list[Place]:
        """Intervals of the variable in which the gap lives."""
        values, square = self.rows.variables[self.variable], self.rows.gap**2
        total = float(square.sum()) or 1.0
        if self.variable == "direction":
            forth = float(square[values > 0.0].sum()) / total
            spans = [(-1.0 if forth < _ONE_WAY else 0.0, 1.0 if forth > 1.0 - _ONE_WAY else 0.0)]
        else:
            edges, bins = _cells(values, _FINE_BINS)
            weight = np.bincount(bins, minlength=len(edges) - 1).astype(np.float64)
            level = np.bincount(bins, square, minlength=len(weight)) / np.maximum(weight, 1.0)
            raised = raised_intervals(level, weight)
            spans = [(float(edges[low]), float(edges[high])) for low, high in raised]
        return [
            Place(
                channel=self.channel,
                variable=self.variable,
                low=low,
                high=high,
                unit=UNITS[self.variable],
                share=self.share,
                energy=float(square[(values >= low) & (values <= high)].sum()) / total,
            )
            for low, high in spans
        ]


def where(channels: Mapping[str, Rows], floors: Mapping[str, float] | None = None) -> list[Place]:
    """Variables that explain most of the gap in each channel, the best first.

    A function of the variable, or one that turns with the direction, is fitted to every other
    stretch of time and held against the rest; the rate of false discoveries is bounded.

    Args:
        floors: gap of a healthy axis by channel; a channel that hardly exceeds it holds no gap.
    """
    tried = []
    for channel, rows in channels.items():
        if rows.rms > _OVER_FLOOR * (floors or {}).get(channel, 0.0):
            # where the axis happens to stand, many rows are alike: that is no place of the gap
            moving = np.abs(rows.variables["motor_speed_rad_s"]) > STILL_RAD_S
            moved = rows.at(moving) if moving.any() else rows
            tried += [_Found.tried(channel, name, moved) for name in UNITS]
    found = [each for each in tried if each is not None]
    chances = stats.false_discovery_control([each.p_value for each in found]) if found else ()
    known = [each for each, p in zip(found, chances, strict=True) if p <= FALSE_DISCOVERIES]
    known.sort(key=lambda each: -each.share / (_SIMPLER if each.variable == "direction" else 1.0))
    named = [x for c in channels for x in [k for k in known if k.channel == c][:_MOST_VARIABLES]]
    return [place for each in known if each in named for place in each.places()]


def _cells(values: Floats, count: int) -> tuple[Floats, Integers]:
    """Edges of at most `count` cells that hold as many values (n,), and the cell of each, (n,)."""
    edges: Floats = np.unique(np.quantile(values, np.linspace(0.0, 1.0, count + 1)))
    bins = np.searchsorted(edges, values, side="right").astype(np.int64) - 1
    return edges, np.clip(bins, 0, max(len(edges) - 2, 0))


def raised_intervals(level: Floats, weight: Floats) -> list[tuple[int, int]]:
    """Half-open intervals [i, j) of cells whose level is raised, the strongest first.

    Raised cells are nearer to the mean of the raised ones than to that of the others (Ridler and
    Calvard, 1978), among neighbours that mostly are. `level`, `weight`: of each cell, (n,).
    """
    smooth = ndimage.median_filter(level, _NEIGHBOURS, mode="nearest")
    bound = float(np.average(smooth, weights=weight))
    for _ in range(_ROUNDS):
        above = smooth > bound
        if not above.any() or above.all():
            return [(0, len(level))]
        means = (np.average(smooth[at], weights=weight[at]) for at in (above, ~above))
        bound = 0.5 * float(sum(means))
    ends = np.flatnonzero(np.diff(np.concatenate(([0], smooth > bound, [0]))))
    spans = [(int(low), int(high)) for low, high in ends.reshape(-1, 2)]
    spans.sort(key=lambda span: -float((level * weight)[slice(*span)].sum()))
    return spans[:_MOST_INTERVALS]
