"""Runs of one repeated value, also over the borders of intervals, and the travel meanwhile."""

from dataclasses import dataclass

import numpy as np

from ...messages.row_faults import run_starts
from ...messages.samples import Floats
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
    starts = run_starts(values)
    rows = np.diff(np.concatenate([starts, [len(values)]]))
    low, high = np.minimum.reduceat(other_m, starts), np.maximum.reduceat(other_m, starts)
    if values[0] == before.value:
        rows[0] += before.rows
        low[0], high[0] = min(low[0], before.low_m), max(high[0], before.high_m)
    way = np.where(rows >= LEAST_ROWS, high - low, 0.0)
    leap = np.append(np.abs(np.diff(values[starts])) * unit_m, np.inf)
    caught_up = way[leap > 0.5 * way]
    open_m = float(high[-1] - low[-1]) if rows[-1] > 1 else 0.0
    return Standing(float(caught_up.max(initial=0.0)), open_m)


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
