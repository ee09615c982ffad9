"""Comparison of two positions where both rest: no lag and no overshoot is left there."""

from collections.abc import Iterator, Sequence

import numpy as np

from ...messages.samples import Floats, SampleFrame
from ..regression.interval_estimate import IntervalEstimate
from ..regression.linear import least_squares

LEAST_ROWS = 20
"""Rows of an unchanged setpoint that may be a rest: a cubic and its noise fill fewer."""
LAST_SHARE = 0.25
"""Of a rest: its end, when the axis has settled."""
SETTLED_SHARE = 0.01
"""Of the whole travel: what moves by more in that last part does not rest."""
LEAST_RESTS = 4
"""Rests for a factor, an offset and a scatter."""


def factor_at_rest(
    recordings: Sequence[SampleFrame], position: str, setpoint: str
) -> IntervalEstimate | None:
    """Factor of the position over its setpoint from where both rest; None without such rests."""
    able = [frame for frame in recordings if {position, setpoint} <= frame.channels.keys()]
    pairs = np.array(
        [
            pair
            for frame in able
            for pair in _rests(frame.channels[position], frame.channels[setpoint])
        ]
    ).reshape(-1, 2)
    if len(pairs) < LEAST_RESTS or np.ptp(pairs[:, 1]) == 0.0:
        return None
    around = pairs - pairs.mean(axis=0)
    fit = least_squares(("factor",), around[:, 1:], around[:, 0])
    return fit.interval_estimate("factor", "")


def _rests(position: Floats, setpoint: Floats) -> Iterator[tuple[float, float]]:
    """Position and setpoint of each rest, in their units."""
    known = np.isfinite(position) & np.isfinite(setpoint)
    position, setpoint = position[known], setpoint[known]
    if not len(position):
        return
    settled = SETTLED_SHARE * float(np.ptp(position))
    edges = np.flatnonzero(np.diff(setpoint)) + 1
    for stretch in np.split(np.arange(len(setpoint)), edges):
        if len(stretch) < LEAST_ROWS:
            continue
        last = position[stretch[-max(round(LAST_SHARE * len(stretch)), 2) :]]
        if float(np.ptp(last)) <= settled:
            yield float(last.mean()), float(setpoint[stretch[0]])
