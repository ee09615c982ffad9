"""Folds of a session: blocks of time that are held out in turn."""

import numpy as np

from ...messages.samples import Floats
from ..session.session import BLOCK_S, Integers, Session

FOLDS = 4
_LEAST_BLOCKS = 8


def block_s(session: Session) -> float:
    """Length of a block, s: `BLOCK_S`, or an eighth of what is shorter."""
    times = [rows.variables["time_s"] for rows in session.channels.values()]
    span_s = max(float(np.ptp(each)) for each in times)
    return min(BLOCK_S, max(span_s, 1e-9) / _LEAST_BLOCKS)


def fold_of(time_s: Floats, length_s: float) -> Integers:
    """Number of the fold of each time, (n,): one block belongs to 0, the next to 1, and so on."""
    folds: Integers = np.floor(time_s / length_s).astype(np.int64) % FOLDS
    return folds
