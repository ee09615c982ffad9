"""Sums, extremes and places in arrays, for compiled code.

Those of numba bring scipy's linear algebra along when they are read from the disk, 40 MB of each
service.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from ..messages.samples import Floats
from .compiled import compiled


@compiled
def sum_of(values: Floats) -> float:
    """Sum of the values (n,), from the first to the last."""
    found = 0.0
    for value in values:
        found += value
    return found


@compiled
def least(values: Floats) -> float:
    """Least of the values (n,); NaN if one is."""
    found = values[0]
    for value in values:
        if value < found or np.isnan(value):
            found = value
    return float(found)


@compiled
def greatest(values: Floats) -> float:
    """Greatest of the values (n,); NaN if one is."""
    found = values[0]
    for value in values:
        if value > found or np.isnan(value):
            found = value
    return float(found)


@compiled
def median(values: Floats) -> float:
    """Median of finite values (n,)."""
    ordered = values.copy()
    ordered.sort()
    half = len(ordered) // 2
    if len(ordered) % 2:
        return float(ordered[half])
    return float(0.5 * (ordered[half - 1] + ordered[half]))


@compiled
def places(marks: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    """Places of those that are not zero among marks (n,), in order."""
    found, count = np.empty(len(marks), dtype=np.int64), 0
    for place in range(len(marks)):
        if marks[place]:
            found[count] = place
            count += 1
    return found[:count]
