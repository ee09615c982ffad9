"""Search for the axis of a fleet that wears faster than the others, beyond doubt."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
    count = len(rates)
    if count <= LEAST_PEERS:
        return [None] * count
    from scipy.special import stdtr  # 15 MB that fewer axes do without

    losses = np.array([rate.loss for rate in rates])
    sigmas = np.array([rate.sigma for rate in rates])
    middles = _medians_of_others(losses)
    spreads = np.maximum(
        _MAD_TO_SIGMA * _deviations_of_others(losses, middles), _medians_of_others(sigmas)
    )
    of_middle = _MEDIAN_VARIANCE * spreads**2 / (count - 1)
    errors = np.sqrt(spreads**2 + of_middle + sigmas**2)
    excess = losses - middles
    with np.errstate(divide="ignore", invalid="ignore"):
        scores = np.where(errors > 0.0, excess / errors, np.sign(excess) * np.inf)
    probabilities = np.where(excess == 0.0, 0.5, stdtr(count - 2, scores))
    return [
        PeerVerdict(count - 1, float(middle), float(probability), bool(probability > limit))
        for limit in (1.0 - DOUBT / count,)
        for middle, probability in zip(middles, probabilities, strict=True)
    ]


def _medians_of_others(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Median of all values but one, for each of them; shape (n,), n > 1."""
    order = np.argsort(values, kind="stable")
    ordered, others = values[order], len(values) - 1
    ranks = np.empty(len(values), dtype=np.intp)
    ranks[order] = np.arange(len(values))
    low, high = (others - 1) // 2, others // 2
    left = ordered[low + (ranks <= low)]
    right = ordered[high + (ranks <= high)]
    return np.asarray((left + right) / 2.0)


def _deviations_of_others(
    values: NDArray[np.float64], middles: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Median of the others' absolute deviations from their median, shape (n,).

    Leaving one out gives three medians at most, so few sorts serve thousands of axes.
    """
    deviations = np.empty_like(values)
    for middle in np.unique(middles):
        mine = middles == middle
        deviations[mine] = _medians_of_others(np.abs(values - middle))[mine]
    return deviations
