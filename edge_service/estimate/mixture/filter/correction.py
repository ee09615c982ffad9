"""Correction of a hypothesis by a phase."""

import math

from ....messages.samples import Floats
from ....models.compiled import inlined
from ..state import (
    GUIDE_VISCOUS,
    LOOSENESS,
    MOST_SHARE,
    NUT_COMPLIANCE,
    NUT_FRICTION,
    PRELOAD,
    TORQUE_STATES,
    AxisModel,
    Bank,
)
from .innovation import Innovation

_LEAST_PERCENT = 0.02
_LEAST_FRICTION, _MOST_FRICTION = -0.7, 3.0


@inlined
def correct(
    bank: Bank,
    k: int,
    model: AxisModel,
    uu: float,
    ss: float,
    us: float,
    two: bool,
    innovation: Innovation,
) -> None:
    """Kalman correction with the innovation's covariance; considered states stay as they were.

    No nut has more preload than it was made with, and no joint is stiffer than at commissioning.
    """
    x, p = bank.mean[k], bank.covariance[k]
    size = x.shape[0]
    first, second, e = innovation.gains[0], innovation.gains[1], innovation.error
    left = math.sqrt(uu)
    step = e[0] / left
    below = us / left
    right = math.sqrt(ss - below * below)
    other = (e[1] - below * step) / right
    both = size > TORQUE_STATES
    nut = (x[NUT_COMPLIANCE], p[NUT_COMPLIANCE, NUT_COMPLIANCE]) if both else (0.0, 0.0)
    for i in range(size):
        first[i] /= left
        x[i] += first[i] * step
    if two:
        for i in range(size):
            second[i] = (second[i] - below * first[i]) / right
            x[i] += second[i] * other
    for i in range(size):
        a, b = first[i], second[i] if two else 0.0
        if a == 0.0 and b == 0.0:
            continue
        if two:
            for j in range(size):
                p[i, j] -= a * first[j] + b * second[j]
        else:
            for j in range(size):
                p[i, j] -= a * first[j]
    if both:
        x[NUT_COMPLIANCE], p[NUT_COMPLIANCE, NUT_COMPLIANCE] = nut
        x[LOOSENESS] = max(x[LOOSENESS], 0.0)
    _bound(x, p, math.log(MOST_SHARE * model.fresh_percent), both)
    x[PRELOAD] = max(x[PRELOAD], math.log(_LEAST_PERCENT))
    for i in range(NUT_FRICTION, GUIDE_VISCOUS + 1):
        x[i] = min(max(x[i], _LEAST_FRICTION), _MOST_FRICTION)


@inlined
def _bound(x: Floats, p: Floats, most: float, both: bool) -> None:
    """Project a state onto ln(preload) <= `most`: the likeliest one there (Simon, Chia 2002).

    Clipping alone would leave the rest of the state as an impossible preload has made it.
    """
    if x[PRELOAD] <= most or p[PRELOAD, PRELOAD] <= 0.0:
        return
    share = (most - x[PRELOAD]) / p[PRELOAD, PRELOAD]
    for i in range(x.shape[0]):
        if not (both and i == NUT_COMPLIANCE):
            x[i] += share * p[PRELOAD, i]
