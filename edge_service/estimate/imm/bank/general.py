"""One step of an interacting filter bank of any size, over all modes at once in numpy.

The same equations as in `kernel`, for banks that are not of two states and two measurements.
"""

from dataclasses import dataclass

import numpy as np

from ....messages.samples import Floats
from ....messages.stored import Decimals, Logarithms
from .filter_bank import BankOutput, LinearStep

LOG_2PI = float(np.log(2.0 * np.pi))


@dataclass(frozen=True, slots=True, eq=False)
class BankState:
    """State of a bank: states (r, n), covariances (r, n, n), log mu_j (r,)."""

    states: Decimals
    covariances: Decimals
    log_mode_probability: Logarithms


def advance(
    step: LinearStep, boundary: Floats, measurement: Floats, prior: BankState
) -> tuple[BankOutput, BankState]:
    """One step with a measurement (m,).

    Args:
        boundary: delta of the sliding innovation filter (m,), or empty for Kalman gains.

    Raises numpy's LinAlgError if an innovation covariance is not positive definite.
    """
    weight, log_cbar = _mixing_weights(prior.log_mode_probability, step.mode_transition)
    mixed = [_moments(weight[:, j], prior.states, prior.covariances) for j in range(len(weight))]
    states = np.array([mean for mean, _ in mixed]) @ step.transition.T + step.drive
    covariances = np.array([covariance for _, covariance in mixed])
    covariances = step.transition @ covariances @ step.transition.T + step.process_noise
    innovation = measurement - states @ step.observation.T
    cross = covariances @ step.observation.T
    spread = step.observation @ cross + step.measurement_noise
    log_likelihood, nis = _likelihood(innovation, spread)
    if len(boundary):
        share = np.minimum(1.0, np.abs(innovation) / boundary)
        gain = np.linalg.pinv(step.observation) * share[:, None, :]
    else:
        gain = np.linalg.solve(spread, cross.swapaxes(1, 2)).swapaxes(1, 2)
    states = states + (gain @ innovation[:, :, None])[:, :, 0]
    correction = np.eye(states.shape[1]) - gain @ step.observation
    covariances = correction @ covariances @ correction.swapaxes(1, 2)
    covariances += gain @ step.measurement_noise @ gain.swapaxes(1, 2)
    covariances = 0.5 * (covariances + covariances.swapaxes(1, 2))
    log_probability = log_cbar + log_likelihood
    log_probability -= np.logaddexp.reduce(log_probability)
    probability = np.exp(log_probability)
    mean, covariance = _moments(probability, states, covariances)
    output = BankOutput(probability, log_probability, log_likelihood, mean, covariance, nis)
    return output, BankState(states, covariances, log_probability)


def _mixing_weights(log_probability: Floats, mode_transition: Floats) -> tuple[Floats, Floats]:
    """mu_{i|j} (r, r) (4.4.13) and log cbar_j (r,) (4.4.14); an unreachable mode is not mixed."""
    with np.errstate(divide="ignore"):
        joint = np.log(mode_transition) + log_probability[:, None]
    log_cbar = np.logaddexp.reduce(joint, axis=0)
    reachable = np.isfinite(log_cbar)
    weight = np.where(
        reachable, np.exp(joint - np.where(reachable, log_cbar, 0.0)), np.eye(len(joint))
    )
    return weight, log_cbar


def _moments(weight: Floats, states: Floats, covariances: Floats) -> tuple[Floats, Floats]:
    """Mean (n,) and covariance (n, n) of a mixture (thesis, eqs. 4.4.15-16, 4.4.21-22)."""
    mean = weight @ states
    spread = states - mean
    covariance = np.tensordot(weight, covariances, axes=1) + (weight * spread.T) @ spread
    return mean, covariance


def _likelihood(innovation: Floats, spread: Floats) -> tuple[Floats, Floats]:
    """log Lambda_j (thesis, eq. 4.4.17) and NIS, (r,), of innovations (r, m) with S (r, m, m)."""
    factor = np.linalg.cholesky(spread)
    whitened = np.linalg.solve(factor, innovation[:, :, None])[:, :, 0]
    nis = (whitened**2).sum(axis=1)
    half_log_determinant = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
    return -0.5 * (nis + innovation.shape[1] * LOG_2PI) - half_log_determinant, nis
