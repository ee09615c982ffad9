"""Where the gap lives: over which variable it is a function, and in which interval."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..messages.samples import Floats
from .session import CHANNEL_UNITS, Integers, Rows

UNITS = {
    "motor_speed_rad_s": "rad/s",
    "motor_acceleration_rad_s2": "rad/s^2",
    "table_position_m": "m",
    "motor_angle_rad": "rad",
    "time_s": "s",
    "temperature_c": "degC",
    "direction": "1",
}
_BINS = 24
_TIME_BINS = 12
_INTERVAL_LEVEL = 0.25
"""Bins whose mean energy is above this share of the greatest belong to the interval."""
_LEAST_SHARE = 0.05


@dataclass(frozen=True, slots=True)
class Place:
    """An interval of a variable.

    Attributes:
        share: of the gap's energy that a function of the variable explains.
        energy: of the gap's energy that lies in the interval.
    """

    channel: str
    variable: str
    low: float
    high: float
    unit: str
    share: float
    energy: float


def where(channels: Mapping[str, Rows], most: int = 3) -> list[Place]:
    """The variables that explain most of the gap in each channel, the best first.

    A function of the variable, or one that turns with the direction, fitted to one half of the
    blocks of time is held against the other half: chance explains nothing there.
    """
    found = [
        place
        for channel, rows in channels.items()
        for name in rows.variables
        if name != "direction"
        for place in [_place(channel, name, rows)]
        if place is not None
    ]
    found.sort(key=lambda place: -place.share)
    kept: list[Place] = []
    for channel in CHANNEL_UNITS:
        kept += [place for place in found if place.channel == channel][:most]
    return sorted(kept, key=lambda place: -place.share)


def _place(channel: str, name: str, rows: Rows) -> Place | None:
    values = rows.variables[name]
    count = _TIME_BINS if name in ("time_s", "temperature_c") else _BINS
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, count + 1)))
    if len(edges) < 4:
        return None
    bins = np.searchsorted(edges, values, side="right").astype(np.int64) - 1
    bins = np.clip(bins, 0, len(edges) - 2)
    direction = np.sign(rows.variables["direction"])
    explained = max(
        (
            _held_out(rows, bins, sign, len(edges) - 1)
            for sign in (np.ones_like(direction), direction)
        ),
        key=lambda pair: pair[0],
    )
    if explained[0] < _LEAST_SHARE:
        return None
    energy = explained[1]
    low, high = _interval(energy)
    inside = (bins >= low) & (bins <= high)
    total = float(rows.gap @ rows.gap) or 1.0
    share = float(rows.gap[inside] @ rows.gap[inside]) / total
    return Place(
        channel, name, float(edges[low]), float(edges[high + 1]), UNITS[name], explained[0], share
    )


def _held_out(rows: Rows, bins: Integers, sign: Floats, count: int) -> tuple[float, Floats]:
    """Share of energy that one half's bin means explain in the other, and energy by bin."""
    turned = rows.gap * sign
    half = rows.block % 2 == 0
    if rows.variables["time_s"].size and count == _TIME_BINS:
        half = np.arange(len(bins)) % 2 == 0
    left = 0.0
    for train in (half, ~half):
        weight = np.bincount(bins[train], minlength=count) + 1e-9
        mean = np.bincount(bins[train], turned[train], minlength=count) / weight
        left += float(np.sum((turned[~train] - mean[bins[~train]]) ** 2))
    total = float(turned @ turned) or 1.0
    weight = np.bincount(bins, minlength=count) + 1e-9
    energy = np.bincount(bins, turned**2, minlength=count) / weight
    return 1.0 - left / total, energy


def _interval(energy: Floats) -> tuple[int, int]:
    """First and last bin around the greatest mean energy that are above the level."""
    peak = int(np.argmax(energy))
    level = _INTERVAL_LEVEL * energy[peak]
    low = high = peak
    while low > 0 and energy[low - 1] >= level:
        low -= 1
    while high < len(energy) - 1 and energy[high + 1] >= level:
        high += 1
    return low, high
