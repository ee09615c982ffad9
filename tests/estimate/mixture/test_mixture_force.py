"""Process forces: what passes is left out and says nothing; what stays is no force."""

import math

import numpy as np
import pytest

from edge_service.estimate.mixture import state
from edge_service.estimate.mixture.estimator import INERTIA_OFF, INERTIA_SEEN_NM2_S
from edge_service.estimate.mixture.hypotheses import FORCED, copy_to, initial_bank, leader_of
from edge_service.estimate.mixture.state import AxisModel, Bank, Reading
from edge_service.estimate.mixture.step import step

from .mixture_axis import COMPLIANCE, FRESH, RATIO, SETTINGS, Truth, parts, production

FORCE_N = 400.0


def settled(one_encoder: bool = False) -> Bank:
    """A healthy axis after a minute."""
    model, start, process = parts(one_encoder)
    bank = initial_bank(start, SETTINGS)
    for r in production(11, 60.0, Truth(), one_encoder):
        step(bank, model, process, r, 0.1)
    assert leader_of(bank) == state.STEADY
    return bank


def percent(bank: Bank) -> float:
    return math.exp(bank.mean[leader_of(bank), state.PRELOAD])


def pushed(r: Reading, force_n: float, yields: float = 1.0) -> Reading:
    """A phase under a force on the table that yields otherwise than the axis was commissioned."""
    return r._replace(
        torque_nm=r.torque_nm + RATIO * force_n,
        stretch_m=r.stretch_m + yields * COMPLIANCE * force_n,
    )


@pytest.mark.parametrize("yields", [0.8, 1.0, 1.3])
@pytest.mark.parametrize("force_n", [FORCE_N, -FORCE_N, 60.0, -60.0])
def test_a_cut_of_seconds_is_no_loss(force_n: float, yields: float) -> None:
    """Constant forces, one after the other: a lost preload would explain what one of them does."""
    model, _, process = parts()
    bank, readings = settled(), production(12, 60.0, Truth())
    for k, r in enumerate(readings):
        cuts = k % 40 < 20
        share = 1.0 + 0.3 * (k // 40 % 3)
        step(bank, model, process, pushed(r, share * force_n, yields) if cuts else r, 0.1)
        assert percent(bank) > 0.85 * FRESH, k


def bursts(rng: np.random.Generator, seconds: float) -> np.ndarray:
    """Cuts for a third of the time, N, (n,): one for each phase of .1 s."""
    force_n, at = np.zeros(round(10.0 * seconds)), 0
    while at < len(force_n):
        lasts = int(rng.uniform(5.0, 30.0))
        force_n[at : at + lasts] = rng.uniform(100.0, 600.0) * rng.choice([-1.0, 1.0])
        at += 3 * lasts
    return force_n


def load(bank: Bank, model: AxisModel) -> float:
    """Inertia of the load that is believed in, over that of the axis."""
    return float(bank.mean[leader_of(bank), state.PAYLOAD]) * RATIO**2 / model.inertia_kg_m2


def acceleration_error(bank: Bank, model: AxisModel) -> float:
    """Torque that acceleration takes, over the commissioned one, less 1 and that of the load."""
    seen = float(bank.moments[state.INERTIA_ERROR] / bank.moments[state.INERTIA_TORQUE])
    return seen - load(bank, model)


@pytest.mark.parametrize("one_encoder", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_cuts_are_no_other_torque_constant(one_encoder: bool, seed: int) -> None:
    model, start, process = parts(one_encoder)
    bank = initial_bank(start, SETTINGS)
    force_n = bursts(np.random.default_rng([seed, 7]), 90.0)
    for k, r in enumerate(production(20 + seed, 90.0, Truth(), one_encoder)):
        step(bank, model, process, pushed(r, float(force_n[k])), 0.1)
        if k > 50 and bank.moments[state.INERTIA_TORQUE] > INERTIA_SEEN_NM2_S:
            assert abs(acceleration_error(bank, model)) < INERTIA_OFF, k


def test_a_load_that_few_accelerations_show_is_no_other_torque_constant() -> None:
    """Errors are judged beside the load of the leader, whoever led when they were seen."""
    (model, start, process), said = parts(), []
    for seed in range(8):
        bank, left = initial_bank(start, SETTINGS), 5
        for r in production(30 + seed, 9.0, Truth(payload_kg=34.0)):
            left -= r.acceleration_rad_s2 != 0.0
            if left >= 0 or r.acceleration_rad_s2 == 0.0:
                step(bank, model, process, r, 0.1)
        if load(bank, model) > INERTIA_OFF:
            said.append(abs(acceleration_error(bank, model)))
    assert len(said) > 4 and max(said) < INERTIA_OFF


@pytest.mark.parametrize("left", [0.02, 0.3, 0.5])
def test_a_drop_is_no_force_that_lasts(left: float) -> None:
    """A loss moves torque and stretch as no force does: recognised within 2 s of motion."""
    model, _, process = parts()
    bank = settled()
    for r in production(14, 2.0, Truth(percent=left * FRESH)):
        step(bank, model, process, r, 0.1)
    assert leader_of(bank) in (state.LOSS, state.TOTAL_LOSS)
    assert percent(bank) < 0.7 * FRESH


def test_friction_that_has_changed_for_good_is_no_force_for_ever() -> None:
    """In the middle of motion, by a third: doubted after a while, and then it teaches again."""
    model, _, process = parts()
    bank, truth = settled(), Truth(nut=0.35, bearing=0.35, guide=0.35)
    innovations = [step(bank, model, process, r, 0.1) for r in production(15, 60.0, truth)]
    assert np.isfinite(innovations[-100:]).mean() > 0.9
    assert abs(percent(bank) - FRESH) < 1.0


@pytest.mark.parametrize("one_encoder", [True, False])
def test_a_force_is_known_again_by_two_encoders_only(one_encoder: bool) -> None:
    """A torque alone fits any force; three standard deviations of axial friction are hardly it."""
    model, _, process = parts(one_encoder)
    slight_n = 3.0 * process.axial_n
    r = pushed(next(iter(production(16, 0.1, Truth(), one_encoder))), slight_n)
    forced = []
    for force_n in (slight_n, -slight_n):
        bank = settled(one_encoder)
        bank.force[:], bank.force_n[:] = 0.5, force_n
        step(bank, model, process, r, 0.1)
        forced.append(bank.force[leader_of(bank)])
    like, unlike = forced
    assert 0.0 < like == pytest.approx(unlike) if one_encoder else like > 0.9 and unlike < 0.5


def test_those_that_see_a_force_gain_and_lose_alike() -> None:
    """With a force any compliance fits, so a phase under one does not choose among them."""
    model, _, process = parts()
    bank, both, gained = settled(), [state.STEADY, state.BEFORE], []
    copy_to(bank, state.BEFORE, state.STEADY, bank.log_weight[state.STEADY])
    bank.mean[state.BEFORE, state.PRELOAD] += math.log(0.9)
    for r in production(14, 1.0, Truth()):
        believed = bank.log_weight[both].copy()
        step(bank, model, process, pushed(r, -200.0, 1.3), 0.1)
        if (bank.force[both] > FORCED).all():
            gained.append(bank.log_weight[both] - believed)
    assert np.ptp(gained, axis=1).max() < 0.05 and len(gained) > 5


def test_a_step_that_needs_a_lasting_force_gives_way_to_what_needs_none() -> None:
    """Even one that leads, as after a cut that has spoken for a loss."""
    (model, _, process), bank, force_n = parts(), settled(), 200.0
    copy_to(bank, state.TOTAL_LOSS, state.STEADY, 3.0)
    bank.mean[state.TOTAL_LOSS, state.TORQUE_OFFSET] -= RATIO * force_n
    bank.mean[state.TOTAL_LOSS, state.ENCODER_OFFSET] -= COMPLIANCE * force_n
    bank.force[state.TOTAL_LOSS], bank.force_n[state.TOTAL_LOSS] = 1.0, force_n
    for r in production(14, 4.0, Truth()):
        if abs(r.speed_rad_s) < 0.4 * bank.moments[state.FASTEST_RAD_S]:
            step(bank, model, process, r, 0.1)
    assert leader_of(bank) == state.STEADY
