"""Runs of one repeated value, also over the borders of intervals, and the travel meanwhile."""

from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ...models.compiled import compiled
from ..interval_kernels import LEAST_ROWS


@dataclass(frozen=True, slots=True)
class OpenRun:
    """Run of one value in which the rows so far end.

    Attributes:
        value: repeated.
        rows: that hold it.
        low_m, high_m: reach of the other channel meanwhile.
    """

    value: float = np.nan
    rows: int = 0
    low_m: float = np.inf
    high_m: float = -np.inf


@dataclass(frozen=True, slots=True)
class Standing:
    """Travel of another channel while one stood still, m.

    Attributes:
        caught_up_m: at most, in runs that are still open or end in a leap as far.
        open_m: in the open run; 0 if that is no repeat.
    """

    caught_up_m: float
    open_m: float


def standing(values: Floats, other_m: Floats, unit_m: float, before: OpenRun) -> Standing:
    """Longest travel during runs in values (n,), n > 0, by another channel (n,).

    Args:
        unit_m: way of the axis per unit of `values`.
        before: run in which the earlier rows end.
    """
    caught_up_m, open_m = _caught_up(
        values, other_m, unit_m, before.value, before.rows, before.low_m, before.high_m
    )
    return Standing(caught_up_m, open_m)


@compiled
def _caught_up(
    values: Floats,
    other_m: Floats,
    unit_m: float,
    value: float,
    earlier: int,
    low_m: float,
    high_m: float,
) -> tuple[float, float]:
    """See `standing`; `earlier` rows of `value` came before, the other within its reach."""
    caught_up_m, count = 0.0, len(values)
    rows, low, high = 0, np.inf, -np.inf
    if values[0] == value:
        rows, low, high = earlier, low_m, high_m
    for row in range(count):
        rows += 1
        low, high = min(low, other_m[row]), max(high, other_m[row])
        if row + 1 < count and values[row + 1] - values[row] == 0.0:
            continue
        way_m = high - low if rows >= LEAST_ROWS else 0.0
        ends = row + 1 < count
        if not ends or abs(values[row + 1] - values[row]) * unit_m > 0.5 * way_m:
            caught_up_m = max(caught_up_m, way_m)
        if ends:
            rows, low, high = 0, np.inf, -np.inf
    return caught_up_m, (high - low if rows > 1 else 0.0)


def followed(values: Floats, other_m: Floats, before: OpenRun) -> OpenRun:
    """Run of one value in which rows (n,), n > 0, end."""
    changes = np.flatnonzero(values != values[-1])
    first = int(changes[-1]) + 1 if changes.size else 0
    rows = len(values) - first
    low, high = float(other_m[first:].min()), float(other_m[first:].max())
    if first == 0 and before.value == values[-1]:
        return OpenRun(
            before.value, rows + before.rows, min(low, before.low_m), max(high, before.high_m)
        )
    return OpenRun(float(values[-1]), rows, low, high)
