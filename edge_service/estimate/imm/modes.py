"""The modes: preload levels, transitions between them, and the weighting of their probabilities."""

from functools import lru_cache

import numpy as np

from ...messages.samples import Floats

LEVELS_PERCENT = (10.0, 7.5, 5.0, 2.5, 0.0)
"""Preload of the five modes, percent of the dynamic load rating (thesis, section 4.5)."""
LEVEL_NAMES = tuple(f"{level:g}" for level in LEVELS_PERCENT)

REFERENCE_STEP_S = 0.1
"""Step for which the thesis' transition matrix and process noise hold (Table 4.1)."""

THESIS_MODE_TRANSITION: Floats = np.array(
    [
        [0.80, 0.08, 0.06, 0.04, 0.02],
        [0.07, 0.80, 0.07, 0.04, 0.02],
        [0.04, 0.06, 0.80, 0.06, 0.04],
        [0.02, 0.04, 0.07, 0.80, 0.07],
        [0.02, 0.04, 0.06, 0.08, 0.80],
    ]
)
"""p_ij per step of 0.1 s (thesis, eq. 4.5.1), row = from, (5, 5)."""
THESIS_MODE_TRANSITION.setflags(write=False)

PUBLISHED_EXPONENT = 1.33
"""Exponent of the thesis' simulations (section 4.5)."""


@lru_cache(maxsize=256)
def scaled_mode_transition(step_s: float) -> Floats:
    """Mode transition for a step of another length, s: P^(T / T0) = exp(G T), G = log(P) / T0.

    The printed matrix is per step: left as it is at a tenth of the step, modes would jump ten times
    as often per second. Its logarithm is the generator of a Markov chain: real, with rates above 0.
    """
    if not (np.isfinite(step_s) and step_s > 0.0):
        raise ValueError(f"step_s: {step_s:g}, expected a finite length above 0")
    values, vectors = np.linalg.eig(THESIS_MODE_TRANSITION)
    logarithm = (vectors * np.log(values.astype(complex))) @ np.linalg.inv(vectors)
    rates = np.maximum(logarithm.real, 0.0) / REFERENCE_STEP_S
    np.fill_diagonal(rates, 0.0)
    np.fill_diagonal(rates, -rates.sum(axis=1))
    values, vectors = np.linalg.eig(rates * step_s)
    exponential = (vectors * np.exp(values.astype(complex))) @ np.linalg.inv(vectors)
    scaled = np.maximum(exponential.real, 0.0)
    return np.asarray(scaled / scaled.sum(axis=1, keepdims=True))


def weighted_level(
    mode_probability: Floats, levels: Floats, exponent: float = PUBLISHED_EXPONENT
) -> Floats:
    """Sum of the levels weighted by mu_j^a / sum_j mu_j^a, in their unit, shape (...).

    Thesis, eqs. 4.5.2-4.5.4, for any exponent a > 0; a = 1 leaves the probabilities as they are.

    Args:
        mode_probability: (..., r), at least one above zero in each row.
        levels: (r,).
        exponent: a. Raises ValueError.
    """
    if not (np.isfinite(exponent) and exponent > 0.0):
        raise ValueError(f"activation exponent: {exponent:g}, expected a number above 0")
    relative = mode_probability / mode_probability.max(axis=-1, keepdims=True)
    raised = relative**exponent
    return np.asarray(raised / raised.sum(axis=-1, keepdims=True) @ levels)


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
