"""Samples that no drive can make: a channel leaves its neighbours by far, and comes back at once.

Zeros, sentinels, flipped bits, values of another time; each is replaced by the parabola through
its neighbours. How far is far is asked of the channel, by a quantile that a few such samples do not
move (as in Hampel's identifier): noise, steps, coarse encoders, ripple and chatter pass.
"""

import numpy as np

from ...messages.features import Fault
from ...messages.row_faults import THETA, T, U, X
from ...messages.samples import Floats, Integers
from ...models.compiled import compiled

LONGEST_S, MOST_ROWS, FIRST = 0.004, 3, 4
"""An excursion that lasts longer may be true: a drive can make it. So many rows come before one."""
BEFORE, BEHIND = 32, 5
"""Rows on either side of an excursion that show what the channel usually does."""
_FAR = 7.0
"""Times the bend that a quarter of the rows exceed: 8 standard deviations of white noise."""
_BACK = 1.0 / 3.0
"""Share of an excursion by which the channel may miss its course when it comes back."""
_ANSWERED = 4.0
"""The same of the motor's angle, from which on it answers a torque: a true one."""
OUTLIERS = (
    (THETA, int(Fault.ANGLE_OUTLIERS)),
    (X, int(Fault.TABLE_OUTLIERS)),
    (U, int(Fault.TORQUE_OUTLIERS)),
)
"""Columns that are searched, and the bit of Fault of each."""


def longest_rows(period_s: float) -> int:
    """Rows of the longest excursion that is looked for; 0 of samples too slow to show one."""
    return min(MOST_ROWS, int(LONGEST_S / period_s + 1e-6))


@compiled
def mend(rows: Floats, start: int, stop: int, longest: int) -> Integers:
    """Replace excursions that begin in [start, stop) of rows (n, 8), in place.

    Args:
        longest: rows of an excursion.

    Returns:
        Bits of Fault of each row, (n,).
    """
    found, time_s = np.zeros(len(rows), dtype=np.int64), rows[:, T]
    for column, bit in OUTLIERS:
        values, row = rows[:, column], max(start, FIRST)
        while longest and row < min(stop, len(rows) - 1):
            end = _end(values, time_s, row, longest)
            if end > row and column == U and _moves_apart(rows[:, THETA], time_s, row, end):
                end = row
            turn = _off(values, time_s, row - 2, row - 1, end) if end > row else 0.0
            turn /= (time_s[row - 2] - time_s[row - 1]) * (time_s[row - 2] - time_s[end])
            for each in range(row, end):
                found[each] |= bit
                bent = turn * (time_s[each] - time_s[row - 1]) * (time_s[each] - time_s[end])
                values[each] += bent - _off(values, time_s, each, row - 1, end)
            row = max(end, row + 1)
    return found


@compiled
def _end(values: Floats, time_s: Floats, row: int, longest: int) -> int:
    """Row behind the excursion that begins with a row; the row itself if none does."""
    before = row - 1
    slope = (values[before] - values[row - 3]) / (time_s[before] - time_s[row - 3])
    for end in range(row + 1, min(row + longest, len(values) - 1) + 1):
        if np.isnan(values[end - 1]) or values[row] == values[before]:
            return row
        size = np.inf
        for each in range(row, end):
            size = min(size, abs(_off(values, time_s, each, before, end)))
        missed = values[end] - values[before] - slope * (time_s[end] - time_s[before])
        is_back = values[end] != values[end - 1] and abs(missed) <= _BACK * size
        if is_back and _exceeds(size, _FAR, values, time_s, row, end):
            return end
    return row


@compiled
def _off(values: Floats, time_s: Floats, row: int, before: int, behind: int) -> float:
    """Distance of a row from the line through two others."""
    share = (time_s[row] - time_s[before]) / (time_s[behind] - time_s[before])
    return float(values[row] - values[before] - share * (values[behind] - values[before]))


@compiled
def _exceeds(size: float, by: float, values: Floats, time_s: Floats, row: int, end: int) -> bool:
    """Return whether a size is `by` times one step, and the bend that a quarter of rows exceed."""
    begin, stop = max(row - BEFORE, 1), min(end + BEHIND, len(values) - 1)
    bent, least = (stop - begin) - (3 * (stop - begin)) // 4, np.inf
    rounding = 1e-9 * (abs(values[row - 1]) + abs(values[end]))
    for each in range(begin, stop):
        bend = abs(_off(values, time_s, each, each - 1, each + 1))
        bent -= not size > by * bend
        if bent == 0:
            return False
        if rounding < bend < least:
            least = bend
    return size > by * least


@compiled
def _moves_apart(angle: Floats, time_s: Floats, row: int, end: int) -> bool:
    """Motor that accelerates during an excursion otherwise than beside it."""
    begin, stop = row - 2, min(end + 2, len(angle) - 2)
    beside = _off(angle, time_s, begin - 1, begin - 2, begin)
    beside = 0.5 * (beside + _off(angle, time_s, stop, stop - 1, stop + 1))
    for each in range(begin, stop):
        bend = abs(_off(angle, time_s, each, each - 1, each + 1) - beside)
        if _exceeds(bend, _ANSWERED, angle, time_s, row, end):
            return True
    return False
