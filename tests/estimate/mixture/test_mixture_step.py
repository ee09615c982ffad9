"""Step of a hypothesis over a phase, against a filter by matrices."""

import inspect
import math

import numpy as np
import pytest

from edge_service.estimate.mixture import drift, hypotheses, physics, step
from edge_service.estimate.mixture.hypotheses import initial_bank, leader_of
from edge_service.estimate.mixture.state import (
    FORCED_S,
    MOST_SHARE,
    NUT_COMPLIANCE,
    PRELOAD,
    STEADY,
    TABLE_MASS,
    TORQUE_STATES,
    Bank,
)

from .mixture_axis import FRESH, RATIO, SETTINGS, Truth, idle, measured, parts, production
from .mixture_filter import FRICTIONS, USUAL, alone, corrected, motion_of, never, unit

FORCE_N = 300.0


def both(one_encoder: bool) -> tuple[Bank, Bank]:
    start = parts(one_encoder)[1]
    return initial_bank(start, SETTINGS), initial_bank(start, SETTINGS)


@pytest.mark.parametrize("one_encoder", [False, True])
def test_plain_python_gives_the_same_numbers(
    one_encoder: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Over the end of the beginning, a stop, a force, a step, and a missing linear encoder."""
    model, _, process = parts(one_encoder)
    process = process._replace(learn_s=2.0, confirm_s=1.0)
    readings = [*production(1, 5.0, Truth(), one_encoder)]
    readings += production(2, 4.0, Truth(percent=1.0), one_encoder)
    readings[30:34] = [r._replace(torque_nm=r.torque_nm + RATIO * FORCE_N) for r in readings[30:34]]
    readings[60:64] = [r._replace(stretch_m=math.nan) for r in readings[60:64]]
    elapsed = [3.0 if k == 25 else 0.1 for k in range(len(readings))]
    fast, slow = both(one_encoder)
    first = [step.step(fast, model, process, r, s) for r, s in zip(readings, elapsed, strict=True)]
    rooms = (physics, drift, hypotheses, step)
    kernels = {
        name: value.py_func
        for room in rooms
        for name, value in inspect.getmembers(room)
        if hasattr(value, "py_func")
    }
    assert len(kernels) > 20
    for room in rooms:
        for name, python in kernels.items():
            if hasattr(room, name):
                monkeypatch.setattr(room, name, python)
    assert inspect.isfunction(step.step)
    second = [step.step(slow, model, process, r, s) for r, s in zip(readings, elapsed, strict=True)]
    np.testing.assert_allclose(first, second, rtol=1e-6)
    np.testing.assert_array_equal(fast.alive, slow.alive)
    np.testing.assert_array_equal(fast.directions, slow.directions)
    np.testing.assert_allclose(fast.log_weight, slow.log_weight, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(fast.moments, slow.moments, rtol=1e-6, atol=1e-9)
    for k in np.flatnonzero(fast.alive):
        sigma = np.sqrt(np.diag(slow.covariance[k])) + 1e-30
        np.testing.assert_allclose(fast.mean[k] / sigma, slow.mean[k] / sigma, atol=1e-6, rtol=1e-9)
        scale = np.outer(sigma, sigma)
        np.testing.assert_allclose(
            fast.covariance[k] / scale, slow.covariance[k] / scale, atol=1e-6
        )


@pytest.mark.parametrize("encoder", ["both", "mixed", "missing", "one"])
def test_covariances_stay_covariances(encoder: str) -> None:
    """Thousands of phases with rests and forces: symmetric, and nothing is known for certain."""
    one_encoder = encoder == "one"
    model, start, process = parts(one_encoder)
    bank, rng = initial_bank(start, SETTINGS), np.random.default_rng(7)
    for k in range(4000):
        r = measured(rng, Truth(), idle(rng, one_encoder), 200.0 * (k % 50 < 3))
        if encoder == "missing" or (encoder == "mixed" and rng.random() < 0.5):
            r = r._replace(stretch_m=math.nan)
        step.step(bank, model, process, r, float(rng.choice([0.1, 0.3, 2.0])))
        if k % 40:
            continue
        for slot in np.flatnonzero(bank.alive):
            matrix = unit(bank.covariance[slot])
            np.testing.assert_allclose(matrix, matrix.T, atol=1e-6)
            assert np.linalg.eigvalsh(matrix).min() > 0.0, (k, slot)


def test_what_is_considered_is_never_changed_by_data() -> None:
    model, start, process = parts()
    bank = initial_bank(start, SETTINGS)
    for r in production(3, 120.0, Truth(percent=3.0, reversal=0.3, mass_error=0.05)):
        step.step(bank, model, process, r, 0.1)
    for k in np.flatnonzero(bank.alive):
        i = NUT_COMPLIANCE
        assert bank.mean[k, i] == start.mean[i]
        assert bank.covariance[k, i, i] == start.covariance[i, i]


def test_another_payload_tells_what_of_the_stretch_is_the_tables() -> None:
    """A screw that twists under its own inertia yields less to a payload than was commissioned."""
    model, start, process = parts()
    bank = initial_bank(start, SETTINGS)
    before = start.covariance[TABLE_MASS, TABLE_MASS]
    for r in production(3, 120.0, Truth(mass_error=0.2)):
        step.step(bank, model, process, r, 0.1)
    k = leader_of(bank)
    assert bank.covariance[k, TABLE_MASS, TABLE_MASS] > 0.95 * before
    loaded = Truth(mass_error=0.2, payload_kg=10.0)
    for n, r in enumerate(production(4, 120.0, loaded)):
        step.step(bank, model, process, r, 60.0 if n == 0 else 0.1)
    k = leader_of(bank)
    assert 0.1 < bank.mean[k, TABLE_MASS] < 0.3
    assert bank.covariance[k, TABLE_MASS, TABLE_MASS] < 0.5 * before
    assert math.exp(bank.mean[k, PRELOAD]) == pytest.approx(FRESH, rel=0.1)


@pytest.mark.parametrize("share", [1.0, 1.15])
@pytest.mark.parametrize("one_encoder", [False, True])
def test_corrections_are_those_of_a_filter_by_matrices(one_encoder: bool, share: float) -> None:
    """The preload is known so well that one step is straight; some phases say what is unlikely,
    and where the nut seems to have more preload than it was made with, that is projected."""
    model, start, process = parts(one_encoder)
    process = never(process)
    bank = alone(start, 0.04)
    mean, covariance = bank.mean[STEADY].copy(), bank.covariance[STEADY].copy()
    mean[PRELOAD] += math.log(1.0 if share == 1.0 else MOST_SHARE)
    bank.mean[STEADY] = mean
    bounded, unlikely = 0, 0
    readings = [*production(4, 3.0, Truth(percent=share * FRESH), one_encoder)]
    readings[4::5] = [r._replace(torque_nm=r.torque_nm + 0.06) for r in readings[4::5]]
    for k, r in enumerate(readings):
        before, elapsed_s = bank.mean[STEADY].copy(), 0.1
        f, q = motion_of(model, process, r, elapsed_s, mean)
        mean, covariance, nis = corrected(model, process, f @ mean, f @ covariance @ f.T + q, r)
        returned = step.step(bank, model, process, r, elapsed_s)
        assert returned == pytest.approx(nis / (1 if one_encoder else 2), rel=1e-3), k
        unlikely += nis > USUAL
        bounded += mean[PRELOAD] == pytest.approx(math.log(MOST_SHARE * FRESH), abs=1e-9)
        sigma = np.sqrt(np.diag(covariance)) + 1e-30
        np.testing.assert_allclose(bank.mean[STEADY] / sigma, mean / sigma, atol=1e-3, rtol=1e-6)
        away = (bank.covariance[STEADY] - covariance) / np.outer(sigma, sigma)
        np.testing.assert_allclose(away, 0.0, atol=1e-3)
        assert not np.array_equal(before, bank.mean[STEADY])
    assert unlikely > 0
    assert (bounded >= 3) == (share > 1.0), bounded


@pytest.mark.parametrize("seed", [3, 5, 7])
def test_one_hypothesis_stays_at_the_preload_that_its_step_has_found(seed: int) -> None:
    model, start, process = parts()
    process, bank = never(process), alone(start, 0.05)
    for r in production(seed, 60.0, Truth()):
        step.step(bank, model, process, r, 0.1)
    bank.covariance[STEADY, PRELOAD, PRELOAD] += SETTINGS.loss**2
    for r in production(seed + 1, 40.0, Truth(percent=4.0)):
        step.step(bank, model, process, r, 0.1)
    away = bank.mean[STEADY, PRELOAD] - math.log(4.0)
    assert abs(away) < 3.0 * math.sqrt(bank.covariance[STEADY, PRELOAD, PRELOAD])


@pytest.mark.parametrize("one_encoder", [False, True])
def test_a_phase_under_a_force_teaches_nothing(one_encoder: bool) -> None:
    """R F in the torque and C F in the stretch; only time goes on."""
    model, start, process = parts(one_encoder)
    bank = initial_bank(start, SETTINGS)
    for r in production(5, 5.0, Truth(), one_encoder):
        step.step(bank, model, process, r, 0.1)
    means, covariances = bank.mean.copy(), bank.covariance.copy()
    rng = np.random.default_rng(6)
    r = measured(rng, Truth(), idle(rng, one_encoder, 1.0)._replace(speed_rad_s=10.0), FORCE_N)
    assert math.isnan(step.step(bank, model, process, r, 0.1))
    assert bank.force[leader_of(bank)] > 0.99
    assert bank.moments[FORCED_S] == r.steady_s
    k = leader_of(bank)  # one that knows the axis less may take the force for something else
    f, q = motion_of(model, process, r, 0.1, means[k])
    np.testing.assert_allclose(bank.mean[k], f @ means[k], rtol=1e-9, atol=1e-15)
    sigma = np.sqrt(np.diag(covariances[k])) + 1e-30
    q[PRELOAD, PRELOAD] = process.moving_walk[k] * r.steady_s
    away = (bank.covariance[k] - f @ covariances[k] @ f.T - q) / np.outer(sigma, sigma)
    np.testing.assert_allclose(away, 0.0, atol=1e-5)


@pytest.mark.parametrize(
    "step_s",
    [
        10.0,
        20_000.0,
    ],
)
def test_frictions_have_their_stationary_covariance_after_a_long_time(step_s: float) -> None:
    """together^2 between any two, and apart^2 of each on its own, however time is cut."""
    model, start, process = parts(one_encoder=True)
    bank, rng = alone(start, 0.3), np.random.default_rng(8)
    first, last = FRICTIONS[0], FRICTIONS[-1] + 1
    bank.covariance[STEADY, first:last, first:last] = 4.0 * np.eye(5)
    process = process._replace(learn_s=math.inf)
    for _ in range(round(20_000.0 / step_s)):
        slow = idle(rng, one_encoder=True)._replace(speed_rad_s=5.0, direction=1.0)
        step.step(bank, model, process, measured(rng, Truth(), slow, 1000.0), step_s)
    assert bank.force[STEADY] > 0.99
    stationary = SETTINGS.together**2 + SETTINGS.apart**2 * np.eye(5)
    rows = slice(FRICTIONS[0], FRICTIONS[-1] + 1)
    found = bank.covariance[STEADY, rows, rows]
    np.testing.assert_allclose(found, stationary, rtol=0.02)


def test_indices_of_torque_come_first() -> None:
    assert PRELOAD < TORQUE_STATES <= NUT_COMPLIANCE < len(parts()[1].mean)
    assert len(parts(one_encoder=True)[1].mean) == TORQUE_STATES


@pytest.mark.parametrize("wild_nm", [0.3, -0.3, 5.0])
def test_no_phase_alone_condemns_a_hypothesis(wild_nm: float) -> None:
    """However wild a phase is, weights part by no more than its share of the most it may say.

    One that all take for a process force says nothing.
    """
    model, start, process = parts()
    bank, rng = initial_bank(start, SETTINGS), np.random.default_rng(9)
    for r in production(3, 5.0, Truth()):
        step.step(bank, model, process, r, 0.1)
    rows = bank.alive > 0
    before = bank.log_weight[rows].copy()
    r = measured(rng, Truth(), idle(rng), 0.0)
    step.step(bank, model, process, r._replace(torque_nm=r.torque_nm + wild_nm), 0.1)
    most = process.evidence * process.most_nats
    moved = (bank.log_weight[rows] - before)[before > process.floor + most]
    assert np.ptp(moved) <= most + 1e-9
    assert (np.ptp(moved) > 0.0) == (bank.force[rows].min() <= step.FORCED)


@pytest.mark.parametrize("wild_nm", [0.1, -0.1, 0.3, -0.3, 5.0, -1e3])
def test_no_phase_alone_moves_what_is_believed(wild_nm: float) -> None:
    """However wild a phase is, what is believed and its preload stay."""
    model, start, process = parts()
    bank, rng = initial_bank(start, SETTINGS), np.random.default_rng(9)
    for r in production(3, 60.0, Truth()):
        step.step(bank, model, process, r, 0.1)
    believed = leader_of(bank)
    before = bank.mean[believed, PRELOAD]
    r = measured(rng, Truth(), idle(rng), 0.0)
    step.step(bank, model, process, r._replace(torque_nm=r.torque_nm + wild_nm), 0.1)
    assert leader_of(bank) == believed
    assert bank.mean[believed, PRELOAD] == pytest.approx(before, abs=0.01)
