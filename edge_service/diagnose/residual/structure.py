"""Structure of a residual: the part that smooth functions predict on motion not fitted to.

What a library leaves may be noise, or structure that no entry has: what smooth functions predict of
held-out blocks is structure, whatever its name.
"""

from collections.abc import Mapping

import numpy as np

from ...messages.samples import Floats
from ..session.session import Integers, Session
from .folds import FOLDS, block_s, fold_of
from .smooth_functions import SmoothFunctions

_RIDGES = (3e-4, 1e-2, 0.3)
"""Of the number of rows: columns have a mean square of 1, the plainest ones a greater one."""


def predicted_structure(
    session: Session, left: Mapping[str, Floats], *, timed: bool = True
) -> dict[str, Floats]:
    """Prediction of `left` by smooth functions on blocks that they were not fitted to, by channel.

    Args:
        left: what something leaves of the gap, by channel, (n,).
        timed: functions of time are among them; otherwise of the motion alone.
    """
    length_s = block_s(session)
    return {
        name: cross_predicted(
            session, name, each, fold_of(rows.variables["time_s"], length_s), timed
        )
        for name, each in left.items()
        for rows in (session.channels[name],)
    }


def cross_predicted(
    session: Session, channel: str, values: Floats, fold: Integers, timed: bool
) -> Floats:
    """Values (n,) as each fold (n,) follows from the others; 0 where nothing follows better."""
    rows, low_pass = session.channels[channel], session.runs[0].low_pass
    found = {ridge: np.zeros(len(values)) for ridge in _RIDGES}
    for k in range(FOLDS):
        mine = fold == k
        if not mine.any() or mine.all():
            continue
        here, there = rows.at(mine).variables, rows.at(~mine).variables
        forms, known = SmoothFunctions.fitted(there, values[~mine], channel, low_pass, timed=timed)
        asked = forms.columns(here)
        gram, cross = known.T @ known, known.T @ values[~mine]
        for ridge in _RIDGES:
            beta = np.linalg.solve(with_ridge(gram, ridge * len(known)), cross)
            found[ridge][mine] = asked @ beta
    best = min(found.values(), key=lambda each: float(np.sum((values - each) ** 2)))
    helps = np.sum((values - best) ** 2) < np.sum(values**2)
    return best if helps else np.zeros(len(values))


def with_ridge(gram: Floats, ridge: float) -> Floats:
    """Sums of products (p, p) with a ridge, the same for all columns."""
    held: Floats = gram + ridge * np.eye(len(gram))
    return held
