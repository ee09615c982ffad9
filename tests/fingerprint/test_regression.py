"""Linear regression against formulas, and its intervals against many noises."""

import math

import numpy as np
import pytest
from scipy import signal, stats

from edge_service.messages.samples import Floats
from edge_service.regression.linear import (
    correlation_time,
    effective_size,
    instrumental_variables,
    least_squares,
    total_least_squares,
)
from edge_service.regression.nonlinear import Unknown, fit_profiled

NAMES = ("slope", "level")


def ar1(random: np.random.Generator, count: int, pole: float) -> Floats:
    noise = random.standard_normal(count + 200)
    return np.asarray(signal.lfilter([1.0], [1.0, -pole], noise))[200:]


def ramp(count: int) -> Floats:
    return np.column_stack((np.linspace(-1.0, 1.0, count), np.ones(count)))


@pytest.mark.parametrize("pole", [0.0, 0.5, 0.9])
def test_correlation_time_is_that_of_the_process(pole: float) -> None:
    series = ar1(np.random.default_rng(3), 200_000, pole)
    assert correlation_time(series) == pytest.approx((1.0 + pole) / (1.0 - pole), rel=0.1)
    assert effective_size(series) == pytest.approx(2e5 * (1.0 - pole) / (1.0 + pole), rel=0.1)


def test_white_noise_gives_the_textbook_interval() -> None:
    random = np.random.default_rng(7)
    design = np.column_stack((random.standard_normal(4000), np.ones(4000)))
    target = design @ np.array([2.0, -1.0]) + 0.3 * random.standard_normal(4000)
    fit = least_squares(NAMES, design, target)
    inverse = np.linalg.inv(design.T @ design)
    expected, *_ = np.linalg.lstsq(design, target)
    np.testing.assert_allclose(fit.coefficients, expected, rtol=1e-10)
    for k in range(2):
        sigma = fit.residual_std * math.sqrt(inverse[k, k])
        assert math.sqrt(fit.covariance[k, k]) == pytest.approx(sigma, rel=0.1)


@pytest.mark.parametrize("pole", [0.0, 0.8])
def test_intervals_hold_the_truth_as_often_as_they_say(pole: float) -> None:
    truth, hits, runs = np.array([0.7, 0.2]), 0, 200
    for seed in range(runs):
        noise = ar1(np.random.default_rng(seed), 2000, pole)
        fit = least_squares(NAMES, ramp(2000), ramp(2000) @ truth + noise)
        hits += fit.interval_estimate("slope", "1").holds(truth[0])
    low, high = stats.binom.ppf((0.001, 0.999), runs, 0.95)
    assert low <= hits <= high


def test_collinear_regressors_are_infinite_and_name_each_other() -> None:
    random = np.random.default_rng(1)
    motion = random.standard_normal(500)
    design = np.column_stack((motion, 2.0 * motion, np.ones(500), np.zeros(500)))
    target = 3.0 * motion + 1.0 + 0.01 * random.standard_normal(500)
    fit = least_squares(("inertia", "copy", "offset", "absent"), design, target)
    for name, other in (("inertia", "copy"), ("copy", "inertia")):
        found = fit.interval_estimate(name, "1")
        assert (found.low, found.high) == (-math.inf, math.inf)
        assert math.isnan(found.value)
        assert found.note == f"cannot be told from {other}"
    assert fit.interval_estimate("absent", "1").note == "no absent in the recording"
    assert fit.interval_estimate("offset", "1").holds(1.0)
    np.testing.assert_allclose(design @ fit.coefficients, target, atol=0.06)


def test_a_regressor_of_noise_is_undetermined_rather_than_nothing() -> None:
    random = np.random.default_rng(2)
    design = np.column_stack((random.standard_normal(5000), np.ones(5000)))
    fit = least_squares(NAMES, design, np.ones(5000), noise_rms=np.array([1.0, 0.0]))
    assert not fit.interval_estimate("slope", "1").determined
    assert fit.interval_estimate("level", "1").value == pytest.approx(1.0)


def noisy_regressor(seed: int, count: int = 20_000) -> tuple[Floats, Floats, Floats, Floats]:
    """Design with noise as strong as half of the signal, target, clean instruments, truth."""
    random = np.random.default_rng(seed)
    clean = np.column_stack((random.standard_normal(count), np.ones(count)))
    truth = np.array([2.0, 0.5])
    target = clean @ truth + 0.1 * random.standard_normal(count)
    design = clean + np.column_stack((0.5 * random.standard_normal(count), np.zeros(count)))
    return design, target, clean, truth


def test_noise_in_a_regressor_pulls_least_squares_down_and_nothing_else() -> None:
    design, target, instruments, truth = noisy_regressor(5)
    plain = least_squares(NAMES, design, target)
    assert plain.coefficients[0] == pytest.approx(truth[0] / 1.25, rel=0.02)
    for fit in (
        instrumental_variables(NAMES, design, target, instruments),
        total_least_squares(NAMES, design, target, np.array([0.5, 0.0]), 0.1),
    ):
        assert fit.interval_estimate("slope", "1").holds(truth[0])
        assert fit.interval_estimate("level", "1").holds(truth[1])
        assert fit.interval_estimate("slope", "1").sigma < 0.03


@pytest.mark.parametrize("jump", [30.0, 1e10])
def test_a_bound_is_found_where_the_misfit_jumps_beside_the_optimum(jump: float) -> None:
    """A jump looks like endless curvature: the bracket was finer than the numbers, for ever."""

    def residual(values: np.ndarray) -> np.ndarray:
        away = values[0] - 1.0
        return np.array([jump * float(away != 0.0), away, 0.5 * away, 0.0])

    unknown = Unknown("level", 0.0, 2.0, "N m")
    found = fit_profiled(residual, [unknown], [np.array([1.0])]).parameters["level"]
    assert found.low <= 1.0 <= found.high
    assert found.value == pytest.approx(1.0)


def test_bad_input_is_one_line() -> None:
    with pytest.raises(ValueError, match="2 rows cannot determine 2 parameters"):
        least_squares(NAMES, ramp(2), np.ones(2))
    with pytest.raises(ValueError, match="must be finite"):
        least_squares(NAMES, ramp(9), np.full(9, np.nan))
    with pytest.raises(ValueError, match="target_noise_rms must be greater than 0"):
        total_least_squares(NAMES, ramp(9), np.ones(9), np.array([1.0, 0.0]), 0.0)
