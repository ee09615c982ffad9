"""Runs of one repeated value, also over the borders of intervals, and how far the axis went."""

from dataclasses import dataclass

import numpy as np

from ..messages.row_faults import run_starts
from ..messages.samples import Floats

LEAST_ROWS = 4
"""A value that is there so often in a row is repeated; a slow channel holds each for long."""


@dataclass(frozen=True, slots=True)
class OpenRun:
    """The run of one value that the rows so far end in.

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
        caught_up_m: at most, in runs that the rows end in or that end in a leap as far.
        open_m: in the run that the rows end in; 0 if that is no repeat.
    """

    caught_up_m: float
    open_m: float


def standing(values: Floats, other_m: Floats, unit_m: float, before: OpenRun) -> Standing:
    """Look for runs in values (n,), n > 0, against another channel (n,).

    Args:
        unit_m: way of the axis per unit of `values`.
        before: the run that the rows before end in.
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
    """The run that rows (n,), n > 0, end in."""
    changes = np.flatnonzero(values != values[-1])
    first = int(changes[-1]) + 1 if changes.size else 0
    rows = len(values) - first
    low, high = float(other_m[first:].min()), float(other_m[first:].max())
    if first == 0 and before.value == values[-1]:
        return OpenRun(
            before.value, rows + before.rows, min(low, before.low_m), max(high, before.high_m)
        )
    return OpenRun(float(values[-1]), rows, low, high)
