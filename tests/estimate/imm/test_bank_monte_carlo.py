"""Errors of the baseline's bank against its own covariances, on data drawn from its own model.

With an honest covariance the normalised estimation error squared (NEES) of independent runs and
the normalised innovation squared (NIS) of all steps add up to chi-square variables
(Bar-Shalom, Li, Kirubarajan 2001, section 5.4).
"""

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from edge_service.estimate.imm.bank import BankOutput, BankStart, LinearStep, run_bank
from edge_service.messages.samples import Floats
from edge_service.offline.reproduce.simulation import ThesisCase, bank_inputs, run_case

SIGNIFICANCE = 1e-3
"""Of both sides together; the seeds are fixed, so a pass stays a pass."""
SETTLED = [
    True,
    pytest.param(
        False,
        marks=pytest.mark.xfail(
            strict=True,
            reason="the printed bank merges modes at every step, before a torque has reached the "
            "angle two steps later; over all histories of modes the NEES is 1",
        ),
    ),
]
"""Whether the modes of the bank never change."""


def bounds(freedom: int) -> tuple[float, float]:
    """Bounds of a chi-square variable over its degrees of freedom."""
    low, high = chi2.ppf([0.5 * SIGNIFICANCE, 1.0 - 0.5 * SIGNIFICANCE], freedom) / freedom
    return float(low), float(high)


@dataclass(frozen=True)
class BankTruth:
    """One run of the bank's own model, and the answers of the bank."""

    modes: np.ndarray  # (N,)
    states: Floats  # (N, n)
    run: BankOutput


def drawn_from_the_bank(
    rng: np.random.Generator, step: LinearStep, drives: Floats, start: BankStart
) -> BankTruth:
    """A Markov chain of modes, and the state and measurements of each step's mode."""
    count, modes, size = drives.shape
    x = rng.multivariate_normal(start.state, start.covariance)
    kicks = rng.multivariate_normal(np.zeros(size), step.process_noise, count)
    noise = rng.multivariate_normal(np.zeros(len(step.observation)), step.measurement_noise, count)
    mode = int(rng.choice(modes, p=start.mode_probability))
    path, states = [], []
    for k in range(count):
        mode = int(rng.choice(modes, p=step.mode_transition[mode]))
        x = step.transition @ x + drives[k, mode] + kicks[k]
        path.append(mode)
        states.append(x)
    measurements = np.array(states) @ step.observation.T + noise
    run = run_bank(step, drives, measurements, start)
    return BankTruth(np.array(path), np.array(states), run)


@cache
def bank_truths(settled: bool) -> list[BankTruth]:
    """200 runs over 60 steps of the thesis' bank; `settled` modes never change."""
    case = ThesisCase(3)
    step, drives, start = bank_inputs(case, run_case(case, seed=0)[0])
    if settled:
        step = replace(step, mode_transition=np.eye(drives.shape[1]))
    rngs = (np.random.default_rng((seed, settled)) for seed in range(200))
    return [drawn_from_the_bank(rng, step, drives[:60], start) for rng in rngs]


def state_nees(truth: BankTruth) -> Floats:
    """Of the combined state at each step, (N,)."""
    error = truth.states - truth.run.state
    solved = np.linalg.solve(truth.run.covariance, error[:, :, None])[:, :, 0]
    return np.asarray(np.einsum("ki,ki->k", error, solved))


@pytest.mark.slow
@pytest.mark.smoke
def test_innovations_of_the_right_mode_are_as_large_as_it_says() -> None:
    """Without changes of mode each filter is a Kalman filter of its own."""
    truths = bank_truths(settled=True)
    nis = [truth.run.nis[np.arange(60), truth.modes] for truth in truths]
    low, high = bounds(2 * 60 * len(truths))
    assert low < np.mean(nis) / 2.0 < high


@pytest.mark.parametrize("settled", SETTLED)
def test_errors_of_the_banks_state_are_as_large_as_it_says(settled: bool) -> None:
    truths = bank_truths(settled)
    low, high = bounds(2 * len(truths))
    for step in (5, 20, 59):
        assert low < np.mean([state_nees(truth)[step] for truth in truths]) / 2.0 < high


@pytest.mark.parametrize("settled", SETTLED)
def test_mode_probabilities_are_those_with_which_modes_are_right(settled: bool) -> None:
    """Brier's score of an honest probability is what the probability itself expects."""
    gain = []
    for truth in bank_truths(settled):
        mu = truth.run.mode_probability
        right = np.eye(mu.shape[1])[truth.modes]
        expected = (mu * (1.0 - mu)).sum(axis=1)
        gain.append((((right - mu) ** 2).sum(axis=1) - expected).mean())
    standard_error = np.std(gain) / math.sqrt(len(gain))
    assert standard_error > 0.0
    assert abs(np.mean(gain)) < chi2.ppf(1.0 - SIGNIFICANCE, 1) ** 0.5 * standard_error
