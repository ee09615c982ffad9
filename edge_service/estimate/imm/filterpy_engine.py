"""The interacting bank of Kalman filters on filterpy: slow, and an independent oracle.

filterpy's likelihoods underflow to one and the same smallest number, so where every mode is far
off its mode probabilities are wrong; it is used as it is. Its documentation has the mode
transition matrix transposed; its code reads row = from, as we do.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...messages.samples import Floats
from . import filter_bank
from .filter_bank import BankOutput, LinearStep


class FilterpyBank:
    """FilterBank on filterpy's IMMEstimator and KalmanFilter; see FilterBank for the methods."""

    def __init__(self) -> None:
        self._forget()

    def _forget(self) -> None:
        self._states: Floats = np.zeros((0, 0))
        self._covariances: Floats = np.zeros((0, 0, 0))
        self._mode_probability: Floats = np.zeros(0)

    def reset(self, state: Floats, covariance: Floats, mode_probability: Floats) -> None:
        """Start every mode from one state; filterpy needs at least two modes."""
        filter_bank.check_start(state, covariance, mode_probability)
        modes = len(mode_probability)
        if modes < 2:
            raise ValueError("filterpy: at least two modes are needed")
        self._states = np.repeat(state[None, :], modes, axis=0)
        self._covariances = np.repeat(covariance[None, :, :], modes, axis=0)
        self._mode_probability = mode_probability.copy()

    def step(self, step: LinearStep, measurement: Floats) -> BankOutput:
        """Predict and update; ValueError leaves the bank as it was."""
        if not len(self._states):
            raise ValueError("step: the bank has no state yet; reset it first")
        filter_bank.check_fit(step, measurement, self._states)
        estimator = self._estimator(step)
        try:
            with np.errstate(all="ignore"):
                estimator.predict(np.ones((1, 1)))
                estimator.update(measurement[:, None])
                output = _output(estimator)
        except np.linalg.LinAlgError as error:
            raise ValueError(f"step: {error}") from error
        filter_bank.check_result(output.mode_probability, output.log_likelihood, output.covariance)
        filter_bank.check_result(output.state, output.nis)
        self._states = np.array([mode.x[:, 0] for mode in estimator.filters])
        self._covariances = np.array([mode.P for mode in estimator.filters])
        self._mode_probability = output.mode_probability
        return output

    def _estimator(self, step: LinearStep) -> Any:
        from filterpy.kalman import IMMEstimator, KalmanFilter

        filters = []
        for state, covariance, drive in zip(
            self._states, self._covariances, step.drive, strict=True
        ):
            mode = KalmanFilter(dim_x=len(state), dim_z=len(step.observation), dim_u=1)
            mode.x, mode.P = state[:, None].copy(), covariance.copy()
            mode.F, mode.Q, mode.B = step.transition, step.process_noise, drive[:, None]
            mode.H, mode.R = step.observation, step.measurement_noise
            filters.append(mode)
        return IMMEstimator(filters, self._mode_probability, step.mode_transition)

    def snapshot(self) -> dict[str, Any]:
        """State as JSON-able values; empty before the first reset."""
        if not len(self._states):
            return {}
        return {
            "states": self._states.tolist(),
            "covariances": self._covariances.tolist(),
            "mode_probability": self._mode_probability.tolist(),
        }

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Go on from a snapshot."""
        if not snapshot:
            self._forget()
            return
        try:
            states, covariances, mode_probability = (
                np.array(snapshot[key], dtype=np.float64)
                for key in ("states", "covariances", "mode_probability")
            )
            modes, size = states.shape
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"snapshot: not one of a filterpy bank ({error})") from error
        filter_bank.check_array("snapshot states", states, (modes, size))
        filter_bank.check_array("snapshot covariances", covariances, (modes, size, size))
        filter_bank.check_array("snapshot mode_probability", mode_probability, (modes,))
        self._states, self._covariances = states, covariances
        self._mode_probability = mode_probability


def _output(estimator: Any) -> BankOutput:
    nis = [float((mode.y.T @ mode.SI @ mode.y).item()) for mode in estimator.filters]
    probability = np.asarray(estimator.mu, dtype=np.float64)
    logs = np.full(len(probability), -np.inf)
    np.log(probability, out=logs, where=probability > 0.0)
    return BankOutput(
        mode_probability=probability,
        log_mode_probability=logs,
        log_likelihood=np.array([float(mode.log_likelihood) for mode in estimator.filters]),
        state=estimator.x[:, 0].copy(),
        covariance=estimator.P.copy(),
        nis=np.array(nis),
    )
