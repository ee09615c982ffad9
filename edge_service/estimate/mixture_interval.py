"""Quantiles and intervals of a Gaussian mixture of something that cannot be negative."""

import math

from ..messages.samples import Floats
from ..models.compiled import compiled

_HALVINGS = 50


@compiled
def mixture_cdf(x: float, weight: Floats, mean: Floats, sigma: Floats) -> float:
    """Probability below x; weights, means and standard deviations are (k,)."""
    total = 0.0
    for k in range(len(weight)):
        total += weight[k] * 0.5 * math.erfc((mean[k] - x) / sigma[k] / math.sqrt(2.0))
    return total


@compiled
def mixture_quantile(probability: float, weight: Floats, mean: Floats, sigma: Floats) -> float:
    """Where `mixture_cdf` is `probability`, by halving within 8 standard deviations."""
    low, high = (mean - 8.0 * sigma).min(), (mean + 8.0 * sigma).max()
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if mixture_cdf(middle, weight, mean, sigma) < probability:
            low = middle
        else:
            high = middle
    return float(0.5 * (low + high))


@compiled
def interval(
    weight: Floats, mean: Floats, sigma: Floats, one_sided_below: float
) -> tuple[float, float]:
    """95 % interval of the mixture above 0: one-sided at 0, and for small means."""
    below_zero = mixture_cdf(0.0, weight, mean, sigma)
    rest = 1.0 - below_zero
    if rest <= 1e-9:
        return 0.0, 1.96 * sigma.max()
    average = 0.0
    for k in range(len(weight)):
        average += weight[k] * mean[k]
    if below_zero > 0.025 or average < one_sided_below:
        return 0.0, mixture_quantile(below_zero + 0.95 * rest, weight, mean, sigma)
    low = mixture_quantile(below_zero + 0.025 * rest, weight, mean, sigma)
    high = mixture_quantile(below_zero + 0.975 * rest, weight, mean, sigma)
    return max(low, 0.0), high
