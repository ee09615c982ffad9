"""The plant against the printed matrices and independent mathematics."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete

from edge_service.estimate.imm.bank import run_bank
from edge_service.offline.reproduce.simulation import (
    ThesisCase,
    ThesisPlant,
    bank_inputs,
    net_torque,
    preload_profile,
    run_case,
    simulate,
    torque_command,
)

PLANT = ThesisPlant()


def test_euler_matrices_are_the_printed_ones() -> None:
    ratio, step_s = 0.02 / (2 * np.pi), 0.1
    matrices = PLANT.matrices()
    np.testing.assert_allclose(
        matrices.transition,
        [[1, step_s, 0], [0, 1 - 1.98e-2 * step_s / 3.3e-3, 0], [ratio, ratio * step_s, 0]],
        rtol=1e-14,
    )
    np.testing.assert_allclose(matrices.input, [0.0, step_s / 3.3e-3, 0.0])
    np.testing.assert_allclose(matrices.process_noise, np.diag([1e-3, 1e-2, ratio * 1e-3]))
    np.testing.assert_allclose(matrices.measurement_noise, np.diag([1e-4, 2e-5]))


@pytest.mark.parametrize("step_s", [0.1, 0.01, 0.001])
def test_exact_matrices_are_those_of_a_held_input(step_s: float) -> None:
    damping_per_s = 1.98e-2 / 3.3e-3
    a, b, *_ = cont2discrete(
        (np.array([[0, 1], [0, -damping_per_s]]), np.array([[0], [1 / 3.3e-3]]), np.eye(2), 0),
        step_s,
    )
    matrices = PLANT.matrices(step_s, "exact")
    np.testing.assert_allclose(matrices.transition[:2, :2], a, rtol=1e-12)
    np.testing.assert_allclose(matrices.input[:2], b[:, 0], rtol=1e-9)


def test_linear_position_is_no_dynamic_state() -> None:
    for kind in ("euler", "exact"):
        transition = PLANT.matrices(0.1, kind).transition
        np.testing.assert_allclose(transition[2], PLANT.ratio_m_per_rad * transition[0])
        assert (transition[:, 2] == 0.0).all()


def test_both_discretisations_meet_for_short_steps() -> None:
    euler, exact = PLANT.matrices(1e-5), PLANT.matrices(1e-5, "exact")
    np.testing.assert_allclose(euler.transition, exact.transition, atol=1e-8)


def test_drag_leaves_nothing_of_a_torque_below_it() -> None:
    torque = np.array([0.5, -0.5, 0.2, -0.2, 0.3, 0.0])
    np.testing.assert_allclose(net_torque(torque, np.array(0.3)), [0.2, -0.2, 0, 0, 0, 0])


def test_without_noise_the_speed_is_that_of_the_differential_equation() -> None:
    """Steady oscillation of J w' + D w = 2 sin t without drag: amplitude 2 / |D + i J|."""
    quiet = replace(
        PLANT,
        angle_noise_var_rad2=0.0,
        speed_noise_var_rad2_s2=0.0,
        linear_noise_share=0.0,
        rotary_noise_var_rad2=0.0,
        linear_noise_var_m2=0.0,
    )
    run = simulate(quiet, np.zeros(5000), np.random.default_rng(0), 0.005, "exact")
    amplitude = 2.0 / abs(complex(1.98e-2, 3.3e-3))
    assert np.abs(run.state[2000:, 1]).max() == pytest.approx(amplitude, rel=1e-4)
    np.testing.assert_allclose(
        run.measurement, run.state @ PLANT.matrices().observation.T, atol=1e-15
    )


def test_noise_has_the_printed_variance() -> None:
    run = simulate(PLANT, np.full(4000, 10.0), np.random.default_rng(1))
    matrices = PLANT.matrices()
    before = np.vstack([np.zeros(3), run.state[:-1]])
    disturbance = (
        run.state - before @ matrices.transition.T - np.outer(run.net_torque_nm, matrices.input)
    )
    reading = run.measurement - run.state @ matrices.observation.T
    variances = [*disturbance.var(axis=0), *reading.var(axis=0)]
    expected = [*np.diag(matrices.process_noise), *np.diag(matrices.measurement_noise)]
    np.testing.assert_allclose(variances, expected, rtol=0.1)


def test_the_same_seed_gives_the_same_run() -> None:
    runs = [simulate(PLANT, np.full(50, 5.0), np.random.default_rng(3)) for _ in range(2)]
    assert np.array_equal(runs[0].measurement, runs[1].measurement)


@pytest.mark.parametrize(
    ("simulation", "first", "middle", "last"),
    [(1, 10, 5, 0), (2, 7.5, 5, 2.5), (3, 10, 10, 10), (4, 10, 0, 0), (5, 10, 5, 0)],
)
def test_profiles(simulation: int, first: float, middle: float, last: float) -> None:
    profile = preload_profile(simulation, np.array([0.0, 50.0, 100.0]))
    assert profile.tolist() == [first, middle, last]


def test_unknown_simulations_are_refused() -> None:
    with pytest.raises(ValueError, match="expected 1 to 5"):
        preload_profile(6, np.zeros(2))


def test_torque_command() -> None:
    np.testing.assert_allclose(torque_command(np.array([0.0, np.pi / 2])), [0.0, 2.0])


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
