"""The interacting bank of Kalman filters, live and over whole runs.

Banks of two states and two measurements run on the compiled kernel, others in numpy.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from ....messages.samples import Floats
from ....messages.stored import Stored
from . import filter_bank, general, kernel
from .filter_bank import BankOutput, LinearStep
from .general import BankState

_STORED: Stored[BankState] = Stored(BankState)
KALMAN: Floats = np.zeros(0)
"""Boundary that selects Kalman gains."""
_NO_LIKELIHOOD = "an innovation covariance is not positive definite, or an innovation overflows"


@dataclass(frozen=True, slots=True, eq=False)
class BankStart:
    """Initial values of a run: state (n,), covariance (n, n), mode probability (r,)."""

    state: Floats
    covariance: Floats
    mode_probability: Floats


class CompiledBank:
    """FilterBank with Kalman or sliding gains; see FilterBank for the methods.

    Args:
        boundary: delta of the sliding innovation filter (m,), or KALMAN.
    """

    def __init__(self, boundary: Floats = KALMAN) -> None:
        self._boundary = boundary
        self._state: BankState | None = None

    def reset(self, state: Floats, covariance: Floats, mode_probability: Floats) -> None:
        """Start every mode from one state."""
        self._state = start_state(BankStart(state, covariance, mode_probability))

    def step(self, step: LinearStep, measurement: Floats) -> BankOutput:
        """Predict and update; ValueError leaves the bank as it was."""
        if self._state is None:
            raise ValueError("step: the bank has no state yet; reset it first")
        run, state = _run(
            step, step.drive[None], np.asarray(measurement)[None], self._state, self._boundary
        )
        self._state = state
        return BankOutput(*(getattr(run, each.name)[0] for each in fields(BankOutput)))

    def snapshot(self) -> dict[str, Any]:
        """State as JSON-able values; empty before the first reset."""
        return {} if self._state is None else dict(_STORED.dump(self._state))

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Continue from a snapshot; ValueError if it is none."""
        state = _STORED.load(snapshot) if snapshot else None
        if state is not None:
            logs = state.log_mode_probability
            filter_bank.check_snapshot(state.states, state.covariances, logs)
            if not (logs <= 0.0).all():
                raise ValueError("snapshot: log_mode_probability must not exceed 0")
        self._state = state


class CompiledKalmanBank(CompiledBank):
    """Interacting Kalman filters (thesis, eqs. 4.4.1-4.4.6)."""

    def __init__(self) -> None:
        super().__init__(KALMAN)


def run_kalman_bank(
    step: LinearStep, drives: Floats, measurements: Floats, start: BankStart
) -> BankOutput:
    """Run a bank of Kalman filters over N steps that share all matrices but the drive.

    Args:
        step: the shared matrices; its own drive is not used.
        drives: (N, r, n).
        measurements: (N, m).

    Raises ValueError if an input or a result is not finite.
    """
    return run_bank(step, drives, measurements, start, KALMAN)


def run_bank(
    step: LinearStep, drives: Floats, measurements: Floats, start: BankStart, boundary: Floats
) -> BankOutput:
    """Run with the boundary (m,) of the sliding innovation filter, or KALMAN."""
    return _run(step, drives, measurements, start_state(start), boundary)[0]


def start_state(start: BankStart) -> BankState:
    """State of a bank with every mode at the same state."""
    filter_bank.check_start(start.state, start.covariance, start.mode_probability)
    modes = len(start.mode_probability)
    logs = np.full(modes, -np.inf)
    np.log(start.mode_probability, out=logs, where=start.mode_probability > 0.0)
    return BankState(
        np.repeat(start.state[None, :], modes, axis=0),
        np.repeat(start.covariance[None, :, :], modes, axis=0),
        logs,
    )


def _run(
    step: LinearStep, drives: Floats, measurements: Floats, state: BankState, boundary: Floats
) -> tuple[BankOutput, BankState]:
    """Outputs and new state after N steps from `state`, which stays as it is."""
    modes, size = state.states.shape
    sensors = len(step.observation)
    filter_bank.check_array("step.drive", step.drive, (modes, size))
    filter_bank.check_array("drives", drives, (len(drives), modes, size))
    filter_bank.check_array("measurements", measurements, (len(drives), sensors))
    if len(boundary) not in (0, sensors):
        raise ValueError(f"boundary: {len(boundary)} widths for {sensors} measurements")
    runner = _run_compiled if (size, sensors) == (2, 2) else _run_general
    run, state = runner(step, drives, measurements, state, boundary)
    filter_bank.check_result(
        run.log_likelihood, run.state, run.covariance, run.nis, state.covariances
    )
    return run, state


def _run_compiled(
    step: LinearStep, drives: Floats, measurements: Floats, state: BankState, boundary: Floats
) -> tuple[BankOutput, BankState]:
    count, modes = len(drives), len(state.states)
    packed = np.column_stack([state.states, state.covariances.reshape(modes, 4)[:, [0, 1, 3]]])
    logs = state.log_mode_probability.copy()
    history = kernel.History(*(np.zeros((count, width)) for width in (modes, modes, modes, 5)))
    inputs = (_row_major(drives), _row_major(measurements))
    done = kernel.run(_kernel_model(step, boundary), inputs, packed, logs, history)
    if done < count:
        raise ValueError(f"step {done}: {_NO_LIKELIHOOD}")
    combined = history.combined
    run = BankOutput(
        mode_probability=np.exp(history.log_probability),
        log_mode_probability=history.log_probability,
        log_likelihood=history.log_likelihood,
        state=combined[:, :2],
        covariance=combined[:, [2, 3, 3, 4]].reshape(count, 2, 2),
        nis=history.nis,
    )
    return run, BankState(packed[:, :2], packed[:, [2, 3, 3, 4]].reshape(modes, 2, 2), logs)


def _run_general(
    step: LinearStep, drives: Floats, measurements: Floats, state: BankState, boundary: Floats
) -> tuple[BankOutput, BankState]:
    outputs = []
    for k, (drive, measurement) in enumerate(zip(drives, measurements, strict=True)):
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                output, state = general.advance(
                    replace(step, drive=drive), boundary, measurement, state
                )
        except np.linalg.LinAlgError as error:
            raise ValueError(f"step {k}: {_NO_LIKELIHOOD}") from error
        outputs.append(output)
    columns = (
        np.array([getattr(output, each.name) for output in outputs]) for each in fields(BankOutput)
    )
    return BankOutput(*columns), state


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
    return np.require(values, np.float64, ("C", "W"))
