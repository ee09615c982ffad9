"""Hypotheses that live, take over and begin."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from edge_service.estimate.mixture import hypotheses
from edge_service.estimate.mixture import state as s
from edge_service.estimate.mixture.state import BEFORE, LEARNING, LOSS, PRELOAD, STEADY, Bank
from edge_service.estimate.mixture.step import step

from .mixture_axis import FRESH, SETTINGS, TORQUE_NOISE_NM, Truth, idle, measured, parts, production

MODEL, START, PROCESS = parts()
TICK = idle(np.random.default_rng(0), direction=1.0)
NIS = np.zeros(s.HYPOTHESES)


def settled(one_encoder: bool = False) -> Bank:
    """A bank whose beginning is over: steady and wearing, and what was believed before."""
    bank = hypotheses.initial_bank(parts(one_encoder)[1], SETTINGS)
    bank.alive[:] = 0
    for slot, weight in ((STEADY, 0.0), (s.WEARING, -3.0), (BEFORE, -8.0)):
        bank.mean[slot], bank.covariance[slot] = bank.mean[0], bank.covariance[0]
        bank.alive[slot], bank.log_weight[slot] = 1, weight
    bank.moments[LEARNING] = 0.0
    return bank


@dataclass(frozen=True)
class Challenger:
    """Of one loss: how long it has led, in which directions, by how much; whether all is calm."""

    age_s: float = 8.5
    directions: int = 3
    ahead: float = 2.5
    calm: bool = True
    slot: int = LOSS

    def bank(self) -> Bank:
        bank, k = settled(), self.slot
        bank.mean[k], bank.covariance[k] = bank.mean[STEADY], bank.covariance[STEADY]
        bank.mean[k, PRELOAD] = math.log(1.0)
        bank.alive[k], bank.log_weight[k] = 1, self.ahead
        bank.age_s[k], bank.directions[k] = self.age_s - TICK.steady_s, self.directions
        return bank


@pytest.mark.parametrize("one_encoder", [False, True])
def test_no_belief_dies_whatever_happens(one_encoder: bool) -> None:
    """Over a healthy time, a loss and its return."""
    model, start, process = parts(one_encoder)
    bank = hypotheses.initial_bank(start, SETTINGS)
    for percent in (FRESH, 1.0, FRESH):
        for k, r in enumerate(production(3, 30.0, Truth(percent=percent), one_encoder)):
            step(bank, model, process, r, 0.1)
            living = bank.alive > 0
            assert np.isfinite(bank.log_weight[living]).all()
            if bank.moments[LEARNING] == 0.0:
                assert bank.alive[[STEADY, s.WEARING, BEFORE]].all(), k
            kept = BEFORE if bank.alive[BEFORE] else STEADY
            assert bank.log_weight[kept] >= SETTINGS.floor - bank.cost[kept]
            hypotheses.normalise(bank, SETTINGS.floor)
            assert np.exp(bank.log_weight[bank.alive > 0]).sum() == pytest.approx(1.0, abs=1e-5)


def test_a_challenger_that_has_led_takes_over_and_the_belief_goes_on_beside_it() -> None:
    bank = Challenger().bank()
    believed_before = bank.mean[STEADY].copy()
    hypotheses.adapt_hypotheses(bank, PROCESS, TICK, 0.1, True, NIS)
    assert bank.mean[STEADY, PRELOAD] == bank.mean[s.WEARING, PRELOAD] == 0.0
    np.testing.assert_array_equal(bank.mean[BEFORE], believed_before)
    assert (bank.log_weight[STEADY], bank.log_weight[BEFORE]) == (2.5, 0.0)
    assert hypotheses.leader_of(bank) == hypotheses.accepted(bank) == STEADY
    assert all(bank.alive[k] for k in (LOSS, s.TOTAL_LOSS, s.LOOSENING))  # the next contest


@pytest.mark.parametrize(("behind", "goes_on"), [(1.9, True), (2.1, False)])
def test_a_rival_about_as_likely_as_the_winner_goes_on(behind: float, goes_on: bool) -> None:
    """With one encoder a lost preload and a lubricant look alike."""
    bank = Challenger().bank()
    rival = 2.0 * bank.mean[STEADY]
    bank.mean[s.LUBRICATION], bank.covariance[s.LUBRICATION] = (rival, bank.covariance[STEADY])
    bank.alive[s.LUBRICATION], bank.log_weight[s.LUBRICATION] = (1, bank.log_weight[LOSS] - behind)
    hypotheses.adapt_hypotheses(bank, PROCESS, TICK, 0.1, True, NIS)
    assert bool(bank.mean[s.LUBRICATION, PRELOAD] == rival[PRELOAD]) is goes_on
    assert bank.alive[s.LUBRICATION]  # if not that one, the next


@pytest.mark.parametrize(
    "less", [{"age_s": 7.9}, {"directions": 1}, {"ahead": 1.9}, {"calm": False}]
)
def test_a_challenger_does_not_take_over_too_soon(less: dict[str, Any]) -> None:
    bank = Challenger(**less).bank()
    before = bank.mean[STEADY].copy()
    hypotheses.adapt_hypotheses(bank, PROCESS, TICK, 0.1, less.get("calm", True), NIS)
    np.testing.assert_array_equal(bank.mean[STEADY], before)
    assert (bank.alive[LOSS], bank.mean[LOSS, PRELOAD]) == (1, 0.0)


@pytest.mark.parametrize(("age_s", "accepted"), [(1.9, False), (2.1, True)])
def test_a_loss_of_all_is_accepted_after_two_seconds(age_s: float, accepted: bool) -> None:
    bank = Challenger(age_s=age_s, slot=s.TOTAL_LOSS).bank()
    hypotheses.adapt_hypotheses(bank, PROCESS, TICK, 0.1, True, NIS)
    assert bool(bank.mean[STEADY, PRELOAD] == 0.0) is accepted


@pytest.mark.parametrize(
    ("nis", "calm", "begins"), [(9.1, False, True), (8.9, False, False), (9.1, True, False)]
)
def test_a_loss_begins_with_the_phase_that_surprises(nis: float, calm: bool, begins: bool) -> None:
    """One that began before it has learned that nothing happened, and a total one would win."""
    bank = settled()
    hypotheses.adapt_hypotheses(bank, PROCESS, TICK, 4.0, True, NIS)
    bank.mean[LOSS, PRELOAD] = -1.0
    bank.moments[s.SURPRISE] = nis
    bank.moments[s.SINCE_SPAWN_S] = 0.0
    hypotheses.adapt_hypotheses(bank, PROCESS, TICK, 0.1, calm, NIS)
    assert bool(bank.mean[LOSS, PRELOAD] == bank.mean[STEADY, PRELOAD]) is begins


@pytest.mark.parametrize(
    ("slot", "lost", "ahead", "nis", "begins"),
    [(s.LOOSENING, 1.0, -3.0, nis, nis > 9.0) for nis in (8.9, 9.1)]
    + [(LOSS, lost, -1.5, 0.0, lost < 0.1) for lost in (0.05, 0.5)]
    + [(s.LOAD, 1.0, -9.5, 0.0, True), (s.LOOSENING, 1.0, -7.2, 0.0, False)],  # after 5 of 20 s
)
def test_a_surprised_loosening_and_a_loss_of_nothing_begin_anew(
    slot: int, lost: float, ahead: float, nis: float, begins: bool
) -> None:
    bank = Challenger(age_s=5.0, ahead=ahead, slot=slot).bank()
    bank.mean[slot, PRELOAD] = bank.mean[STEADY, PRELOAD] - lost
    bank.moments[s.SINCE_SPAWN_S] = SETTINGS.spawn_s
    hypotheses.adapt_hypotheses(bank, PROCESS, TICK, 0.1, True, np.full(s.HYPOTHESES, nis))
    assert bool(bank.age_s[slot] == 0.0) is begins


@pytest.mark.parametrize("calm", [False, True])
@pytest.mark.parametrize(("stop_s", "counted_s"), [(5.0, 5.0), (50.0, 50.0), (5000.0, 100.0)])
def test_after_a_long_stop_a_load_is_likelier(stop_s: float, counted_s: float, calm: bool) -> None:
    """Even where the phase after it passes for one under a force: that may be the other load."""
    bank = settled()
    hypotheses.adapt_hypotheses(bank, PROCESS, TICK, stop_s, calm, NIS)
    for slot in (s.LOAD, s.LUBRICATION):
        expected = math.log(SETTINGS.stop_hazard * counted_s)
        assert bank.log_weight[slot] - bank.log_weight[STEADY] == pytest.approx(expected)
    assert bank.moments[s.STOPPED_S] == 0.0


def test_a_step_changes_what_its_name_says_and_nothing_else() -> None:
    """Each challenger is the belief, but for what has just happened to it."""
    bank = settled()
    hypotheses.adapt_hypotheses(bank, PROCESS, TICK, 5.0, True, NIS)
    for _ in range(40):
        hypotheses.adapt_hypotheses(bank, PROCESS, TICK, 0.1, True, NIS)
    x, p = bank.mean[STEADY], bank.covariance[STEADY]
    torques = {*range(s.NUT_FRICTION, s.GUIDE_VISCOUS + 1), s.TORQUE_SCALE}
    touched = {LOSS: {PRELOAD, s.REVERSAL}, s.TOTAL_LOSS: {PRELOAD}, s.LUBRICATION: torques}
    touched[s.LOAD] = {s.PAYLOAD, s.GUIDE_FRICTION, s.TORQUE_OFFSET}
    touched[s.LOOSENING] = touched[s.LARGE_LOOSENING] = {s.LOOSENESS, s.COUPLING, s.ENCODER_OFFSET}
    for k in s.CHALLENGERS:
        changed = (bank.mean[k] != x) | (np.diag(bank.covariance[k]) != np.diag(p))
        assert set(np.flatnonzero(changed)) == touched[k], k
    assert bank.mean[s.TOTAL_LOSS, PRELOAD] == pytest.approx(math.log(0.02 * FRESH))
    bank.mean[STEADY, PRELOAD] = math.log(0.1 * FRESH)
    hypotheses.spawn_challenger(bank, PROCESS, s.TOTAL_LOSS, STEADY, 0.0)
    assert bank.mean[s.TOTAL_LOSS, PRELOAD] == pytest.approx(math.log(FRESH))
    assert (bank.covariance[LOSS] - p)[PRELOAD, PRELOAD] == pytest.approx(SETTINGS.loss**2)
    wound = (bank.covariance[LOSS] - p)[PRELOAD, s.REVERSAL]  # of the reversal 0 to 1 is the nut's
    assert wound == pytest.approx(0.5 * SETTINGS.loss**2)
    assert (
        (bank.mean[s.LARGE_LOOSENING] - x)[s.COUPLING]
        > (bank.mean[s.LOOSENING] - x)[s.COUPLING]
        > 0.0
    )


def test_the_beginning_ends_with_the_likeliest_and_the_next() -> None:
    bank = hypotheses.initial_bank(START, SETTINGS)
    bank.log_weight[:] = -9.0
    bank.log_weight[[LOSS, s.TOTAL_LOSS]] = -1.0, -0.5
    almost = TICK._replace(steady_s=SETTINGS.learn_s - 0.1)
    hypotheses.adapt_hypotheses(bank, PROCESS, almost, 0.1, True, NIS)
    assert bank.moments[LEARNING] == 1.0
    none, half = bank.mean[s.TOTAL_LOSS, PRELOAD], bank.mean[LOSS, PRELOAD]
    hypotheses.adapt_hypotheses(bank, PROCESS, TICK._replace(steady_s=0.2), 0.1, True, NIS)
    assert bank.moments[LEARNING] == 0.0
    assert bank.mean[STEADY, PRELOAD] == bank.mean[s.WEARING, PRELOAD] == none
    assert bank.mean[BEFORE, PRELOAD] == half
    assert set(np.flatnonzero(bank.alive)) == {STEADY, s.WEARING, BEFORE}


def test_a_night_forgets_the_screws_growth_and_asks_what_else_has_changed() -> None:
    bank = settled()
    before = bank.covariance[STEADY, PRELOAD, PRELOAD]
    bank.covariance[STEADY, 11, 11] = 1e-20
    hypotheses.continue_after_stop(bank, START, 86_400.0)
    assert bank.covariance[STEADY, PRELOAD, PRELOAD] == pytest.approx(before + 0.03**2)
    assert bank.covariance[STEADY, 11, 11] == START.covariance[11, 11]
    assert bank.mean[hypotheses.NUT_SLOT, PRELOAD] == START.mean[PRELOAD]
    assert (
        bank.covariance[hypotheses.LOAD_SLOT, s.PAYLOAD, s.PAYLOAD]
        == START.load[s.PAYLOAD, s.PAYLOAD]
    )
    assert bank.mean[hypotheses.LOST_SLOT, PRELOAD] < bank.mean[STEADY, PRELOAD]
    assert (bank.mean[hypotheses.SOFT_SLOT] - bank.mean[STEADY])[s.COUPLING] > 0.0
    assert (bank.alive.sum(), bank.moments[LEARNING]) == (5, 1.0)


def test_a_challenger_gets_older_only_by_what_it_explains_and_has_led_where_it_leads() -> None:
    """Another one may lead meanwhile; a force or a surprise to it speaks for no direction."""
    bank = Challenger(age_s=2.0, directions=0).bank()
    for force, ahead, nis, seen in ((1, -1, 0, 0), (0, -1, 0, 0), (0, 1, 30, 0), (0, 1, 0, 1)):
        bank.force[LOSS], bank.log_weight[LOSS], age_s = force, ahead, bank.age_s[LOSS]
        hypotheses.adapt_hypotheses(bank, PROCESS, TICK, 0.1, True, NIS + nis)
        assert bank.directions[LOSS] == seen
        assert bank.age_s[LOSS] == age_s + TICK.steady_s * (force == 0.0)


def test_improbable_frictions_cost_in_full_and_once() -> None:
    """Phases far too short to teach anything: two hypotheses that differ in frictions alone."""
    bank, rng, ahead = settled(), np.random.default_rng(0), []
    hypotheses.copy_to(bank, BEFORE, STEADY, 0.0)
    bank.mean[BEFORE, s.NUT_FRICTION : s.GUIDE_VISCOUS + 1] = 3.0 * SETTINGS.together
    for _ in range(3):
        step(bank, MODEL, PROCESS, measured(rng, Truth(), idle(rng))._replace(steady_s=1e-9), 1e-9)
        ahead.append(bank.log_weight[STEADY] - bank.log_weight[BEFORE])
    spread = SETTINGS.together**2 + SETTINGS.apart**2 / 5.0
    full = 0.5 * (3.0 * SETTINGS.together) ** 2 / spread
    assert ahead == pytest.approx([(1.0 - SETTINGS.evidence) * full] * 3, rel=0.01)


@pytest.mark.parametrize(("over_noise", "tells"), [(1.9, False), (100.0, True)])
def test_acceleration_within_noise_tells_nothing_of_a_load(over_noise: float, tells: bool) -> None:
    bank, rng = settled(), np.random.default_rng(1)
    hypotheses.spawn_challenger(bank, PROCESS, s.LOAD, STEADY, -1.0)
    calm = idle(rng)._replace(acceleration_rad_s2=over_noise * TORQUE_NOISE_NM / 1.5e-3)
    for _ in range(5):
        step(bank, MODEL, PROCESS, measured(rng, Truth(payload_kg=8.0), calm), 0.1)
    assert bool(abs(bank.mean[s.LOAD, s.PAYLOAD]) > 0.01) is tells
