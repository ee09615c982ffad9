"""Weighting of the mode probabilities: power, weighted sum, smoothing (thesis, 4.5)."""

import numpy as np

from ...messages.samples import Floats

PUBLISHED_EXPONENT = 1.33
"""Exponent of the thesis' simulations (section 4.5)."""


def mode_weights(mode_probability: Floats, exponent: float = PUBLISHED_EXPONENT) -> Floats:
    """mu_j^a / sum_j mu_j^a: (thesis, eq. 4.5.4) for any exponent a > 0; a = 1 changes nothing.

    Args:
        mode_probability: (..., r), at least one above zero in each row.
        exponent: a.
    """
    if not (np.isfinite(exponent) and exponent > 0.0):
        raise ValueError(f"activation exponent: {exponent:g}, expected a number above 0")
    relative = mode_probability / mode_probability.max(axis=-1, keepdims=True)
    raised = relative**exponent
    return np.asarray(raised / raised.sum(axis=-1, keepdims=True))


def weighted_level(
    mode_probability: Floats, levels: Floats, exponent: float = PUBLISHED_EXPONENT
) -> Floats:
    """Weighted sum of the levels (thesis, eqs. 4.5.2-4.5.3), in their unit, shape (...).

    Args:
        mode_probability: (..., r).
        levels: (r,).
    """
    return np.asarray(mode_weights(mode_probability, exponent) @ levels)


def causal_moving_average(values: Floats, steps: int) -> Floats:
    """Mean of the last `steps` rows, of fewer at the beginning, (N, ...)."""
    return _window_mean(values, steps - 1, 0)


def centred_moving_average(values: Floats, steps: int) -> Floats:
    """Mean of `steps` rows around each row, of fewer at both ends; looks ahead, (N, ...).

    Of an even number of rows, one more lies before than after.
    """
    return _window_mean(values, steps // 2, (steps - 1) // 2)


def _window_mean(values: Floats, before: int, after: int) -> Floats:
    if before < 0 or after < 0:
        raise ValueError("moving average: the window must hold at least one step")
    sums = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    index = np.arange(len(values))
    start = np.maximum(index - before, 0)
    end = np.minimum(index + after + 1, len(values))
    counts = (end - start).reshape(-1, *([1] * (values.ndim - 1)))
    return np.asarray((sums[end] - sums[start]) / counts)
