"""Hypotheses that live, take over and begin."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

from edge_service.estimate.mixture.hypotheses import (
    LOAD_SLOT,
    NUT_SLOT,
    STOP_S,
    accepted,
    adapt_hypotheses,
    continue_after_stop,
    initial_bank,
    leader_of,
    normalise,
)
from edge_service.estimate.mixture.state import (
    BEFORE,
    CHALLENGERS,
    GUIDE_FRICTION,
    GUIDE_VISCOUS,
    HYPOTHESES,
    LEARNING,
    LOAD,
    LOOSENESS,
    LOOSENING,
    LOSS,
    LUBRICATION,
    NUT_FRICTION,
    PAYLOAD,
    PRELOAD,
    SINCE_SPAWN_S,
    STEADY,
    STOPPED_S,
    SURPRISE,
    TORQUE_OFFSET,
    TOTAL_LOSS,
    WEARING,
    Bank,
)
from edge_service.estimate.mixture.step import step

from .mixture_axis import FRESH, SETTINGS, Truth, idle, parts, production

MODEL, START, PROCESS = parts()
TICK = idle(np.random.default_rng(0), direction=1.0)
BACK = idle(np.random.default_rng(0), direction=-1.0)


def settled(one_encoder: bool = False) -> Bank:
    """A bank whose beginning is over: steady and wearing, and what was believed before."""
    bank = initial_bank(parts(one_encoder)[1], SETTINGS)
    bank.alive[:] = 0
    for slot, weight in ((STEADY, 0.0), (WEARING, -3.0), (BEFORE, -8.0)):
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

    def bank(self) -> Bank:
        bank = settled()
        bank.mean[LOSS], bank.covariance[LOSS] = bank.mean[STEADY], bank.covariance[STEADY]
        bank.mean[LOSS, PRELOAD] = math.log(1.0)
        bank.alive[LOSS], bank.log_weight[LOSS] = 1, self.ahead
        bank.age_s[LOSS], bank.directions[LOSS] = self.age_s - TICK.steady_s, self.directions
        return bank


def test_weights_sum_to_one_and_none_falls_below_the_floor() -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        bank = settled()
        bank.alive[:] = rng.random(HYPOTHESES) < 0.7
        bank.alive[rng.integers(HYPOTHESES)] = 1
        bank.log_weight[:] = rng.normal(-500.0, 30.0, HYPOTHESES)
        before = bank.log_weight.copy()
        normalise(bank, PROCESS.floor)
        living = bank.alive > 0
        expected = before[living] - np.logaddexp.reduce(before[living])
        np.testing.assert_allclose(
            bank.log_weight[living], np.maximum(expected, PROCESS.floor), atol=1e-9
        )
        total = np.exp(bank.log_weight[living]).sum()
        assert 1.0 - 1e-12 < total < 1.0 + HYPOTHESES * math.exp(PROCESS.floor)
        np.testing.assert_array_equal(bank.log_weight[~living], before[~living])


@pytest.mark.parametrize("one_encoder", [False, True])
def test_no_belief_dies_whatever_happens(one_encoder: bool) -> None:
    """Over a healthy time, a loss and its return."""
    model, start, process = parts(one_encoder)
    bank = initial_bank(start, SETTINGS)
    for percent in (FRESH, 1.0, FRESH):
        for k, r in enumerate(production(3, 30.0, Truth(percent=percent), one_encoder)):
            step(bank, model, process, r, 0.1)
            living = bank.alive > 0
            assert np.isfinite(bank.log_weight[living]).all()
            if bank.moments[LEARNING] == 0.0:
                assert bank.alive[STEADY], k
                assert bank.alive[WEARING], k
                assert bank.alive[BEFORE], k
            assert bank.log_weight[BEFORE if bank.alive[BEFORE] else STEADY] >= process.floor
            normalise(bank, process.floor)
            assert np.exp(bank.log_weight[bank.alive > 0]).sum() == pytest.approx(1.0, abs=1e-5)


def test_a_challenger_that_has_led_takes_over_and_the_belief_goes_on_beside_it() -> None:
    bank = Challenger().bank()
    believed_before = bank.mean[STEADY].copy()
    adapt_hypotheses(bank, PROCESS, TICK, 0.1, True)
    assert bank.mean[STEADY, PRELOAD] == bank.mean[WEARING, PRELOAD] == 0.0
    np.testing.assert_array_equal(bank.mean[BEFORE], believed_before)
    assert bank.log_weight[STEADY] == 2.5
    assert bank.log_weight[BEFORE] == 0.0
    assert leader_of(bank) == accepted(bank) == STEADY
    assert all(bank.alive[k] for k in (LOSS, TOTAL_LOSS, LOOSENING))  # the next contest


def test_what_began_beside_a_belief_ends_with_it() -> None:
    """A rival that still has the preload from before would take back what was lost."""
    bank = Challenger().bank()
    for k in (LUBRICATION, LOAD, LOOSENING):
        bank.mean[k], bank.covariance[k] = bank.mean[STEADY], bank.covariance[STEADY]
        bank.alive[k], bank.log_weight[k] = 1, -1.0
    adapt_hypotheses(bank, PROCESS, TICK, 0.1, True)
    kept = [k for k in range(HYPOTHESES) if bank.alive[k] and bank.mean[k, PRELOAD] > 0.0]
    assert kept == [BEFORE]


@pytest.mark.parametrize(("behind", "goes_on"), [(1.9, True), (2.1, False)])
def test_a_rival_about_as_likely_as_the_winner_goes_on(behind: float, goes_on: bool) -> None:
    """With one encoder a lost preload and a lubricant look alike."""
    bank = Challenger().bank()
    rival = 2.0 * bank.mean[STEADY]
    bank.mean[LUBRICATION], bank.covariance[LUBRICATION] = rival, bank.covariance[STEADY]
    bank.alive[LUBRICATION], bank.log_weight[LUBRICATION] = 1, bank.log_weight[LOSS] - behind
    adapt_hypotheses(bank, PROCESS, TICK, 0.1, True)
    assert bool(bank.mean[LUBRICATION, PRELOAD] == rival[PRELOAD]) is goes_on
    assert bank.alive[LUBRICATION]  # if not that one, the next


def test_what_was_believed_before_can_win_back() -> None:
    """The one before changes places with the accepted one, force and all."""
    bank = Challenger().bank()
    bank.alive[LOSS] = 0
    bank.log_weight[BEFORE], bank.age_s[BEFORE], bank.directions[BEFORE] = 3.0, 9.0, 3
    bank.mean[BEFORE] = 3.0 * bank.mean[STEADY]
    bank.force[STEADY], bank.force[BEFORE] = 0.02, 0.01
    now, then = bank.mean[STEADY].copy(), bank.mean[BEFORE].copy()
    adapt_hypotheses(bank, PROCESS, TICK, 0.1, True)
    assert bank.mean[STEADY, PRELOAD] == then[PRELOAD]
    np.testing.assert_array_equal(bank.mean[BEFORE], now)
    assert (bank.force[STEADY], bank.force[BEFORE]) == (0.01, 0.02)


@pytest.mark.parametrize(
    "challenger",
    [
        Challenger(age_s=7.9),
        Challenger(directions=1),
        Challenger(ahead=1.9),
        Challenger(calm=False),
    ],
)
def test_a_challenger_does_not_take_over_too_soon(challenger: Challenger) -> None:
    bank = challenger.bank()
    before = bank.mean[STEADY].copy()
    adapt_hypotheses(bank, PROCESS, TICK, 0.1, challenger.calm)
    np.testing.assert_array_equal(bank.mean[STEADY], before)
    assert bank.alive[LOSS]
    assert bank.mean[LOSS, PRELOAD] == 0.0


def test_the_other_direction_decides_once_it_has_been_seen() -> None:
    bank = Challenger(directions=1).bank()
    adapt_hypotheses(bank, PROCESS, TICK, 0.1, True)
    assert bank.mean[STEADY, PRELOAD] != 0.0
    adapt_hypotheses(bank, PROCESS, BACK, 0.1, True)
    assert bank.mean[STEADY, PRELOAD] == 0.0


@pytest.mark.parametrize("stop_s", [0.1, 0.9 * STOP_S, 1.1 * STOP_S])
def test_load_and_lubricant_are_changed_after_a_stop(stop_s: float) -> None:
    bank = settled()
    adapt_hypotheses(bank, PROCESS, TICK, stop_s, True)
    assert bool(bank.alive[LOAD]) is bool(bank.alive[LUBRICATION]) is (stop_s > STOP_S)


def test_any_step_may_happen_while_the_axis_moves() -> None:
    """Another load too: no stop may have been seen, and automatic lubrication needs none."""
    bank = settled()
    for _ in range(40):
        adapt_hypotheses(bank, PROCESS, TICK, 0.1, True)
    for k in CHALLENGERS:
        ahead = bank.log_weight[k] - bank.log_weight[STEADY]
        assert ahead == pytest.approx(math.log(SETTINGS.hazard * PROCESS.spawn_s))


@pytest.mark.parametrize(
    ("nis", "calm", "begins"), [(9.1, False, True), (8.9, False, False), (9.1, True, False)]
)
def test_a_loss_begins_with_the_phase_that_surprises(nis: float, calm: bool, begins: bool) -> None:
    """One that began before it has learned that nothing happened, and a total one would win."""
    bank = settled()
    adapt_hypotheses(bank, PROCESS, TICK, 4.0, True)
    bank.mean[LOSS, PRELOAD] = -1.0
    bank.moments[SURPRISE] = nis
    bank.moments[SINCE_SPAWN_S] = 0.0
    adapt_hypotheses(bank, PROCESS, TICK, 0.1, calm)
    assert bool(bank.mean[LOSS, PRELOAD] == bank.mean[STEADY, PRELOAD]) is begins


@pytest.mark.parametrize("calm", [False, True])
@pytest.mark.parametrize(("stop_s", "counted_s"), [(5.0, 5.0), (50.0, 50.0), (5000.0, 100.0)])
def test_the_longer_a_stop_the_likelier_is_another_load(
    stop_s: float, counted_s: float, calm: bool
) -> None:
    """Even where the phase after it passes for one under a force: that may be the other load."""
    bank = settled()
    adapt_hypotheses(bank, PROCESS, TICK, stop_s, calm)
    for slot in (LOAD, LUBRICATION):
        expected = math.log(SETTINGS.stop_hazard * counted_s)
        assert bank.log_weight[slot] - bank.log_weight[STEADY] == pytest.approx(expected)
    assert bank.moments[STOPPED_S] == 0.0


def test_one_encoder_knows_neither_load_nor_looseness() -> None:
    process = parts(one_encoder=True)[2]
    bank = settled(one_encoder=True)
    adapt_hypotheses(bank, process, TICK, 5.0, True)
    for _ in range(40):
        adapt_hypotheses(bank, process, TICK, 0.1, True)
    assert [k for k in CHALLENGERS if bank.alive[k]] == [LOSS, TOTAL_LOSS, LUBRICATION]


def test_a_step_changes_what_its_name_says_and_nothing_else() -> None:
    """Each challenger is the belief, but for what has just happened to it."""
    bank = settled()
    adapt_hypotheses(bank, PROCESS, TICK, 5.0, True)
    for _ in range(40):
        adapt_hypotheses(bank, PROCESS, TICK, 0.1, True)
    x, p = bank.mean[STEADY], bank.covariance[STEADY]
    frictions = set(range(NUT_FRICTION, GUIDE_VISCOUS + 1))
    touched = {LOSS: {PRELOAD}, TOTAL_LOSS: {PRELOAD}, LUBRICATION: frictions}
    touched |= {LOAD: {PAYLOAD, GUIDE_FRICTION, TORQUE_OFFSET}, LOOSENING: {LOOSENESS}}
    for k in CHALLENGERS:
        changed = (bank.mean[k] != x) | (np.diag(bank.covariance[k]) != np.diag(p))
        assert set(np.flatnonzero(changed)) == touched[k], k
    assert bank.mean[TOTAL_LOSS, PRELOAD] == pytest.approx(math.log(0.02 * FRESH))
    grown = bank.covariance[LOSS, PRELOAD, PRELOAD] - p[PRELOAD, PRELOAD]
    assert grown == pytest.approx(SETTINGS.loss**2)


def test_the_beginning_ends_with_the_likeliest_and_the_next() -> None:
    bank = initial_bank(START, SETTINGS)
    bank.log_weight[:6] = (-9.0, -1.0, -0.5, -9.0, -9.0, -9.0)
    adapt_hypotheses(bank, PROCESS, TICK._replace(steady_s=19.9), 0.1, True)
    assert bank.moments[LEARNING] == 1.0
    none, half = bank.mean[LOSS, PRELOAD], bank.mean[WEARING, PRELOAD]
    adapt_hypotheses(bank, PROCESS, TICK._replace(steady_s=0.2), 0.1, True)
    assert bank.moments[LEARNING] == 0.0
    assert bank.mean[STEADY, PRELOAD] == bank.mean[WEARING, PRELOAD] == none
    assert bank.mean[BEFORE, PRELOAD] == half
    assert set(np.flatnonzero(bank.alive)) == {STEADY, WEARING, BEFORE}


def test_the_beginnings_are_a_distribution() -> None:
    for one_encoder in (False, True):
        bank = initial_bank(parts(one_encoder)[1], SETTINGS)
        living = bank.alive > 0
        assert living.sum() == (3 if one_encoder else 6)
        share = np.exp(bank.log_weight[living]).sum()
        assert share == pytest.approx(1.0 - SETTINGS.loaded if one_encoder else 1.0)
        for covariance in bank.covariance[living]:
            np.testing.assert_array_equal(covariance, covariance.T)
            assert np.linalg.eigvalsh(covariance).min() > -1e-15


def test_a_night_forgets_the_screws_growth_and_asks_what_else_has_changed() -> None:
    bank = settled()
    before = bank.covariance[STEADY, PRELOAD, PRELOAD]
    bank.covariance[STEADY, 11, 11] = 1e-20
    continue_after_stop(bank, START, 86_400.0)
    assert bank.covariance[STEADY, PRELOAD, PRELOAD] == pytest.approx(before + 0.05**2)
    assert bank.covariance[STEADY, 11, 11] == START.covariance[11, 11]
    assert bank.alive.sum() == 3
    assert bank.mean[NUT_SLOT, PRELOAD] == START.mean[PRELOAD]
    assert bank.covariance[LOAD_SLOT, PAYLOAD, PAYLOAD] == START.load[PAYLOAD, PAYLOAD]
    assert bank.moments[LEARNING] == 1.0


def test_settings_of_nothing_give_no_such_challenger() -> None:
    bank = settled()
    nothing = np.full(HYPOTHESES, -np.inf)
    quiet = PROCESS._replace(priors=nothing, stop_priors=nothing)
    adapt_hypotheses(bank, quiet, TICK, 5.0, True)
    assert not any(bank.alive[k] for k in CHALLENGERS)
