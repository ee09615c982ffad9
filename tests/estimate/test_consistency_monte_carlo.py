"""Errors of the filters against their own covariances, on data drawn from their own models.

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

from edge_service.estimate.bank import LinearStep
from edge_service.estimate.fused import FusedPreloadEstimator
from edge_service.estimate.fused_kernel import take
from edge_service.estimate.fused_model import FusedSettings
from edge_service.estimate.fused_physics import (
    FLOATING_N,
    near_nodes,
    predict_stretch,
    predict_torque,
    spot_of,
    table_load,
)
from edge_service.estimate.fused_state import (
    GAIN,
    GAP,
    GAP_RATE,
    GROWTH,
    GROWTH_RATE,
    PLAY,
    PRELOAD,
    STATES,
    Drift,
    FusedModel,
    Mixture,
    Reading,
)
from edge_service.estimate.kalman import BankRun, BankStart, run_kalman_bank
from edge_service.messages.samples import Floats
from edge_service.models.machine import Machine
from edge_service.studies.estimator_axis import OwnAxis
from edge_service.studies.thesis_runs import ThesisCase, bank_inputs, run_case

SIGNIFICANCE = 1e-3
"""Of both sides together; the seeds are fixed, so a pass stays a pass."""
NONE = 1e-300
CALM = FusedSettings(
    loss_hazard=NONE,
    friction_hazard=NONE,
    payload_hazard=NONE,
    wear_hazard=NONE,
    backlash_hazard=NONE,
    misalignment_hazard=NONE,
    gain_hazard=NONE,
    force_hazard=NONE,
    process_force_n=1e9,
)
PRELOAD_SIGMA_PERCENT = 0.1
"""So small that the cube root law is straight over it."""
RUNS, PHASES = 80, 120
WARMING_S = 300.0
"""A rate of growth lasts about this long."""
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
    """What a chi-square variable over its degrees of freedom keeps to."""
    low, high = chi2.ppf([0.5 * SIGNIFICANCE, 1.0 - 0.5 * SIGNIFICANCE], freedom) / freedom
    return float(low), float(high)


# the fused estimator


@dataclass(frozen=True)
class Errors:
    """Of independent runs: NEES of the whole state and of the preload, NIS per quantity."""

    nees: Floats
    preload_nees: Floats
    nis: Floats
    freedom: int


@cache
def machine(one_encoder: bool) -> Machine:
    return OwnAxis(1, one_encoder=one_encoder).commissioned()


def random_reading(rng: np.random.Generator, model: FusedModel) -> Reading:
    """A phase of ordinary production, without its measurements."""
    direction = float(rng.choice([-1.0, 1.0]))
    pull = float(rng.choice([-1.0, 0.0, 1.0]))
    return Reading(
        steady_s=float(rng.uniform(0.03, 0.1)),
        direction=direction,
        torque_nm=0.0,
        acceleration_rad_s2=direction * pull * float(rng.uniform(500.0, 1500.0)),
        speed_rad_s=direction * float(rng.uniform(5.0, 100.0)),
        table_m=float(rng.uniform(0.05, 0.95)) * model.stroke_m,
        stretch_m=0.0,
    )


def measured(rng: np.random.Generator, model: FusedModel, x: Floats, r: Reading) -> Reading:
    """Torque and stretch of a state, with the noise that the model states."""
    slope, steady_s, spot = np.zeros_like(x), r.steady_s, spot_of(model, r, len(x))
    torque_var = model.torque_density / steady_s * slow(model.torque_slow_rad_s, r)
    torque_var += (0.3 * spot.stribeck_nm) ** 2
    torque_nm = predict_torque(model, x, r, spot, slope)
    torque_nm += math.sqrt(torque_var) * rng.standard_normal()
    torque_nm /= 1.0 + x[GAIN]
    if model.compliance_m_per_n == 0.0:
        return r._replace(torque_nm=torque_nm, table_m=math.nan, stretch_m=math.nan)
    stretch_var = model.stretch_density / steady_s * slow(model.stretch_slow_rad_s, r)
    stretch_m, _ = predict_stretch(model, x, r, spot, slope)
    if slope[PLAY] == -0.5:  # the table floats within its play
        stretch_var += (0.5 * x[PLAY]) ** 2
    stretch_m += math.sqrt(stretch_var) * rng.standard_normal()
    return r._replace(torque_nm=torque_nm, stretch_m=stretch_m)


def load_n(model: FusedModel, x: Floats, r: Reading) -> float:
    return table_load(model, x, r, near_nodes(model, r, len(x)))


def slow(speed_rad_s: float, r: Reading) -> float:
    return 1.0 + (speed_rad_s / abs(r.speed_rad_s)) ** 2


def drifted(
    rng: np.random.Generator, drift: Drift, x: Floats, elapsed_s: float, moved_s: float
) -> Floats:
    time_s = np.where(drift.moving, moved_s, elapsed_s)
    drifted = x.copy()
    lasting = math.exp(-elapsed_s / WARMING_S)
    for place, rate in ((GAP, GAP_RATE), (GROWTH, GROWTH_RATE)):
        drifted[rate] += drift.walk[rate] * math.sqrt(elapsed_s) * rng.standard_normal()
        drifted[place] += drifted[rate] * WARMING_S * (1.0 - lasting)
        drifted[rate] *= lasting
    rest = [i for i in range(STATES) if i not in (GAP_RATE, GROWTH_RATE)]
    drifted[rest] += (drift.walk * np.sqrt(time_s))[rest] * rng.standard_normal(len(rest))
    if len(x) > STATES:
        root = np.linalg.cholesky(drift.uneven * elapsed_s)
        drifted[STATES:] += root @ rng.standard_normal(len(x) - STATES)
    return drifted


def one_hypothesis(mixture: Mixture) -> None:
    """Keep the first, near the commissioned preload."""
    mixture.alive[0] = 1
    mixture.log_weight[1:] = -math.inf
    mixture.log_weight[0] = 0.0
    mixture.mean[0, PRELOAD] = OwnAxis(1).fresh_percent
    mixture.covariance[0, PRELOAD, PRELOAD] = PRELOAD_SIGMA_PERCENT**2


@cache
def fused_errors(one_encoder: bool) -> Errors:
    nees, preload_nees, nis, freedom = [], [], [], 0
    for seed in range(RUNS):
        rng = np.random.default_rng((seed, one_encoder))
        estimator = FusedPreloadEstimator(machine(one_encoder), CALM)
        model, drift, mixture = estimator._model, estimator._drift, estimator._mixture
        one_hypothesis(mixture)
        sigma = np.sqrt(np.diag(mixture.covariance[0]))
        free = sigma > 0.0
        x = mixture.mean[0] + sigma * rng.standard_normal(len(sigma))
        for _ in range(PHASES):
            r = random_reading(rng, model)
            while (
                abs(abs(table_load(model, x, r, near_nodes(model, r, len(x)))) - FLOATING_N) < 5.0
            ):
                r = random_reading(rng, model)  # else truth and filter see other flanks carry
            elapsed_s = float(rng.uniform(0.1, 1.0))
            x = drifted(rng, drift, x, elapsed_s, r.steady_s)
            reading = measured(rng, model, x, r)
            nis.append(take(mixture, model, drift, reading, elapsed_s, False))
        assert mixture.alive[0] == 1
        error, covariance = x - mixture.mean[0], mixture.covariance[0]
        scale = np.sqrt(np.diag(covariance)[free])
        unit = covariance[np.ix_(free, free)] / np.outer(scale, scale)
        nees.append((error[free] / scale) @ np.linalg.solve(unit, error[free] / scale))
        preload_nees.append(error[PRELOAD] ** 2 / covariance[PRELOAD, PRELOAD])
        freedom = int(free.sum())
    return Errors(np.array(nees), np.array(preload_nees), np.array(nis), freedom)


@pytest.mark.parametrize("one_encoder", [False, True])
def test_errors_of_the_fused_state_are_as_large_as_it_says(one_encoder: bool) -> None:
    errors = fused_errors(one_encoder)
    low, high = bounds(RUNS * errors.freedom)
    assert low < errors.nees.mean() / errors.freedom < high
    low, high = bounds(RUNS)
    assert low < errors.preload_nees.mean() < high


@pytest.mark.parametrize("one_encoder", [False, True])
def test_innovations_of_the_fused_filter_are_as_large_as_it_says(one_encoder: bool) -> None:
    errors = fused_errors(one_encoder)
    assert np.isfinite(errors.nis).all()
    low, high = bounds(len(errors.nis) * (1 if one_encoder else 2))
    assert low < errors.nis.mean() < high


# the baseline's bank


@dataclass(frozen=True)
class BankTruth:
    """What happened in one run of the bank's own model, and what the bank said."""

    modes: np.ndarray  # (N,)
    states: Floats  # (N, n)
    run: BankRun


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
    run = run_kalman_bank(step, drives, measurements, start)
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
