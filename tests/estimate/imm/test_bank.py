"""Filter banks, whatever engine: textbook, filterpy, plain Python, hostile input; their modes."""

import json
from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from edge_service.estimate.imm.bank import (
    KALMAN,
    BankOutput,
    BankStart,
    CompiledBank,
    FilterpyBank,
    LinearStep,
    run_bank,
)
from edge_service.estimate.imm.modes import moving_average, scaled_mode_transition, weighted_level
from edge_service.messages.samples import Floats
from edge_service.offline.reproduce.simulation import ThesisCase, bank_inputs, run_case

LOG_SMALLEST = -700.0
"""Below this, filterpy's likelihoods are no longer what they should be."""
SLIDING = np.array([0.7, 0.7])
BANKS: dict[str, Callable[[], CompiledBank | FilterpyBank]] = {
    "kalman": CompiledBank,
    "filterpy": FilterpyBank,
    "sliding": lambda: CompiledBank(SLIDING),
}
NAMES = [field.name for field in fields(BankOutput)]
every_bank = pytest.mark.parametrize("kind", BANKS)
step_lengths = st.floats(1e-4, 2.0)


@dataclass(frozen=True)
class Problem:
    """A bank's inputs over N steps."""

    step: LinearStep
    drives: Floats
    measurements: Floats
    start: BankStart

    def steps(self) -> list[tuple[LinearStep, Floats]]:
        drives = (replace(self.step, drive=drive) for drive in self.drives)
        return list(zip(drives, self.measurements, strict=True))

    def run(self, boundary: Floats = KALMAN) -> BankOutput:
        return run_bank(self.step, self.drives, self.measurements, self.start, boundary)


def random_problem(seed: int, modes: int = 5, count: int = 60) -> Problem:
    rng = np.random.default_rng(seed)

    def covariance(scale: float) -> Floats:
        root = rng.normal(size=(2, 2))
        return scale * (root @ root.T + 0.1 * np.eye(2))

    transition = np.eye(2) + 0.2 * rng.normal(size=(2, 2))
    transition /= max(1.0, np.abs(np.linalg.eigvals(transition)).max() * 1.05)
    drives = rng.normal(size=(count, modes, 2))
    mode_transition = 0.2 * rng.dirichlet(np.ones(modes), size=modes) + 0.8 * np.eye(modes)
    observation = rng.normal(size=(2, 2))
    step = LinearStep(
        transition, drives[0], covariance(0.3), observation, covariance(0.5), mode_transition
    )
    start = BankStart(rng.normal(size=2), covariance(1.0), rng.dirichlet(np.ones(modes)))
    return Problem(step, drives, 2.0 * rng.normal(size=(count, 2)), start)


def plain_step(drive: Floats, mode_transition: Floats) -> LinearStep:
    small = 1e-2 * np.eye(2)
    return LinearStep(np.eye(2), drive, small, np.eye(2), small, mode_transition)


def run(bank: CompiledBank | FilterpyBank, problem: Problem) -> list[BankOutput]:
    bank.reset(problem.start)
    return [bank.step(step, measurement) for step, measurement in problem.steps()]


def together(outputs: list[BankOutput]) -> BankOutput:
    return BankOutput(*(np.array([getattr(each, name) for each in outputs]) for name in NAMES))


def plain_filter(problem: Problem, kind: str) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """One mode with the squared innovation in units of S, by (4.4.7-12) or a textbook's filter.

    That is in information form, which shares no formula with the Joseph form.
    """
    s, x, p = problem.step, problem.start.state, problem.start.covariance
    out = []
    for drive, z in zip(problem.drives[:, 0], problem.measurements, strict=True):
        x, p = s.transition @ x + drive, s.transition @ p @ s.transition.T + s.process_noise
        e = z - s.observation @ x
        spread = s.observation @ p @ s.observation.T + s.measurement_noise
        if kind == "sliding":
            gain = np.linalg.pinv(s.observation) @ np.diag(np.clip(np.abs(e) / SLIDING, 0, 1))
            left = np.eye(len(x)) - gain @ s.observation
            x, p = x + gain @ e, left @ p @ left.T + gain @ s.measurement_noise @ gain.T
        else:
            weighted = s.observation.T @ np.linalg.inv(s.measurement_noise)
            p = np.linalg.inv(np.linalg.inv(p) + weighted @ s.observation)
            x = x + p @ weighted @ e
        out.append((x, p, e @ np.linalg.inv(spread) @ e))
    return out


@every_bank
def test_equal_modes_are_one_filter_and_follow_the_markov_chain(kind: str) -> None:
    problem = random_problem(3)
    problem = replace(problem, drives=np.repeat(problem.drives[:, :1], 5, axis=1))
    outputs = run(BANKS[kind](), problem)
    chance, expected = problem.start.mode_probability, plain_filter(problem, kind)
    for output, (state, covariance, nis) in zip(outputs, expected, strict=True):
        np.testing.assert_allclose(output.state, state, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(output.covariance, covariance, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(output.nis, nis, rtol=1e-10)
        chance = chance @ problem.step.mode_transition
        np.testing.assert_allclose(output.mode_probability, chance, atol=1e-12)


def test_a_mode_without_probability_comes_back_as_such() -> None:
    problem = random_problem(7, count=2)
    bank, other = CompiledBank(), CompiledBank()
    chance = np.array([0.0, 1.0, *np.zeros(len(problem.start.mode_probability) - 2)])
    bank.reset(replace(problem.start, mode_probability=chance))
    kept = json.loads(json.dumps(bank.snapshot(), allow_nan=False))
    assert kept["log_mode_probability"][0] == "-inf"
    other.restore(kept)
    assert other.snapshot() == bank.snapshot()


@every_bank
@pytest.mark.parametrize("garbage", [np.nan, np.inf, 1e300])
def test_garbage_raises_and_leaves_the_state(kind: str, garbage: float) -> None:
    problem, bank = random_problem(8, count=5), BANKS[kind]()
    run(bank, problem)
    before = bank.snapshot()
    singular = replace(
        problem.step, observation=np.zeros((2, 2)), measurement_noise=np.zeros((2, 2))
    )
    for step, measurement in (
        (problem.step, np.array([problem.measurements[0, 0], garbage])),
        (problem.step, np.zeros(3)),
        (random_problem(0, modes=3).step, problem.measurements[0]),
        (singular, problem.measurements[0]),
    ):
        with pytest.raises(ValueError, match=r"finite|overflows|shape|step"):
            bank.step(step, measurement)
        assert bank.snapshot() == before


def assert_filterpy_agrees(problem: Problem) -> None:
    ours, theirs = problem.run(), together(run(FilterpyBank(), problem))
    underflow = (theirs.log_likelihood < LOG_SMALLEST).any(axis=1)
    comparable = int(np.argmax(underflow)) if underflow.any() else len(underflow)
    assert comparable >= 0.95 * len(underflow)
    for name in ("mode_probability", "log_likelihood", "state", "covariance", "nis"):
        one, other = getattr(ours, name)[:comparable], getattr(theirs, name)[:comparable]
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("simulation", [1, 2, 3, 4])
def test_filterpy_agrees_on_the_simulations(simulation: int) -> None:
    case = ThesisCase(simulation)
    made, _ = run_case(case, 10 + simulation)
    step, drives, start = bank_inputs(case, made)
    assert_filterpy_agrees(Problem(step, drives[:200], made.measurement[:200], start))


@pytest.mark.parametrize("seed", range(3))
def test_filterpy_agrees_on_random_problems(seed: int) -> None:
    assert_filterpy_agrees(random_problem(seed))


def test_modes_far_from_the_truth_do_not_underflow() -> None:
    """The odds are the difference of the log-likelihoods where filterpy reads one half each."""
    step = plain_step(np.array([[100.0, 0.0], [200.0, 0.0]]), np.eye(2))
    start = BankStart(np.zeros(2), np.eye(2), np.array([0.5, 0.5]))
    problem = Problem(step, step.drive[None], np.zeros((1, 2)), start)
    odds = float(-np.diff(problem.run().log_mode_probability[0])[0])
    assert odds == pytest.approx(0.5 * (200.0**2 - 100.0**2) / 1.02, rel=1e-12)
    assert run(FilterpyBank(), problem)[0].mode_probability.tolist() == [0.5, 0.5]


def test_single_steps_equal_the_batch_bit_for_bit() -> None:
    problem = random_problem(11)
    batch, single = problem.run(), together(run(CompiledBank(), problem))
    assert all(np.array_equal(getattr(batch, name), getattr(single, name)) for name in NAMES)


@settings(max_examples=25, deadline=None)
@given(step_lengths, step_lengths)
def test_two_steps_are_one_longer_step(first_s: float, second_s: float) -> None:
    first, second = scaled_mode_transition(first_s), scaled_mode_transition(second_s)
    assert (first >= 0.0).all()
    np.testing.assert_allclose(first.sum(axis=1), 1.0, atol=1e-14)
    both = scaled_mode_transition(first_s + second_s)
    np.testing.assert_allclose(first @ second, both, atol=1e-12)


LEVELS = np.array([10.0, 7.5, 5.0, 2.5, 0.0])


@st.composite
def probabilities(draw: st.DrawFn) -> np.ndarray:
    raw = draw(arrays(np.float64, 5, elements=st.floats(1e-6, 1.0)))
    return raw / raw.sum()


@given(probabilities())
def test_square_is_the_printed_function(mu: np.ndarray) -> None:
    weights = weighted_level(mu, np.eye(5), 2.0)
    np.testing.assert_allclose(weights, mu**2 / (mu**2).sum(), rtol=1e-12)


def test_the_printed_example() -> None:
    mu = np.array([0.04, 0.05, 0.85, 0.04, 0.03])  # sums to 1.01 in print (4.5.3)
    assert float(weighted_level(mu, LEVELS, 1.0)) * 1.01 == pytest.approx(5.125, abs=1e-12)


def test_published_prediction_follows_from_published_probabilities() -> None:
    mu = np.array([0.85, 0.07, 0.04, 0.03, 0.02])  # Table 4.2, 10 %
    assert float(weighted_level(mu, LEVELS)) == pytest.approx(9.7, abs=0.05)


series = arrays(np.float64, st.tuples(st.integers(1, 30), st.just(3)), elements=st.floats(-9, 9))


@given(series, st.integers(1, 40), st.data())
def test_moving_average_equals_the_definition(
    values: np.ndarray, steps: int, data: st.DataObject
) -> None:
    ahead = data.draw(st.integers(0, steps - 1))
    expected = [
        values[max(0, k - steps + 1 + ahead) : k + ahead + 1].mean(axis=0)
        for k in range(len(values))
    ]
    np.testing.assert_allclose(moving_average(values, steps, ahead), expected, atol=1e-12)
