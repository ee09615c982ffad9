"""Quantiles and intervals of a Gaussian mixture of something that cannot be negative."""

import math

from ..messages.samples import Floats
from ..models.compiled import compiled

_STEPS = 100
_LEAST_STEP = 1e-14
_ROOT_2, _ROOT_2_PI = math.sqrt(2.0), math.sqrt(2.0 * math.pi)


@compiled
def mixture_cdf(x: float, weight: Floats, mean: Floats, sigma: Floats) -> float:
    """Probability below x; weights, means and standard deviations are (k,)."""
    total = 0.0
    for k in range(len(weight)):
        total += weight[k] * 0.5 * math.erfc((mean[k] - x) / sigma[k] / _ROOT_2)
    return total


@compiled
def _density(x: float, weight: Floats, mean: Floats, sigma: Floats) -> float:
    total = 0.0
    for k in range(len(weight)):
        away = (x - mean[k]) / sigma[k]
        total += weight[k] / sigma[k] * math.exp(-0.5 * away * away) / _ROOT_2_PI
    return total


@compiled
def mixture_quantile(
    probability: float, weight: Floats, mean: Floats, sigma: Floats, guess: float
) -> float:
    """Where `mixture_cdf` is `probability`: Newton's steps, halving where one would lead astray."""
    low, high = (mean - 8.0 * sigma).min(), (mean + 8.0 * sigma).max()
    x = min(max(guess, low), high)
    before = high - low
    for _ in range(_STEPS):
        missing = probability - mixture_cdf(x, weight, mean, sigma)
        if missing > 0.0:
            low = x
        else:
            high = x
        density = _density(x, weight, mean, sigma)
        step = missing / density if density > 0.0 else math.inf
        if not (low <= x + step <= high) or abs(step) > 0.5 * before:
            step = 0.5 * (low + high) - x
        before = abs(step)
        x += step
        if before <= _LEAST_STEP * (abs(x) + 1.0):
            break
    return float(x)


@compiled
def interval(
    weight: Floats, mean: Floats, sigma: Floats, one_sided_below: float
) -> tuple[float, float]:
    """95 % interval of the mixture above 0: one-sided at 0, and for small means."""
    below_zero = mixture_cdf(0.0, weight, mean, sigma)
    rest = 1.0 - below_zero
    if rest <= 1e-9:
        return 0.0, 1.96 * sigma.max()
    average, square = 0.0, 0.0
    for k in range(len(weight)):
        average += weight[k] * mean[k]
        square += weight[k] * (mean[k] * mean[k] + sigma[k] * sigma[k])
    spread = math.sqrt(max(square - average * average, 0.0))
    if below_zero > 0.025 or average < one_sided_below:
        above = below_zero + 0.95 * rest
        return 0.0, mixture_quantile(above, weight, mean, sigma, average + 1.6 * spread)
    low, high = below_zero + 0.025 * rest, below_zero + 0.975 * rest
    return (
        max(mixture_quantile(low, weight, mean, sigma, average - 2.0 * spread), 0.0),
        mixture_quantile(high, weight, mean, sigma, average + 2.0 * spread),
    )
