"""Preload of an axis with one encoder, from the level of its dry friction alone.

Torque shows the sum of all frictions, and warmth or grease lower it as a lost preload does. How
the filter shares a change out between them is a matter of its priors only, and a share once given
to the preload stays there. So the friction's level is weighed anew at each moment against every
preload that it may belong to, without memory: the interval holds what warmth and grease may do.
"""

import math

import numpy as np

from ...messages.samples import Floats
from ...models.compiled import compiled
from .state import MOST_SHARE

AS_MADE = 0.05
"""Assumption: standard deviation of a fresh preload, as a share."""
CELLS, _WARMTHS = 210, 5


@compiled
def cells() -> Floats:
    """Preloads over the fresh one, at the middles of equal cells from none to the most, (n,)."""
    return np.asarray((np.arange(CELLS) + 0.5) * MOST_SHARE / CELLS)


@compiled
def prior() -> Floats:
    """Prior of each cell, (n,): as it was made, or any other, equally likely."""
    fresh = np.exp(-0.5 * ((cells() - 1.0) / AS_MADE) ** 2)
    share: Floats = fresh / np.sum(fresh)
    return share + 1.0 / CELLS


@compiled
def weigh(
    coulomb_nm: float,
    sigma_nm: float,
    fresh_nm: float,
    other_nm: float,
    error_share: float,
    friction: tuple[float, float, float],
) -> Floats:
    """Probability of each cell of preload, (n,), given the dry friction of the whole axis.

    Of the friction at commissioning `fresh_nm` was the nut's, `other_nm` that of guides, seals and
    bearings; `error_share` is the error of the drag per preload, and `friction` the most share lost
    to warmth, with standard deviations of all alike and of each apart.
    """
    warmth, together, apart_share = friction
    shares, weights = cells(), prior()
    for i in range(CELLS):
        drag_nm, likelihood = fresh_nm * shares[i], 0.0
        apart = (apart_share * drag_nm) ** 2 + (apart_share * other_nm) ** 2
        apart += (error_share * (fresh_nm - drag_nm)) ** 2
        for j in range(_WARMTHS):
            expected_nm = (drag_nm + other_nm) * (1.0 - warmth * j / (_WARMTHS - 1.0))
            variance = (together * expected_nm) ** 2 + apart + sigma_nm * sigma_nm
            away = coulomb_nm - expected_nm
            likelihood += math.exp(-0.5 * away * away / variance) / math.sqrt(variance)
        weights[i] *= likelihood
    whole = np.sum(weights)
    return weights / whole if whole > 0.0 else np.full(CELLS, 1.0 / CELLS)


@compiled
def below(share: float, weights: Floats) -> float:
    """Probability that the preload lies below a share of the fresh one."""
    at = share / MOST_SHARE * CELLS
    whole = min(max(int(at), 0), CELLS)
    part = weights[whole] * (at - whole) if whole < CELLS else 0.0
    return min(float(np.sum(weights[:whole]) + part), 1.0)


@compiled
def quantile(probability: float, weights: Floats) -> float:
    """Share of the fresh preload below which the preload lies with a probability."""
    total = 0.0
    for i in range(CELLS):
        if total + weights[i] >= probability and weights[i] > 0.0:
            return float((i + (probability - total) / weights[i]) * MOST_SHARE / CELLS)
        total += weights[i]
    return MOST_SHARE


@compiled
def slicker(
    coulomb_nm: float, sigma_nm: float, fresh_nm: float, limit_nm: float, weights: Floats
) -> float:
    """Probability that dry friction beside the nut's at its preload is above a limit, N m."""
    shares, total = cells(), 0.0
    for i in range(CELLS):
        up_nm = coulomb_nm - fresh_nm * shares[i] - limit_nm
        total += weights[i] * 0.5 * math.erfc(-up_nm / max(sigma_nm, 1e-9) / math.sqrt(2.0))
    return total
