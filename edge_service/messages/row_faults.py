"""Faults of the rows of a recording, live or not: repeats, late rows, new clocks, stuck values."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .samples import Booleans, Floats

T, U, THETA, OMEGA, X, SET, TEMP, FORCE = range(8)
"""Columns of a table of rows: time, torque, angle, speed, table, setpoint, temperature, force."""

CLOCK_RESET_S = 1.0
"""A step back in time by more than this is a new clock, less is rows out of order."""

WILDEST = 1e12
"""No quantity of an axis in SI units, nor its clock, is as large; such a value is a missing one."""

STUCK_S = 0.05  # a channel that repeats one value for this long while the axis moves is stuck

MOVED_ANGLE_RAD, MOVED_TABLE_M, MOVED_SETPOINT_M = 0.02, 20e-6, 100e-6
"""Travel in one of the positions above which the axis has moved."""

LIMIT_SHARE = 0.995
"""A torque that stays this close to its limit stands there because the drive cuts it off."""


@dataclass(frozen=True, slots=True, eq=False)
class ClockPart:
    """Rows of one clock; rows without a time (NaN) are neither repeated nor backwards."""

    rows: slice  # which of all
    repeated: Booleans  # rows with the newest time so far, (n,)
    backwards: Booleans  # rows older than that, (n,)
    newest_s: float  # time at the end of the part; -inf before any
    new_clock: bool  # the first row begins a new clock


def clock_parts(time_s: Floats, newest_s: float = -np.inf) -> Iterator[ClockPart]:
    """Part rows (n,) in the order of arrival by clock; at least one part, which may be empty.

    Args:
        newest_s: newest time of the rows before.

    >>> parts = list(clock_parts(np.array([5.0, 6.0, 6.0, 5.5, 0.0, 1.0])))
    >>> [(part.rows.start, part.rows.stop, part.new_clock) for part in parts]
    [(0, 4, False), (4, 6, True)]
    >>> parts[0].repeated.tolist(), parts[0].backwards.tolist()
    ([False, False, True, False], [False, False, False, True])
    """
    start, new_clock = 0, False
    while True:
        rest = time_s[start:]
        known = np.where(np.isnan(rest), -np.inf, rest)
        newest = np.maximum.accumulate(np.concatenate([[newest_s], known]))
        resets = np.flatnonzero(rest < newest[:-1] - CLOCK_RESET_S)
        end = int(resets[0]) if resets.size else len(rest)
        yield ClockPart(
            slice(start, start + end),
            rest[:end] == newest[:end],
            rest[:end] < newest[:end],
            float(newest[end]),
            new_clock,
        )
        if end == len(rest):
            return
        start, newest_s, new_clock = start + end, -np.inf, True
