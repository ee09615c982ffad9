"""The plant against the printed matrices and independent mathematics."""

from dataclasses import replace

import numpy as np
import pytest

from edge_service.estimate.imm.bank import run_bank
from edge_service.offline.reproduce.simulation import (
    PROCESS_VARIANCE,
    READING_VARIANCE,
    ThesisCase,
    bank_inputs,
    follow,
    net_torque,
    plant_matrices,
    preload_profile,
    run_case,
    simulate,
)


def test_euler_matrices_are_the_printed_ones() -> None:
    ratio, step_s = 0.02 / (2 * np.pi), 0.1
    transition, push = plant_matrices()
    np.testing.assert_allclose(
        transition,
        [[1, step_s, 0], [0, 1 - 1.98e-2 * step_s / 3.3e-3, 0], [ratio, ratio * step_s, 0]],
        rtol=1e-14,
    )
    np.testing.assert_allclose(push, [0.0, step_s / 3.3e-3, 0.0])
    np.testing.assert_allclose(PROCESS_VARIANCE, [1e-3, 1e-2, ratio * 1e-3])
    np.testing.assert_allclose(READING_VARIANCE, [1e-4, 2e-5])


def test_drag_leaves_nothing_of_a_torque_below_it() -> None:
    torque = np.array([0.5, -0.5, 0.2, -0.2, 0.3, 0.0])
    np.testing.assert_allclose(net_torque(torque, np.array(0.3)), [0.2, -0.2, 0, 0, 0, 0])


def test_without_noise_the_speed_is_that_of_the_differential_equation() -> None:
    """Steady oscillation of J w' + D w = 2 sin t without drag: amplitude 2 / |D + i J|."""
    transition, push = plant_matrices(5e-4)
    state = follow(transition, np.outer(2.0 * np.sin(5e-4 * np.arange(50_000)), push))
    amplitude = 2.0 / abs(complex(1.98e-2, 3.3e-3))
    assert np.abs(state[20_000:, 1]).max() == pytest.approx(amplitude, rel=1e-3)


def test_noise_has_the_printed_variance() -> None:
    run = simulate(np.full(4000, 10.0), np.random.default_rng(1))
    transition, push = plant_matrices()
    before = np.vstack([np.zeros(3), run.state[:-1]])
    disturbance = run.state - before @ transition.T - np.outer(run.net_torque_nm, push)
    reading = run.measurement - run.state[:, [0, 2]]
    variances = [*disturbance.var(axis=0), *reading.var(axis=0)]
    expected = [*PROCESS_VARIANCE, *READING_VARIANCE]
    np.testing.assert_allclose(variances, expected, rtol=0.1)


def test_the_same_seed_gives_the_same_run() -> None:
    runs = [simulate(np.full(50, 5.0), np.random.default_rng(3)) for _ in range(2)]
    assert np.array_equal(runs[0].measurement, runs[1].measurement)


@pytest.mark.parametrize(
    ("simulation", "first", "middle", "last"),
    [(1, 10, 5, 0), (2, 7.5, 5, 2.5), (3, 10, 10, 10), (4, 10, 0, 0), (5, 10, 5, 0)],
)
def test_profiles(simulation: int, first: float, middle: float, last: float) -> None:
    profile = preload_profile(simulation, np.array([0.0, 50.0, 100.0]))
    assert profile.tolist() == [first, middle, last]


def test_the_filter_of_the_true_mode_is_consistent() -> None:
    """NIS of a matched filter with two sensors has mean 2."""
    case = ThesisCase(5.0)
    run, _ = run_case(case, 1)
    step, drives, start = bank_inputs(case, run)
    matched = run_bank(
        replace(step, drive=drives[0, 2:3], mode_transition=np.ones((1, 1))),
        drives[:, 2:3],
        run.measurement,
        replace(start, mode_probability=np.ones(1)),
    )
    assert matched.nis.mean() == pytest.approx(2.0, abs=4 * np.sqrt(4.0 / len(drives)))
