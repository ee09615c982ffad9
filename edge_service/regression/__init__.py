"""Regression: conditioning, linear and nonlinear fits, honest intervals."""

import math

MOST_INDEPENDENT = 60
"""Observations with which no p-value up to 0.1 is below the part of 320 healthy axes."""
FALSE_ALARMS = 0.01
"""Chance below which a model is wrong, live and offline."""


def chance_of_misfit(square: float, healthy: float, independent: float) -> float:
    """Chance that noise of a mean square `healthy` leaves a mean square as great: of an F-test.

    Both have as many independent observations; `MOST_INDEPENDENT` of them count at most. Snedecor's
    distribution with two equal even numbers of them is a binomial one.
    """
    half = max(round(0.5 * min(independent, MOST_INDEPENDENT)), 1)
    p, tosses = 1.0 - square / max(healthy + square, 1e-300), 2 * half - 1
    tail = range(half, tosses + 1)
    return math.fsum(math.comb(tosses, k) * p**k * (1.0 - p) ** (tosses - k) for k in tail)
