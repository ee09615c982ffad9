"""Compiled kernel against plain Python, numpy and filterpy."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from edge_service.estimate.imm.bank import general, kernel
from edge_service.estimate.imm.bank.engines import make_filter_bank
from edge_service.estimate.imm.bank.filter_bank import BankOutput, LinearStep
from edge_service.estimate.imm.bank.kalman import (
    BankStart,
    run_bank,
    run_kalman_bank,
    start_state,
)
from edge_service.estimate.imm.bank.mode_transition import (
    THESIS_MODE_TRANSITION,
    scaled_mode_transition,
)
from edge_service.estimate.imm.bank.sliding_innovation import run_sliding_innovation_bank
from edge_service.offline.reproduce.simulation import ThesisCase, bank_inputs, run_case

LOG_SMALLEST = -700.0
"""Below this, filterpy's likelihoods are no longer what they should be."""


def assert_runs_equal(first: BankOutput, second: BankOutput, tolerance: float) -> None:
    for name in ("mode_probability", "log_likelihood", "state", "covariance", "nis"):
        np.testing.assert_allclose(
            getattr(first, name), getattr(second, name), rtol=tolerance, atol=tolerance
        )


def filterpy_run(step: LinearStep, drives: Any, measurements: Any, start: BankStart) -> BankOutput:
    bank = make_filter_bank("kf-imm", "filterpy")
    bank.reset(start.state, start.covariance, start.mode_probability)
    outputs = [
        bank.step(replace(step, drive=drive), measurement)
        for drive, measurement in zip(drives, measurements, strict=True)
    ]
    return BankOutput(
        **{
            name: np.array([getattr(output, name) for output in outputs])
            for name in BankOutput.__slots__
        }
    )


def assert_filterpy_agrees(case: ThesisCase, seed: int, steps: int) -> None:
    run, _ = run_case(case, seed)
    step, drives, start = bank_inputs(case, run)
    inputs = (step, drives[:steps], run.measurement[:steps], start)
    ours, theirs = run_kalman_bank(*inputs), filterpy_run(*inputs)
    underflow = (theirs.log_likelihood < LOG_SMALLEST).any(axis=1)
    comparable = int(np.argmax(underflow)) if underflow.any() else steps
    assert comparable >= 0.95 * steps
    names = BankOutput.__slots__
    assert_runs_equal(
        BankOutput(**{name: getattr(ours, name)[:comparable] for name in names}),
        BankOutput(**{name: getattr(theirs, name)[:comparable] for name in names}),
        1e-9,
    )


@pytest.mark.parametrize("simulation", [1, 2, 3, 4])
def test_filterpy_agrees_on_the_simulations(simulation: int) -> None:
    assert_filterpy_agrees(ThesisCase(simulation), seed=10 + simulation, steps=200)


@pytest.mark.slow
@pytest.mark.parametrize(("simulation", "seed"), [(1, 0), (2, 1), (3, 2), (4, 0)])
def test_filterpy_agrees_over_whole_runs(simulation: int, seed: int) -> None:
    assert_filterpy_agrees(ThesisCase(simulation), seed, steps=1000)


def test_filterpy_agrees_with_the_printed_three_states() -> None:
    assert_filterpy_agrees(ThesisCase(1, printed_states=True), seed=3, steps=100)


@pytest.mark.parametrize("seed", range(4))
def test_filterpy_agrees_on_random_problems(seed: int, make_problem: Callable[..., Any]) -> None:
    problem = make_problem(seed)
    inputs = (problem.step, problem.drives, problem.measurements, problem.start)
    ours, theirs = run_kalman_bank(*inputs), filterpy_run(*inputs)
    assert (theirs.log_likelihood > LOG_SMALLEST).all()
    assert_runs_equal(ours, theirs, 1e-9)


def test_modes_far_from_the_truth_do_not_underflow() -> None:
    """The odds are the difference of the log-likelihoods where filterpy reads one half each."""
    step = LinearStep(
        transition=np.eye(2),
        drive=np.array([[100.0, 0.0], [200.0, 0.0]]),
        process_noise=np.eye(2) * 1e-2,
        observation=np.eye(2),
        measurement_noise=np.eye(2) * 1e-2,
        mode_transition=np.eye(2),
    )
    start = BankStart(np.zeros(2), np.eye(2), np.array([0.5, 0.5]))
    run = run_kalman_bank(step, step.drive[None], np.zeros((1, 2)), start)
    spread = np.array([1.0 + 1e-2 + 1e-2] * 2)
    expected = 0.5 * (200.0**2 - 100.0**2) / spread[0]
    odds = run.log_mode_probability[0, 0] - run.log_mode_probability[0, 1]
    assert odds == pytest.approx(expected, rel=1e-12)
    assert filterpy_run(step, step.drive[None], np.zeros((1, 2)), start).mode_probability[
        0
    ].tolist() == [0.5, 0.5]


def test_an_almost_impossible_mode_keeps_its_own_filter() -> None:
    """With no transitions, mixing weights must not vanish with the probability of a mode."""
    base = {
        "transition": np.eye(2),
        "process_noise": np.eye(2) * 1e-2,
        "observation": np.eye(2),
        "measurement_noise": np.eye(2) * 1e-2,
        "mode_transition": np.eye(2),
    }
    drives = np.zeros((30, 2, 2))
    drives[:, 1, 0] = 50.0
    start = BankStart(np.zeros(2), np.eye(2), np.array([0.5, 0.5]))
    both = run_kalman_bank(LinearStep(drive=drives[0], **base), drives, np.zeros((30, 2)), start)
    assert both.log_mode_probability[-1, 1] < -10_000.0
    alone = run_kalman_bank(
        LinearStep(drive=drives[0, 1:], **(base | {"mode_transition": np.ones((1, 1))})),
        drives[:, 1:],
        np.zeros((30, 2)),
        replace(start, mode_probability=np.ones(1)),
    )
    np.testing.assert_allclose(both.nis[:, 1], alone.nis[:, 0], rtol=1e-12)


def test_an_unreachable_mode_has_probability_zero() -> None:
    run, _ = run_case(ThesisCase(1), 0)
    step, drives, start = bank_inputs(ThesisCase(1), run)
    closed = np.eye(5)
    closed[:4, :4] = 0.05 + 0.8 * np.eye(4)
    start = replace(start, mode_probability=np.array([0.25, 0.25, 0.25, 0.25, 0.0]))
    result = run_kalman_bank(
        replace(step, mode_transition=closed), drives[:50], run.measurement[:50], start
    )
    assert (result.mode_probability[:, 4] == 0.0).all()
    np.testing.assert_allclose(result.mode_probability.sum(axis=1), 1.0, atol=1e-12)


@pytest.mark.parametrize("sliding", [False, True])
def test_machine_code_equals_python(
    sliding: bool, make_problem: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = make_problem(9, count=200)
    boundary = np.array([0.4, 0.9]) if sliding else np.zeros(0)
    inputs = (problem.step, problem.drives, problem.measurements, problem.start, boundary)
    machine_code = run_bank(*inputs)
    for name, function in vars(kernel).copy().items():
        if hasattr(function, "py_func"):
            monkeypatch.setattr(kernel, name, function.py_func)
    assert not hasattr(kernel.run, "py_func")
    assert_runs_equal(machine_code, run_bank(*inputs), 1e-12)


@pytest.mark.parametrize("sliding", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_kernel_equals_numpy(seed: int, sliding: bool, make_problem: Callable[..., Any]) -> None:
    problem = make_problem(seed, modes=seed + 1)
    boundary = np.array([0.4, 0.9]) if sliding else np.zeros(0)
    compiled = run_bank(problem.step, problem.drives, problem.measurements, problem.start, boundary)
    state = start_state(problem.start)
    for k, (step, measurement) in enumerate(problem.steps()):
        output, state = general.advance(step, boundary, measurement, state)
        for name in BankOutput.__slots__:
            np.testing.assert_allclose(
                getattr(compiled, name)[k], getattr(output, name), rtol=1e-9, atol=1e-11
            )


def test_single_steps_equal_the_batch_bit_for_bit(make_problem: Callable[..., Any]) -> None:
    problem = make_problem(11)
    batch = run_kalman_bank(problem.step, problem.drives, problem.measurements, problem.start)
    bank = make_filter_bank("kf-imm")
    start = problem.start
    bank.reset(start.state, start.covariance, start.mode_probability)
    for k, (step, measurement) in enumerate(problem.steps()):
        output = bank.step(step, measurement)
        for name in ("log_mode_probability", "log_likelihood", "state", "covariance", "nis"):
            assert np.array_equal(getattr(output, name), getattr(batch, name)[k])


@pytest.mark.parametrize("run", ["kalman", "sliding"])
def test_ten_short_steps_without_information_are_one_long_one(run: str) -> None:
    """Mode probabilities must not depend on how often nothing is measured."""
    drive = np.zeros((5, 2))
    start = BankStart(np.zeros(2), np.eye(2), np.array([0.6, 0.3, 0.1, 0.0, 0.0]))

    def last_probability(step_s: float, count: int) -> Any:
        step = LinearStep(
            transition=np.array([[1.0, step_s], [0.0, 1.0]]),
            drive=drive,
            process_noise=np.eye(2) * step_s,
            observation=np.eye(2),
            measurement_noise=np.eye(2) * 1e12,
            mode_transition=scaled_mode_transition(THESIS_MODE_TRANSITION, step_s),
        )
        drives, measurements = np.zeros((count, 5, 2)), np.zeros((count, 2))
        if run == "kalman":
            return run_kalman_bank(step, drives, measurements, start).mode_probability[-1]
        return run_sliding_innovation_bank(
            step, drives, measurements, start, np.ones(2)
        ).mode_probability[-1]

    np.testing.assert_allclose(last_probability(0.01, 10), last_probability(0.1, 1), atol=1e-12)


def test_a_run_refuses_garbage_and_names_it(make_problem: Callable[..., Any]) -> None:
    problem = make_problem()
    measurements = problem.measurements.copy()
    measurements[7, 0] = np.nan
    with pytest.raises(ValueError, match="measurements: not finite"):
        run_kalman_bank(problem.step, problem.drives, measurements, problem.start)
