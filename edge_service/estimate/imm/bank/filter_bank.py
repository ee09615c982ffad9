"""A bank of linear filters, one per mode, that interact (IMM; thesis, section 4.4.3)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ....messages.samples import Floats

PROBABILITY_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class LinearStep:
    """One prediction and measurement of r modes with n states and m measurements.

    Attributes:
        transition: A of thesis eq. 4.4.1, (n, n).
        drive: B u_hat_j, the known input of each mode as it adds to the state, (r, n).
        process_noise: Q of thesis eq. 4.4.2, (n, n).
        observation: C of thesis eq. 4.4.3, (m, n).
        measurement_noise: R of thesis eq. 4.4.3, (m, m).
        mode_transition: p_ij of thesis eq. 4.4.13, (r, r); row = from, already scaled to this step.
    """

    transition: Floats
    drive: Floats
    process_noise: Floats
    observation: Floats
    measurement_noise: Floats
    mode_transition: Floats

    def __post_init__(self) -> None:
        if self.drive.ndim != 2:
            raise ValueError(f"drive: shape {self.drive.shape}, expected (modes, states)")
        modes, states = self.drive.shape
        measurements = len(self.observation)
        check_array("transition", self.transition, (states, states))
        check_array("drive", self.drive, (modes, states))
        check_array("process_noise", self.process_noise, (states, states))
        check_array("observation", self.observation, (measurements, states))
        check_array("measurement_noise", self.measurement_noise, (measurements, measurements))
        check_array("mode_transition", self.mode_transition, (modes, modes))
        check_mode_transition(self.mode_transition)
        check_symmetric("process_noise", self.process_noise)
        check_symmetric("measurement_noise", self.measurement_noise)


@dataclass(frozen=True, slots=True, eq=False)
class BankOutput:
    """Output of the bank after one step; of a run of N steps, each array has N rows of it.

    Attributes:
        mode_probability: mu_j (thesis, eq. 4.4.19), (r,).
        log_mode_probability: the same in logs, where small ones do not underflow, (r,).
        log_likelihood: log Lambda_j (thesis, eq. 4.4.18), (r,).
        state: combined state (thesis, eq. 4.4.21), (n,).
        covariance: combined covariance (thesis, eq. 4.4.22), (n, n).
        nis: normalised innovation squared of each mode, (r,).
    """

    mode_probability: Floats
    log_mode_probability: Floats
    log_likelihood: Floats
    state: Floats
    covariance: Floats
    nis: Floats


class FilterBank(Protocol):
    """A filter bank behind one of the engines."""

    def reset(self, state: Floats, covariance: Floats, mode_probability: Floats) -> None:
        """Start every mode from one state (n,) and covariance (n, n), with mu_j (r,)."""

    def step(self, step: LinearStep, measurement: Floats) -> BankOutput:
        """Predict and update with a measurement (m,).

        Raises ValueError, with the bank as it was before, if the input or the result is not finite.
        """

    def snapshot(self) -> dict[str, Any]:
        """Everything that the next step depends on, as JSON-able values."""

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Go on from a snapshot, bit for bit."""


def check_array(name: str, values: Floats, shape: tuple[int, ...]) -> None:
    """Raise ValueError unless `values` has `shape` and is finite."""
    if values.shape != shape or 0 in shape:
        raise ValueError(f"{name}: shape {values.shape}, expected {shape}")
    if not np.isfinite(values).all():
        raise ValueError(f"{name}: not finite")


def check_symmetric(name: str, matrix: Floats) -> None:
    """Raise ValueError unless the matrix is symmetric up to rounding."""
    if np.abs(matrix - matrix.T).max() > 1e-9 * np.abs(matrix).max():
        raise ValueError(f"{name}: not symmetric")


def check_mode_transition(matrix: Floats) -> None:
    """Raise ValueError unless rows are probability distributions (row = from)."""
    if (matrix < 0.0).any() or np.abs(matrix.sum(axis=1) - 1.0).max() > PROBABILITY_TOLERANCE:
        raise ValueError("mode_transition: every row must be non-negative and sum to 1")


def check_start(state: Floats, covariance: Floats, mode_probability: Floats) -> None:
    """Raise ValueError unless a bank can start from these (shapes as in FilterBank.reset)."""
    check_array("state", state, (state.size,))
    check_array("covariance", covariance, (state.size, state.size))
    check_array("mode_probability", mode_probability, (mode_probability.size,))
    if (mode_probability < 0.0).any() or abs(mode_probability.sum() - 1.0) > PROBABILITY_TOLERANCE:
        raise ValueError("mode_probability: must be non-negative and sum to 1")
    check_symmetric("covariance", covariance)
    if np.linalg.eigvalsh(covariance)[0] < -1e-12 * np.abs(covariance).max():
        raise ValueError("covariance: not positive semi-definite")


def check_fit(step: LinearStep, measurement: Floats, states: Floats) -> None:
    """Raise ValueError unless step and measurement fit a bank with states (r, n)."""
    if step.drive.shape != states.shape:
        raise ValueError(f"step: (modes, states) {step.drive.shape}, the bank has {states.shape}")
    check_array("measurement", measurement, (len(step.observation),))


def check_result(*results: Floats) -> None:
    """Raise ValueError if a step produced a number that cannot be passed on."""
    if not all(np.isfinite(values).all() for values in results):
        raise ValueError("step: the result is not finite; the bank keeps its state")


def check_snapshot(states: Floats, covariances: Floats, probability: Floats) -> None:
    """Raise ValueError unless the arrays of a snapshot fit together, (r, n), (r, n, n) and (r,)."""
    if states.ndim != 2:
        raise ValueError(f"snapshot states: shape {states.shape}, expected (modes, states)")
    modes, size = states.shape
    check_array("snapshot states", states, (modes, size))
    check_array("snapshot covariances", covariances, (modes, size, size))
    if probability.shape != (modes,) or np.isnan(probability).any():
        raise ValueError("snapshot: one probability per mode is needed")
