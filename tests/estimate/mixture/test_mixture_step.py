"""Step of a hypothesis over a phase, against a filter by matrices."""

import inspect
import math

import numpy as np
import pytest

from edge_service.estimate.mixture import hypotheses, physics, step
from edge_service.estimate.mixture.hypotheses import initial_bank, leader_of
from edge_service.estimate.mixture.state import MOST_SHARE, PRELOAD, STEADY, TABLE_MASS, Bank

from .mixture_axis import FRESH, RATIO, SETTINGS, Truth, idle, measured, parts, production
from .mixture_filter import USUAL, alone, corrected, motion_of, never, unit

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
    process = process._replace(assumed=SETTINGS._replace(learn_s=2.0, confirm_s=1.0))
    readings = [*production(1, 5.0, Truth(), one_encoder)]
    readings += production(2, 4.0, Truth(percent=1.0), one_encoder)
    readings[30:34] = [r._replace(torque_nm=r.torque_nm + RATIO * FORCE_N) for r in readings[30:34]]
    readings[60:64] = [r._replace(stretch_m=math.nan) for r in readings[60:64]]
    elapsed = [3.0 if k == 25 else 0.1 for k in range(len(readings))]
    fast, slow = both(one_encoder)
    first = [step.step(fast, model, process, r, s) for r, s in zip(readings, elapsed, strict=True)]
    rooms = (physics, hypotheses, step)
    named = [pair for room in rooms for pair in inspect.getmembers(room)]
    kernels = {name: value.py_func for name, value in named if hasattr(value, "py_func")}
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
        away = (fast.covariance[k] - slow.covariance[k]) / np.outer(sigma, sigma)
        np.testing.assert_allclose(away, 0.0, atol=1e-6)


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


@pytest.mark.parametrize(("share", "sigma"), [(1.0, 0.04), (1.15, 0.04), (0.5, 0.6)])
@pytest.mark.parametrize("one_encoder", [False, True])
def test_corrections_are_those_of_a_filter_by_matrices(
    one_encoder: bool, share: float, sigma: float
) -> None:
    """The preload is known well or not at all; some phases say what is unlikely,
    and where the nut seems to have more preload than it was made with, that is projected."""
    model, start, process = parts(one_encoder)
    process = never(process)
    bank = alone(start, sigma)
    mean, covariance = bank.mean[STEADY].copy(), bank.covariance[STEADY].copy()
    mean[PRELOAD] += math.log(1.0 if share == 1.0 else MOST_SHARE)
    bank.mean[STEADY] = mean
    bounded, unlikely = 0, 0
    readings = [*production(4, 3.0, Truth(percent=share * FRESH), one_encoder)]
    readings[4::5] = [r._replace(torque_nm=r.torque_nm + 0.06) for r in readings[4::5]]
    for k, r in enumerate(readings):
        before, elapsed_s = bank.mean[STEADY].copy(), 0.1
        f, q = motion_of(model, process, r, elapsed_s, mean, covariance)
        mean, covariance, nis = corrected(model, process, f @ mean, f @ covariance @ f.T + q, r)
        returned = step.step(bank, model, process, r, elapsed_s)
        assert returned == pytest.approx(nis / (1 if one_encoder else 2), rel=1e-3), k
        unlikely += nis > USUAL
        bounded += mean[PRELOAD] == pytest.approx(math.log(MOST_SHARE * FRESH), abs=1e-9)
        unit = np.sqrt(np.diag(covariance)) + 1e-30
        np.testing.assert_allclose(bank.mean[STEADY] / unit, mean / unit, atol=1e-3, rtol=1e-6)
        away = (bank.covariance[STEADY] - covariance) / np.outer(unit, unit)
        np.testing.assert_allclose(away, 0.0, atol=1e-3)
        assert not np.array_equal(before, bank.mean[STEADY])
    assert unlikely > 0
    assert (bounded >= 3) == (share > 1.0), bounded


@pytest.mark.parametrize(("wild_nm", "says"), [(0.06, 1), (0.3, 0), (-0.3, 0), (5.0, 0)])
def test_no_phase_alone_condemns_a_hypothesis(wild_nm: float, says: int) -> None:
    """However wild a phase is, weights part by no more than its share of the most it may say.

    One that all take for a process force says nothing; frictions are likelier as time passes.
    """
    model, start, process = parts()
    bank, rng = initial_bank(start, SETTINGS), np.random.default_rng(9)
    for r in production(3, 5.0, Truth()):
        step.step(bank, model, process, r, 0.1)
    rows = bank.alive > 0
    before = bank.log_weight[rows].copy()
    r = measured(rng, Truth(), idle(rng), 0.0)
    step.step(bank, model, process, r._replace(torque_nm=r.torque_nm + wild_nm), 0.1)
    most = SETTINGS.evidence * SETTINGS.most_nats
    likely = before > SETTINGS.floor + most
    moved = (bank.log_weight[rows] - before)[likely]
    assert np.ptp(moved) <= most + 1e-9
    assert (np.ptp(moved) > 1e-3) == says == (bank.force[rows][likely].min() <= step.FORCED)
