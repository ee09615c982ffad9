"""Runs of one repeated value with the travel meanwhile; channels that hold values or are coarse."""

from typing import NamedTuple

import numpy as np

from ...messages.row_faults import THETA, U, X
from ...messages.samples import Floats
from ...messages.stored import Number
from ...models.compiled import compiled

LEAST_ROWS = 4
"""Rows from which a value counts as repeated; a slow channel holds each for long."""
FORGET = 1.0 + 1.0 / 256.0
"""Growth of the least step per interval: a channel may become coarser."""
_LEAST_LEAPS, _KEPT = 5, 0.75
HELD_SHARE = 0.3
"""Of the rows of a channel that leaps, from which on it is held: they repeat a value before."""
_LEAP, _LONGEST_RUN = 3.0, 40
"""Times the least step of a channel: what resolution holds goes on by one or two. What stands for
more rows is at rest, or stuck."""


class OpenRun(NamedTuple):
    """Run of one value in which the rows so far end."""

    value: Number = np.nan  # repeated
    rows: int = 0  # that hold it
    # low_m, high_m: reach of the other channel meanwhile
    low_m: Number = np.inf
    high_m: Number = -np.inf


@compiled
def standing(values: Floats, other_m: Floats, before: OpenRun) -> tuple[float, float]:
    """Longest travel of another channel (n,) while one, (n,), n > 0, stood still, m.

    At most that in runs that are still open or end in a leap as far; and that in the open run, 0 if
    it is no repeat.

    Args:
        before: run in which the earlier rows end.
    """
    caught_up_m, count = 0.0, len(values)
    rows, low, high = 0, np.inf, -np.inf
    if values[0] == before.value:
        rows, low, high = before.rows, before.low_m, before.high_m
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


@compiled
def followed(values: Floats, other_m: Floats, before: OpenRun) -> OpenRun:
    """Run of one value in which rows (n,), n > 0, end."""
    value, first, low, high = values[-1], len(values), np.inf, -np.inf
    while first > 0 and values[first - 1] == value:
        first -= 1
        low, high = min(low, other_m[first]), max(high, other_m[first])
    rows = len(values) - first
    if first == 0 and before.value == value:
        rows, low, high = rows + before.rows, min(low, before.low_m), max(high, before.high_m)
    return OpenRun(value, rows, low, high)


@compiled
def holds(rows: Floats, least: Floats, leaps: Floats, repeats: Floats, grid: Floats) -> Floats:
    """Mean rows of a value of torque, angle and table, (3,), that repeat it and leap on, else 1.

    The rest, (3,) each, changes in place. `least` is the least step so far, NaN if unknown; `leaps`
    and `repeats` before them are those of earlier intervals, which fade: in a short one of a slow
    source there are few. `grid` is the least bend, kept where too few turn: the resolution.
    """
    found = np.ones(3)
    for k, column in enumerate((U, THETA, X)):
        values, now, finest, turns, before, last = rows[:, column], np.inf, np.inf, 0, np.nan, 0.0
        rounding = 1e-9 * np.abs(values).max()
        for step in values[1:] - values[:-1]:
            now = abs(step) if rounding < abs(step) < now else now
            bend, before = step - before, step
            if abs(bend) > 4.0 * rounding:
                finest, turns, last = min(finest, abs(bend)), turns + (bend * last < 0.0), bend
        grid[k] = finest if turns >= _LEAST_LEAPS else grid[k]
        least[k] = now if np.isnan(least[k]) else min(FORGET * least[k], now)
        begun, leaps[k], repeats[k] = 0, _KEPT * leaps[k], _KEPT * repeats[k]
        for row in range(1, len(values)):
            step = abs(values[row] - values[row - 1])
            if step >= _LEAP * least[k] and begun and row - begun <= _LONGEST_RUN:
                leaps[k], repeats[k] = leaps[k] + 1.0, repeats[k] + row - begun - 1
            if step != 0.0:
                begun = row
        if leaps[k] >= _LEAST_LEAPS and repeats[k] > HELD_SHARE * (leaps[k] + repeats[k]):
            found[k] += repeats[k] / leaps[k]
    return found
