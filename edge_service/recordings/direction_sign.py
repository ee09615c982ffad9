"""Sign of the direction in which a column changes, over the blocks of a file."""

import numpy as np

from ..messages.samples import Floats


class DirectionSign:
    """Signs of successive blocks: +1 or -1 from the last change on; NaN before the first one."""

    def __init__(self) -> None:
        self._value, self._sign = np.nan, np.nan

    def of(self, values: Floats) -> Floats:
        """Signs for the next values, shape (n,) each; a missing value changes nothing."""
        before = np.concatenate([[self._value], values])
        known = np.isfinite(before)
        held = np.maximum.accumulate(np.where(known, np.arange(len(before)), 0))
        change = np.nan_to_num(np.diff(before[held]))
        turned = np.flatnonzero(change)
        last = np.zeros(len(change), dtype=int)
        last[turned] = turned + 1
        signs = np.concatenate([[self._sign], np.sign(change)])[np.maximum.accumulate(last)]
        self._value, self._sign = before[held][-1], float(signs[-1]) if len(signs) else self._sign
        return signs
