"""Search for the axis of a fleet that wears faster than the others, beyond doubt."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtr

LEAST_PEERS = 3
DOUBT = 0.05
"""Probability that a fleet of equal axes has one that is called faster, about."""
_MAD_TO_SIGMA = 1.4826
_MEDIAN_VARIANCE = np.pi / 2.0
"""Variance of a median over that of a mean, of many normal values."""


@dataclass(frozen=True, slots=True)
class WearRate:
    """Loss of preload of one axis, percent of its fresh preload per 1000 h.

    Attributes:
        sigma: standard deviation of its error.
    """

    loss: float
    sigma: float


@dataclass(frozen=True, slots=True)
class PeerVerdict:
    """One axis against the others.

    Attributes:
        peers: how many others there are with a rate.
        peers_loss: the middle of theirs, the same unit.
        probability: that this axis loses more than a like axis would.
        faster: whether that is beyond doubt, for a fleet of this size.
    """

    peers: int
    peers_loss: float
    probability: float
    faster: bool


def against_peers(rates: Sequence[WearRate]) -> list[PeerVerdict | None]:
    """Each axis against all others; None where there are fewer than LEAST_PEERS of them.

    The others are taken as draws around their median. Their spread is that of the median absolute
    deviation, but never less than their own errors; a further axis of their kind lies around the
    median with the variance spread^2 + the median's own + its own error^2, and Student's t of
    n - 1 degrees allows for a spread that so few can hardly tell.
    """
    if len(rates) <= LEAST_PEERS:
        return [None] * len(rates)
    return [_against(rates, index) for index in range(len(rates))]


def _against(rates: Sequence[WearRate], index: int) -> PeerVerdict:
    own = rates[index]
    others = [rate for k, rate in enumerate(rates) if k != index]
    losses = np.array([rate.loss for rate in others])
    middle = float(np.median(losses))
    seen = _MAD_TO_SIGMA * float(np.median(np.abs(losses - middle)))
    spread = max(seen, float(np.median([rate.sigma for rate in others])))
    of_middle = _MEDIAN_VARIANCE * spread**2 / len(others)
    sigma = float(np.sqrt(spread**2 + of_middle + own.sigma**2))
    excess = own.loss - middle
    score = excess / sigma if sigma > 0.0 else float(np.sign(excess)) * np.inf
    probability = 0.5 if excess == 0.0 else float(stdtr(len(others) - 1, score))
    return PeerVerdict(len(others), middle, probability, probability > 1.0 - DOUBT / len(rates))
