"""Runs of one repeated value with the travel meanwhile, and channels that hold their values."""

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
def holds(rows: Floats, least: Floats, leaps: Floats, repeats: Floats) -> Floats:
    """Mean rows of a value of torque, angle and table, (3,), as of `held`; the rest in place."""
    found = np.empty(3)
    for k, column in enumerate((U, THETA, X)):
        so_far = least[k], leaps[k], repeats[k]
        found[k], least[k], leaps[k], repeats[k] = held(rows[:, column], *so_far)
    return found


@compiled
def held(values: Floats, least: float, leaps: float, repeats: float) -> tuple[float, ...]:
    """Mean rows of a value of a channel (n,) that repeats it and leaps on, else 1; and the rest.

    `least` is the least step so far, NaN if unknown; `leaps` and `repeats` before them are those of
    earlier intervals, which fade: in a short one of a slow source there are few.
    """
    rounding, now = 1e-9 * np.abs(values).max(), np.inf
    for step in np.abs(values[1:] - values[:-1]):
        if rounding < step < now:
            now = step
    least = now if np.isnan(least) else min(FORGET * least, now)
    begun, leaps, repeats = 0, _KEPT * leaps, _KEPT * repeats
    for row in range(1, len(values)):
        step = abs(values[row] - values[row - 1])
        if step >= _LEAP * least and begun and row - begun <= _LONGEST_RUN:
            leaps, repeats = leaps + 1.0, repeats + row - begun - 1
        if step != 0.0:
            begun = row
    is_held = leaps >= _LEAST_LEAPS and repeats > HELD_SHARE * (leaps + repeats)
    return (1.0 + repeats / leaps if is_held else 1.0), least, leaps, repeats
