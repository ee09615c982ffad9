"""Interacting filters of two states and two measurements, one per mode (IMM; thesis, 4.4.3).

`CompiledBank` runs the kernel. `FilterpyBank` is slow, and an independent oracle: filterpy's
likelihoods underflow to one and the same smallest number, so where every mode is far off its mode
probabilities are wrong. Its documentation has the mode transition matrix transposed; its code reads
row = from, as we do.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ...messages.samples import Floats
from ...messages.stored import Stored, StoredFloats
from . import kernel

KALMAN: Floats = np.zeros(0)
"""Boundary that selects Kalman gains."""


@dataclass(frozen=True, slots=True, eq=False)
class LinearStep:
    """One prediction and measurement of r modes (thesis, eqs. 4.4.1-3, 4.4.13)."""

    transition: Floats  # A, (2, 2)
    drive: Floats  # B u_hat_j, the known input of each mode as it adds to the state, (r, 2)
    process_noise: Floats  # Q, (2, 2)
    observation: Floats  # C, (2, 2)
    measurement_noise: Floats  # R, (2, 2)
    mode_transition: Floats  # p_ij, (r, r); row = from, already scaled to this step


@dataclass(frozen=True, slots=True, eq=False)
class BankStart:
    """Start of every mode: state (2,), covariance (2, 2), mode probability (r,)."""

    state: Floats
    covariance: Floats
    mode_probability: Floats


@dataclass(frozen=True, slots=True, eq=False)
class BankOutput:
    """Output of the bank after one step; of a run of N steps, each array has N rows of it."""

    mode_probability: Floats  # mu_j (thesis, eq. 4.4.19), (r,)
    log_mode_probability: Floats  # the same in logs, where small ones do not underflow, (r,)
    log_likelihood: Floats  # log Lambda_j (thesis, eq. 4.4.18), (r,)
    state: Floats  # combined (thesis, eq. 4.4.21), (2,)
    covariance: Floats  # combined (thesis, eq. 4.4.22), (2, 2)
    nis: Floats  # normalised innovation squared of each mode, (r,)


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    """States (r, 2), covariances (r, 2, 2), log mu_j (r,)."""

    states: StoredFloats
    covariances: StoredFloats
    log_mode_probability: StoredFloats


_STORED: Stored[_State] = Stored(_State)


class CompiledBank:
    """Filter bank with Kalman gains (eq. 4.4.4) or K = C^+ sat(|e| / delta) (eqs. 4.4.7-4.4.12).

    `boundary` is delta of the sliding innovation filter, per measurement (2,), or KALMAN.
    """

    def __init__(self, boundary: Floats = KALMAN) -> None:
        self._boundary = boundary
        self._state: _State | None = None

    def reset(self, start: BankStart) -> None:
        """Start every mode from one state."""
        self._state = _started(start)

    def step(self, step: LinearStep, measurement: Floats) -> BankOutput:
        """Predict and update with a measurement (2,).

        ValueError, with the bank as it was before, if the input or the result is not finite.
        """
        if self._state is None:
            raise ValueError("step: the bank has no state yet; reset it first")
        output, self._state = self._stepped(step, measurement, self._state)
        return output

    def _stepped(self, step: LinearStep, seen: Floats, now: _State) -> tuple[BankOutput, _State]:
        run, state = _run(step, step.drive[None], seen[None], now, self._boundary)
        return BankOutput(*(getattr(run, name)[0] for name in BankOutput.__slots__)), state

    def snapshot(self) -> dict[str, Any]:
        """State as JSON-able values; empty before the first reset."""
        return {} if self._state is None else dict(_STORED.dump(self._state))

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Continue from a snapshot; ValueError if it is none."""
        state = _STORED.load(snapshot) if snapshot else None
        if state is not None:
            _require_fitting(*(getattr(state, each.name) for each in fields(state)))
        self._state = state


class FilterpyBank(CompiledBank):
    """The bank with Kalman gains on filterpy's IMMEstimator and KalmanFilter."""

    def _stepped(self, step: LinearStep, seen: Floats, now: _State) -> tuple[BankOutput, _State]:
        from filterpy.kalman import IMMEstimator, KalmanFilter

        _require_finite("step drive", step.drive, now.states.shape)
        _require_finite("measurement", seen, (2,))
        filters = []
        for mean, covariance, drive in zip(now.states, now.covariances, step.drive, strict=True):
            mode = KalmanFilter(dim_x=2, dim_z=2, dim_u=1)
            mode.x, mode.P = mean[:, None].copy(), covariance.copy()
            mode.F, mode.Q, mode.B = step.transition, step.process_noise, drive[:, None]
            mode.H, mode.R = step.observation, step.measurement_noise
            filters.append(mode)
        probability = np.exp(now.log_mode_probability)
        estimator = IMMEstimator(filters, probability, step.mode_transition)
        try:
            with np.errstate(all="ignore"):
                estimator.predict(np.ones((1, 1)))
                estimator.update(seen[:, None])
                probability = np.asarray(estimator.mu, dtype=np.float64)
                output = BankOutput(
                    mode_probability=probability,
                    log_mode_probability=_logs(probability),
                    log_likelihood=np.array([float(mode.log_likelihood) for mode in filters]),
                    state=estimator.x[:, 0].copy(),
                    covariance=estimator.P.copy(),
                    nis=np.array([(mode.y.T @ mode.SI @ mode.y).item() for mode in filters]),
                )
        except np.linalg.LinAlgError as error:
            raise ValueError(f"step: {error}") from error
        _require_result(probability, output.log_likelihood, output.covariance)
        _require_result(output.state, output.nis)
        states = np.array([mode.x[:, 0] for mode in filters])
        return output, _State(states, np.array([f.P for f in filters]), output.log_mode_probability)


def run_bank(
    step: LinearStep,
    drives: Floats,
    measurements: Floats,
    start: BankStart,
    boundary: Floats = KALMAN,
) -> BankOutput:
    """Run a bank over N steps that share all matrices but the drive; `step`'s own is not used.

    `drives` are (N, r, 2), `measurements` (N, 2). Raises ValueError if an input or a result is not
    finite.
    """
    return _run(step, drives, measurements, _started(start), boundary)[0]


def _started(start: BankStart) -> _State:
    """State of modes that start alike."""
    modes, logs = len(start.mode_probability), _logs(start.mode_probability)
    return _State(np.tile(start.state, (modes, 1)), np.tile(start.covariance, (modes, 1, 1)), logs)


def _logs(probability: Floats) -> Floats:
    return np.log(probability, out=np.full(len(probability), -np.inf), where=probability > 0.0)


def _run(
    step: LinearStep, drives: Floats, measurements: Floats, state: _State, boundary: Floats
) -> tuple[BankOutput, _State]:
    """Outputs and new state after N steps from `state`, which stays as it is."""
    count, modes = len(drives), len(state.states)
    _require_finite("drives", drives, (count, modes, 2))
    _require_finite("measurements", measurements, (count, 2))
    packed = np.column_stack([state.states, state.covariances.reshape(modes, 4)[:, [0, 1, 3]]])
    logs = state.log_mode_probability.copy()
    history = kernel.History(*(np.zeros((count, width)) for width in (modes, modes, modes, 5)))
    inputs = (_row_major(drives), _row_major(measurements))
    done = kernel.run(_kernel_model(step, boundary), inputs, packed, logs, history)
    if done < count:
        raise ValueError(
            f"step {done}: an innovation covariance is not positive definite, or an innovation "
            "overflows"
        )
    combined = history.combined
    run = BankOutput(
        mode_probability=np.exp(history.log_probability),
        log_mode_probability=history.log_probability,
        log_likelihood=history.log_likelihood,
        state=combined[:, :2],
        covariance=combined[:, [2, 3, 3, 4]].reshape(count, 2, 2),
        nis=history.nis,
    )
    state = _State(packed[:, :2], packed[:, [2, 3, 3, 4]].reshape(modes, 2, 2), logs)
    _require_result(run.log_likelihood, run.state, run.covariance, run.nis, state.covariances)
    return run, state


def _kernel_model(step: LinearStep, boundary: Floats) -> kernel.Model:
    """The kernel's view of the shared matrices of a step; symmetric ones by their upper half."""
    sliding = len(boundary) > 0
    inverse = np.linalg.pinv(step.observation) if sliding else step.observation.T
    return kernel.Model(
        transition=_matrix(step.transition),
        process_noise=_symmetric(step.process_noise),
        observation=_matrix(step.observation),
        measurement_noise=_symmetric(step.measurement_noise),
        mode_transition=_row_major(step.mode_transition),
        sliding=sliding,
        boundary=(float(boundary[0]), float(boundary[1])) if sliding else (1.0, 1.0),
        pseudo_inverse=_matrix(inverse),
    )


def _matrix(values: Any) -> kernel.Matrix:
    return float(values[0, 0]), float(values[0, 1]), float(values[1, 0]), float(values[1, 1])


def _symmetric(values: Floats) -> kernel.Symmetric:
    return float(values[0, 0]), float(values[0, 1]), float(values[1, 1])


def _row_major(values: Floats) -> Floats:
    """One memory layout, so that the kernel is compiled once; never read-only."""
    is_so = values.flags.carray and values.dtype == np.float64
    return values if is_so else np.require(values, np.float64, ("C", "W"))


def _require_finite(name: str, values: Floats, shape: tuple[int, ...]) -> None:
    """Require an array of a shape without NaN and infinity; ValueError otherwise."""
    if values.shape != shape:
        raise ValueError(f"{name}: shape {values.shape}, expected {shape}")
    if not np.isfinite(values).all():
        raise ValueError(f"{name}: not finite")


def _require_result(*results: Floats) -> None:
    """Require results that can be passed on; ValueError otherwise."""
    if not np.isfinite(np.concatenate([values.ravel() for values in results])).all():
        raise ValueError("step: the result is not finite; the bank keeps its state")


def _require_fitting(states: Floats, covariances: Floats, logs: Floats) -> None:
    """Require arrays of a snapshot that fit together, (r, 2), (r, 2, 2), (r,)."""
    modes = len(states)
    _require_finite("snapshot states", states, (modes, 2))
    _require_finite("snapshot covariances", covariances, (modes, 2, 2))
    if logs.shape != (modes,) or not (logs <= 0.0).all():
        raise ValueError("snapshot: one probability per mode is needed")
