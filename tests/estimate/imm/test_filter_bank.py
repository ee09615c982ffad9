"""Behaviour of every filter bank, whatever the engine and the filter."""

import json
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from edge_service.estimate.imm.bank.engines import make_filter_bank
from edge_service.estimate.imm.bank.filter_bank import BankOutput, FilterBank

KINDS = ("kf-imm compiled", "kf-imm filterpy", "sif-imm compiled")
SIZES = ((2, 2), (3, 2), (2, 1))


def bank_of(kind: str, sensors: int = 2) -> FilterBank:
    method, engine = kind.split()
    return make_filter_bank(method, engine, boundary=np.full(sensors, 0.7))  # type: ignore[arg-type]


def run(bank: FilterBank, problem: Any) -> list[BankOutput]:
    start = problem.start
    bank.reset(start.state, start.covariance, start.mode_probability)
    return [bank.step(step, measurement) for step, measurement in problem.steps()]


def assert_same(first: BankOutput, second: BankOutput, tolerance: float) -> None:
    for field in fields(BankOutput):
        np.testing.assert_allclose(
            getattr(first, field.name),
            getattr(second, field.name),
            rtol=tolerance,
            atol=tolerance,
            err_msg=field.name,
        )


def sliding_filter(problem: Any, boundary: float) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """(4.4.7-12) for one mode, with the squared innovation in units of S."""
    s, x, p = problem.step, problem.start.state, problem.start.covariance
    out = []
    for drive, z in zip(problem.drives[:, 0], problem.measurements, strict=True):
        x, p = s.transition @ x + drive, s.transition @ p @ s.transition.T + s.process_noise
        e = z - s.observation @ x
        spread = s.observation @ p @ s.observation.T + s.measurement_noise
        gain = np.linalg.pinv(s.observation) @ np.diag(np.clip(np.abs(e) / boundary, 0, 1))
        left = np.eye(len(x)) - gain @ s.observation
        x = x + gain @ e
        p = left @ p @ left.T + gain @ s.measurement_noise @ gain.T
        out.append((x, p, e @ np.linalg.inv(spread) @ e))
    return out


def kalman_filter(problem: Any) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Textbook filter in information form, which shares no formula with the Joseph form."""
    s, x, p = problem.step, problem.start.state, problem.start.covariance
    out = []
    for drive, z in zip(problem.drives[:, 0], problem.measurements, strict=True):
        x, p = s.transition @ x + drive, s.transition @ p @ s.transition.T + s.process_noise
        e = z - s.observation @ x
        spread = s.observation @ p @ s.observation.T + s.measurement_noise
        nis = e @ np.linalg.inv(spread) @ e
        weighted = s.observation.T @ np.linalg.inv(s.measurement_noise)
        p = np.linalg.inv(np.linalg.inv(p) + weighted @ s.observation)
        x = x + p @ weighted @ e
        out.append((x, p, nis))
    return out


def with_equal_modes(problem: Any) -> Any:
    drives = np.repeat(problem.drives[:, :1], problem.drives.shape[1], axis=1)
    return replace(problem, drives=drives)


@pytest.mark.parametrize(("states", "sensors"), SIZES)
@pytest.mark.parametrize("kind", KINDS)
def test_equal_modes_are_one_filter(
    kind: str, states: int, sensors: int, make_problem: Callable[..., Any]
) -> None:
    problem = with_equal_modes(make_problem(3, states=states, sensors=sensors))
    outputs = run(bank_of(kind, sensors), problem)
    expected = sliding_filter(problem, 0.7) if kind.startswith("sif") else kalman_filter(problem)
    for output, (state, covariance, nis) in zip(outputs, expected, strict=True):
        np.testing.assert_allclose(output.state, state, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(output.covariance, covariance, rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(output.nis, nis, rtol=1e-10)


@pytest.mark.parametrize("kind", KINDS)
def test_equal_modes_follow_the_markov_chain(kind: str, make_problem: Callable[..., Any]) -> None:
    problem = with_equal_modes(make_problem(4))
    expected = problem.start.mode_probability
    for output in run(bank_of(kind), problem):
        expected = expected @ problem.step.mode_transition
        np.testing.assert_allclose(output.mode_probability, expected, atol=1e-12)


@pytest.mark.parametrize(("states", "sensors"), SIZES)
@pytest.mark.parametrize("kind", KINDS)
def test_the_order_of_the_modes_does_not_matter(
    kind: str, states: int, sensors: int, make_problem: Callable[..., Any]
) -> None:
    problem = make_problem(5, states=states, sensors=sensors)
    order = np.array([3, 0, 4, 2, 1])
    shuffled = replace(
        problem,
        step=replace(
            problem.step, mode_transition=problem.step.mode_transition[np.ix_(order, order)]
        ),
        drives=problem.drives[:, order],
        start=replace(problem.start, mode_probability=problem.start.mode_probability[order]),
    )
    for first, second in zip(
        run(bank_of(kind, sensors), problem), run(bank_of(kind, sensors), shuffled), strict=True
    ):
        permuted = replace(
            first,
            mode_probability=first.mode_probability[order],
            log_mode_probability=first.log_mode_probability[order],
            log_likelihood=first.log_likelihood[order],
            nis=first.nis[order],
        )
        assert_same(permuted, second, 1e-11)


@pytest.mark.parametrize("kind", KINDS)
def test_probabilities_sum_to_one_and_covariances_stay_positive(
    kind: str, make_problem: Callable[..., Any]
) -> None:
    for output in run(bank_of(kind), make_problem(6)):
        assert output.mode_probability.sum() == pytest.approx(1.0, abs=1e-12)
        assert (np.linalg.eigvalsh(output.covariance) > 0.0).all()


@pytest.mark.parametrize(("states", "sensors"), SIZES)
@pytest.mark.parametrize("kind", KINDS)
def test_goes_on_from_a_snapshot_bit_for_bit(
    kind: str, states: int, sensors: int, make_problem: Callable[..., Any]
) -> None:
    problem = make_problem(7, states=states, sensors=sensors, count=40)
    bank = bank_of(kind, sensors)
    run(bank, replace(problem, drives=problem.drives[:20], measurements=problem.measurements[:20]))
    other = bank_of(kind, sensors)
    other.restore(json.loads(json.dumps(bank.snapshot(), allow_nan=False)))
    for step, measurement in problem.steps()[20:]:
        first, second = bank.step(step, measurement), other.step(step, measurement)
        assert all(
            np.array_equal(getattr(first, field.name), getattr(second, field.name))
            for field in fields(BankOutput)
        )


@pytest.mark.parametrize("kind", KINDS)
def test_a_snapshot_before_the_start_restores_a_bank_without_state(
    kind: str, make_problem: Callable[..., Any]
) -> None:
    problem = make_problem()
    bank = bank_of(kind)
    run(bank, problem)
    bank.restore(bank_of(kind).snapshot())
    with pytest.raises(ValueError, match="reset"):
        bank.step(*problem.steps()[0])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "snapshot", [{"states": [[1.0]]}, {"states": "x"}, {"states": [[float("nan")]]}, {"a": 1}]
)
def test_foreign_snapshots_are_refused(kind: str, snapshot: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="snapshot"):
        bank_of(kind).restore(snapshot)


@pytest.mark.parametrize(("states", "sensors"), SIZES)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("garbage", [np.nan, np.inf, -np.inf, 1e300])
def test_garbage_raises_and_leaves_the_state(
    kind: str, states: int, sensors: int, garbage: float, make_problem: Callable[..., Any]
) -> None:
    problem = make_problem(8, states=states, sensors=sensors, count=5)
    bank = bank_of(kind, sensors)
    run(bank, problem)
    before = bank.snapshot()
    measurement = problem.measurements[0].copy()
    measurement[-1] = garbage
    with pytest.raises(ValueError, match=r"finite|overflows"):
        bank.step(problem.step, measurement)
    assert bank.snapshot() == before


@pytest.mark.parametrize("kind", KINDS)
def test_input_of_another_size_is_refused(kind: str, make_problem: Callable[..., Any]) -> None:
    problem, other = make_problem(0), make_problem(0, modes=3)
    bank = bank_of(kind)
    run(bank, problem)
    with pytest.raises(ValueError, match="shape"):
        bank.step(problem.step, np.zeros(3))
    with pytest.raises(ValueError, match=r"step"):
        bank.step(other.step, other.measurements[0])


@pytest.mark.parametrize(
    "change",
    [
        {"transition": np.eye(3)},
        {"transition": np.full((2, 2), np.nan)},
        {"process_noise": np.array([[1.0, 0.5], [0.0, 1.0]])},
        {"measurement_noise": np.zeros((2, 3))},
        {"mode_transition": np.full((5, 5), 0.3)},
        {"drive": np.zeros(5)},
    ],
)
def test_impossible_steps_are_refused(
    change: dict[str, Any], make_problem: Callable[..., Any]
) -> None:
    with pytest.raises(ValueError, match=next(iter(change))):
        replace(make_problem().step, **change)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "change",
    [
        {"state": np.array([0.0, np.nan])},
        {"covariance": np.array([[1.0, 2.0], [2.0, 1.0]])},
        {"covariance": np.array([[1.0, 0.2], [0.0, 1.0]])},
        {"mode_probability": np.array([0.5, 0.6])},
        {"mode_probability": np.array([1.5, -0.5])},
    ],
)
def test_impossible_starts_are_refused(
    kind: str, change: dict[str, Any], make_problem: Callable[..., Any]
) -> None:
    start = replace(make_problem(modes=2).start, **change)
    with pytest.raises(ValueError, match=next(iter(change))):
        bank_of(kind).reset(start.state, start.covariance, start.mode_probability)


@pytest.mark.parametrize("kind", KINDS)
def test_singular_innovation_covariances_are_refused(
    kind: str, make_problem: Callable[..., Any]
) -> None:
    problem = make_problem()
    step = replace(
        problem.step,
        observation=np.zeros((2, 2)),
        measurement_noise=np.zeros((2, 2)),
    )
    bank = bank_of(kind)
    run(bank, problem)
    with pytest.raises(ValueError, match="step"):
        bank.step(step, problem.measurements[0])


def test_combinations_that_do_not_exist_are_refused() -> None:
    with pytest.raises(ValueError, match="filterpy has no sliding innovation filter"):
        make_filter_bank("sif-imm", "filterpy", boundary=np.ones(2))
    with pytest.raises(ValueError, match="a boundary is needed"):
        make_filter_bank("sif-imm", "compiled")
    with pytest.raises(ValueError, match="above 0"):
        make_filter_bank("sif-imm", "compiled", boundary=np.array([0.1, 0.0]))
    with pytest.raises(ValueError, match="no filter bank"):
        make_filter_bank("ekf", "compiled")  # type: ignore[arg-type]


def test_sliding_filter_never_corrects_a_state_that_no_sensor_sees() -> None:
    """With position measurements alone, the row of the speed in C^+ is zero."""
    observation = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert (np.linalg.pinv(observation)[1] == 0.0).all()
