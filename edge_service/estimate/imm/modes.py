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

PUBLISHED_EXPONENT = 1.33  # exponent of the thesis' simulations (section 4.5)


@lru_cache(maxsize=256)
def scaled_mode_transition(step_s: float) -> Floats:
    """Mode transition for a step of another length, s: P^(T / T0), a Markov chain for every T.

    The printed matrix is per step: left as it is at a tenth of the step, modes would jump ten times
    as often per second. Its logarithm, the chain's generator, is real, with rates above 0.
    """
    if not (np.isfinite(step_s) and step_s > 0.0):
        raise ValueError(f"step_s: {step_s:g}, expected a finite length above 0")
    scaled, exponent = THESIS_MODE_TRANSITION, step_s / REFERENCE_STEP_S
    if exponent != 1.0:
        rates, modes = np.linalg.eig(scaled)
        scaled = modes * rates**exponent @ np.linalg.inv(modes)
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
    raised = (mode_probability / mode_probability.max(axis=-1, keepdims=True)) ** exponent
    return np.asarray(raised / raised.sum(axis=-1, keepdims=True) @ levels)


def moving_average(values: Floats, steps: int, ahead: int = 0) -> Floats:
    """Mean of `steps` rows, `ahead` of them after the row itself, of fewer at the ends, (N, ...).

    Raises ValueError: `steps` does not exceed `ahead`.
    """
    if not 0 <= ahead < steps:
        raise ValueError("moving average: the window must hold the step itself")
    sums = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    index = np.arange(len(values))
    start = np.maximum(index - steps + 1 + ahead, 0)
    end = np.minimum(index + ahead + 1, len(values))
    counts = (end - start).reshape(-1, *([1] * (values.ndim - 1)))
    return np.asarray((sums[end] - sums[start]) / counts)
