"""Samples that come again, come late, or begin anew, told by the count or time of each."""

import math
from collections import OrderedDict

import numpy as np

from edge_service.messages.samples import Booleans, Floats

MEMORY = 1 << 15
"""Samples that are remembered: a minute at 500 Hz."""
MOST_LATE = 500
"""Late ones in a row: after so many it is the newest key that was wrong."""


class Order:
    """Keeps a sample that is new, or the first of a new run; drops one that is neither.

    A key that is known, with the same values, comes again. An unknown one between known ones comes
    late, and its place has been passed. Any other that does not rise begins a new run; so does one
    behind too many late ones.

    Attributes:
        repeated, late, restarts: how many of each.
    """

    def __init__(self) -> None:
        self.repeated = self.late = self.restarts = 0
        self._known: OrderedDict[float, int] = OrderedDict()
        self._newest = -math.inf
        self._late_in_a_row = 0

    def keep(self, keys: Floats, rows: Floats) -> Booleans:
        """Mask of the samples to keep, (n,).

        Args:
            keys: count or time, (n,); a sample without one is kept, and judged by its reader.
            rows: the values, (n, m).
        """
        kept = [
            math.isnan(key) or self._is_wanted(key, hash(row.tobytes()))
            for key, row in zip(keys.tolist(), rows, strict=True)
        ]
        return np.array(kept, dtype=bool)

    def forget(self) -> None:
        """Begin anew: what comes next belongs to another run."""
        self._known.clear()
        self._newest = -math.inf

    def _is_wanted(self, key: float, content: int) -> bool:
        if key <= self._newest:
            known = self._known.get(key)
            if known == content:
                self.repeated += 1
                return False
            if known is None and self._is_late(key):
                self.late += 1
                self._late_in_a_row += 1
                return False
            self.restarts += 1
            self._known.clear()
        self._late_in_a_row = 0
        self._newest = key
        self._known[key] = content
        if len(self._known) > MEMORY:
            self._known.popitem(last=False)
        return True

    def _is_late(self, key: float) -> bool:
        return key > next(iter(self._known)) and self._late_in_a_row < MOST_LATE
