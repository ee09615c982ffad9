"""Transitions between preload levels, and their scaling with the length of a step."""

from functools import lru_cache

import numpy as np

from ...messages.samples import Floats

LEVELS_PERCENT = (10.0, 7.5, 5.0, 2.5, 0.0)
"""Preload of the five modes, percent of the dynamic load rating (thesis, section 4.5)."""

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
