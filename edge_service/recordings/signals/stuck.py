"""Channels that repeat one value while the axis moves."""

from collections.abc import Mapping

import numpy as np

from ...messages.channels import ANGLE, SETPOINT, TABLE_POSITION, TORQUE
from ...messages.row_faults import (
    LIMIT_SHARE,
    MOVED_ANGLE_RAD,
    MOVED_SETPOINT_M,
    MOVED_TABLE_M,
    STUCK_S,
    run_starts,
)
from ...messages.samples import Booleans, Floats

LEAST_REPEATS = 10
"""A slow recording or a coarse encoder repeats a value a few times while the axis creeps."""
MOVED = {ANGLE: MOVED_ANGLE_RAD, TABLE_POSITION: MOVED_TABLE_M, SETPOINT: MOVED_SETPOINT_M}
"""Travel of another channel, rad or m, above which the axis has moved."""
_STEPS = 3.0
"""Smallest steps of a channel that it must have missed."""


def stuck_rows(time_s: Floats, channels: Mapping[str, Floats]) -> dict[str, Booleans]:
    """Rows in which torque, angle or table position is stuck, by channel, (n,) each.

    Args:
        time_s: increasing, (n,).
        channels: at these times, (n,) each.
    """
    found = {}
    for name in (TORQUE, ANGLE, TABLE_POSITION):
        values = channels.get(name)
        if values is None:
            continue
        stuck = np.zeros(len(values), dtype=bool)
        greatest = LIMIT_SHARE * float(np.nanmax(np.abs(values), initial=0.0))
        for start, end in _repeats(values, time_s):
            limited = name == TORQUE and abs(values[start]) >= greatest > 0.0
            if not limited and _moved(channels, name, start, end):
                stuck[start : end + 1] = True
        found[name] = stuck
    return found


def _repeats(values: Floats, time_s: Floats) -> list[tuple[int, int]]:
    """First and last row of every long stretch of one value."""
    starts = run_starts(values)
    ends = np.append(starts[1:], len(values)) - 1
    long = (ends - starts >= LEAST_REPEATS) & (time_s[ends] - time_s[starts] >= STUCK_S)
    return list(zip(starts[long].tolist(), ends[long].tolist(), strict=True))


def _moved(channels: Mapping[str, Floats], name: str, start: int, end: int) -> bool:
    """Tell whether another channel shows that the axis moved meanwhile."""
    for other, least in MOVED.items():
        values = channels.get(other)
        if other == name or values is None:
            continue
        steps = np.abs(np.diff(values[start : end + 1]))
        smallest = float(np.min(steps[steps > 0.0], initial=np.inf))
        travel = float(np.nanmax(values[start : end + 1]) - np.nanmin(values[start : end + 1]))
        if travel > least and travel > _STEPS * smallest:
            return True
    return False
