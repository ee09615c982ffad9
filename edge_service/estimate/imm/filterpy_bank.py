"""The interacting bank of Kalman filters on filterpy: slow, and an independent oracle.

filterpy's likelihoods underflow to one and the same smallest number, so where every mode is far
off its mode probabilities are wrong; it is used as it is. Its documentation has the mode
transition matrix transposed; its code reads row = from, as we do.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...messages.samples import Floats
from ...messages.stored import Stored, StoredFloats
from .bank import (
    NO_STATE,
    BankOutput,
    BankStart,
    LinearStep,
    require_finite,
    require_fitting,
    require_result,
)


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    """States (r, 2), covariances (r, 2, 2) and mu_j (r,)."""

    states: StoredFloats
    covariances: StoredFloats
    mode_probability: StoredFloats


_STORED: Stored[_State] = Stored(_State)


class FilterpyBank:
    """Filter bank on filterpy's IMMEstimator and KalmanFilter; methods as those of CompiledBank."""

    def __init__(self) -> None:
        self._state: _State | None = None

    def reset(self, start: BankStart) -> None:
        """Start every mode from one state."""
        modes = len(start.mode_probability)
        self._state = _State(
            np.repeat(start.state[None, :], modes, axis=0),
            np.repeat(start.covariance[None, :, :], modes, axis=0),
            start.mode_probability.copy(),
        )

    def step(self, step: LinearStep, measurement: Floats) -> BankOutput:
        """Predict and update; ValueError leaves the bank as it was."""
        from filterpy.kalman import IMMEstimator, KalmanFilter

        now = self._state
        if now is None:
            raise ValueError(NO_STATE)
        require_finite("step drive", step.drive, now.states.shape)
        require_finite("measurement", measurement, (2,))
        filters = []
        for mean, covariance, drive in zip(now.states, now.covariances, step.drive, strict=True):
            mode = KalmanFilter(dim_x=2, dim_z=2, dim_u=1)
            mode.x, mode.P = mean[:, None].copy(), covariance.copy()
            mode.F, mode.Q, mode.B = step.transition, step.process_noise, drive[:, None]
            mode.H, mode.R = step.observation, step.measurement_noise
            filters.append(mode)
        estimator = IMMEstimator(filters, now.mode_probability, step.mode_transition)
        try:
            with np.errstate(all="ignore"):
                estimator.predict(np.ones((1, 1)))
                estimator.update(measurement[:, None])
                output = _output(estimator)
        except np.linalg.LinAlgError as error:
            raise ValueError(f"step: {error}") from error
        require_result(output.mode_probability, output.log_likelihood, output.covariance)
        require_result(output.state, output.nis)
        self._state = _State(
            np.array([mode.x[:, 0] for mode in filters]),
            np.array([mode.P for mode in filters]),
            output.mode_probability,
        )
        return output

    def snapshot(self) -> dict[str, Any]:
        """State as JSON-able values; empty before the first reset."""
        return {} if self._state is None else dict(_STORED.dump(self._state))

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Continue from a snapshot; ValueError if it is none."""
        state = _STORED.load(snapshot) if snapshot else None
        if state is not None:
            require_fitting(state.states, state.covariances, state.mode_probability)
        self._state = state


def _output(estimator: Any) -> BankOutput:
    probability = np.asarray(estimator.mu, dtype=np.float64)
    logs = np.full(len(probability), -np.inf)
    np.log(probability, out=logs, where=probability > 0.0)
    return BankOutput(
        mode_probability=probability,
        log_mode_probability=logs,
        log_likelihood=np.array([float(mode.log_likelihood) for mode in estimator.filters]),
        state=estimator.x[:, 0].copy(),
        covariance=estimator.P.copy(),
        nis=np.array([(mode.y.T @ mode.SI @ mode.y).item() for mode in estimator.filters]),
    )
