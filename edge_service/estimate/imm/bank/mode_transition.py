"""Transitions between preload levels, and their scaling with the length of a step."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....messages.samples import Floats
from .filter_bank import check_mode_transition

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

_MOST_CONDITION = 100.0
"""Up to this condition of the eigenvectors a function of the eigenvalues is exact to 1e-13."""


def scaled_mode_transition(
    matrix: Floats, step_s: float, reference_s: float = REFERENCE_STEP_S
) -> Floats:
    """Mode transition for a step of another length: P^(T / T0) = exp(G T), G = log(P) / T0.

    The printed matrix is per step: left as it is at a tenth of the step, modes would jump ten times
    as often per second. If the real logarithm is no generator of a Markov chain (a negative rate),
    the negative rates are set to zero and the diagonal takes up the difference, so the result is
    then the closest simple chain and not an exact root.

    Args:
        matrix: p_ij for a step of `reference_s`, row = from, (r, r).
        step_s: length T of the step, s.

    Returns:
        p_ij for a step of `step_s`, (r, r).
    """
    if not (np.isfinite(step_s) and step_s > 0.0 and reference_s > 0.0):
        raise ValueError(f"step_s: {step_s:g}, expected a finite length above 0")
    scaled = np.maximum(_exponential(transition_rates(matrix, reference_s) * step_s), 0.0)
    return np.asarray(scaled / scaled.sum(axis=1, keepdims=True))


def transition_rates(matrix: Floats, reference_s: float = REFERENCE_STEP_S) -> Floats:
    """Generator G of the chain, 1/s, (r, r): off-diagonal >= 0, rows sum to 0.

    Raises ValueError where the matrix has no real logarithm.
    """
    check_mode_transition(matrix)
    if np.linalg.matrix_rank(matrix) < len(matrix):
        raise ValueError("mode_transition: singular, so it cannot be scaled to another step")
    logarithm = _logarithm(matrix)
    if np.abs(logarithm.imag).max() > 1e-9:
        raise ValueError("mode_transition: no real logarithm, so it cannot be scaled")
    rates = np.maximum(logarithm.real, 0.0) / reference_s
    np.fill_diagonal(rates, 0.0)
    np.fill_diagonal(rates, -rates.sum(axis=1))
    return np.asarray(rates)


def _logarithm(matrix: Floats) -> NDArray[Any]:
    """Principal logarithm, (r, r), complex where it is not real."""
    found = _of_eigenvalues(np.log, matrix)
    if found is None:
        from scipy.linalg import logm  # 16 MB, which the thesis' matrix does without

        found = np.asarray(logm(matrix))
    return found


def _exponential(matrix: Floats) -> Floats:
    found = _of_eigenvalues(np.exp, matrix)
    if found is None:
        from scipy.linalg import expm

        found = np.asarray(expm(matrix))
    return np.asarray(found.real)


def _of_eigenvalues(
    function: Callable[[NDArray[Any]], NDArray[Any]], matrix: Floats
) -> NDArray[Any] | None:
    """A function of a matrix from its eigenvectors; None where they are nearly parallel."""
    values, vectors = np.linalg.eig(matrix)
    if np.linalg.cond(vectors) > _MOST_CONDITION:
        return None
    return np.asarray((vectors * function(values.astype(complex))) @ np.linalg.inv(vectors))
