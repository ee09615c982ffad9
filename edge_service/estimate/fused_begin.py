"""Where the hypotheses of the fused estimator begin, and where they begin beside what was known."""

import math

import numpy as np

from .fused_model import Start
from .fused_state import CAPACITY, PRELOAD, TURN_COS, FusedModel, Mixture

_PERCENTS = (0.2, 0.6, 1.1, 1.7, 2.4, 3.2, 4.1, 5.1, 6.2, 7.4, 8.7, 10.1)
SIGMA_SHARE = 0.5
"""Of the fresh preload, where torque alone has to find it."""
LEAST_TURN_M = 1e-12
"""A hypothesis without a trace of an encoder off its centre does not look for one."""


def begun(start: Start, model: FusedModel) -> Mixture:
    """Hypotheses of the preload that the axis may have at the start.

    Torque is linear in the preload: one Gaussian holds all that it can tell, and jumps from there
    are weighed against one another over the whole of it. The stretch is not: a hypothesis each.
    """
    mixture = _empty(len(start.mean))
    levels = [(percent, 0.15 + 0.06 * percent) for percent in _PERCENTS]
    if model.compliance_m_per_n == 0.0:
        levels = [(model.fresh_percent, SIGMA_SHARE * model.fresh_percent)]
    every = [
        (share / len(levels), *level, covariance)
        for share, covariance in start.beginnings
        for level in levels
    ]
    mixture.alive[0] = len(every)
    for k, (weight, percent, sigma, covariance) in enumerate(every):
        mixture.log_weight[k] = math.log(weight)
        mixture.mean[k] = start.mean
        mixture.mean[k, PRELOAD] = percent
        mixture.covariance[k] = covariance
        mixture.covariance[k, PRELOAD, PRELOAD] = sigma**2
        if covariance[TURN_COS, TURN_COS] > 0.0:
            mixture.mean[k, TURN_COS] = LEAST_TURN_M
    return mixture


def doubt(mixture: Mixture, share: float, start: Start, model: FusedModel) -> None:
    """Let a share of the probability begin anew, in place; the least likely make room."""
    anew = begun(Start(start.mean, ((1.0, start.changed),), start.changed), model)
    count = int(anew.alive[0])
    order = np.argsort(-mixture.log_weight[: int(mixture.alive[0])], kind="stable")
    best = order[: CAPACITY - count]
    kept, end = len(best), len(best) + count
    for name in ("mode", "kind", "age_s", "force", "mean", "covariance"):
        array, begins = getattr(mixture, name), getattr(anew, name)
        array[:kept] = array[best]
        array[kept:end] = begins[:count]
    weight = mixture.log_weight[best]
    mixture.log_weight[:kept] = weight - _log_sum(weight) + math.log(1.0 - share)
    mixture.log_weight[kept:end] = anew.log_weight[:count] + math.log(share)
    mixture.log_weight[end:] = -np.inf
    mixture.alive[0] = end


def _empty(size: int) -> Mixture:
    return Mixture(
        np.zeros(1, dtype=np.int64),
        np.full(CAPACITY, -np.inf),
        np.zeros(CAPACITY, dtype=np.int64),
        np.full(CAPACITY, -1, dtype=np.int64),
        np.full(CAPACITY, np.inf),
        np.zeros(CAPACITY),
        np.full(1, 1e3),
        np.zeros((CAPACITY, size)),
        np.zeros((CAPACITY, size, size)),
    )


def _log_sum(logs: np.ndarray) -> float:
    top = float(logs.max())
    return top + math.log(float(np.exp(logs - top).sum()))
