"""Posterior of a bank, against one of another kind: vectors, scipy, quadrature."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import norm, truncnorm

from edge_service.estimate.imm.modes import LEVELS_PERCENT
from edge_service.estimate.mixture import posterior, state
from edge_service.estimate.mixture.hypotheses import BOTH, FORCED, accepted
from edge_service.estimate.mixture.posterior import Posterior
from edge_service.estimate.mixture.state import Bank, empty_bank
from edge_service.messages.samples import Floats

from . import mixture_axis as axis

MOST = math.log(state.MOST_SHARE * axis.FRESH)


def drawn(seed: int, one_encoder: bool = False) -> Bank:
    """Hypotheses drawn around the start, with correlated covariances."""
    start = axis.parts(one_encoder)[1]
    rng, size = np.random.default_rng(seed), len(start.mean)
    bank = empty_bank(size)
    bank.alive[:] = rng.random(state.HYPOTHESES) < 0.6
    bank.alive[state.STEADY] = 1
    bank.log_weight[:] = np.log(rng.dirichlet(np.full(state.HYPOTHESES, 0.3)) + 1e-6)
    bank.force[:] = rng.random(state.HYPOTHESES)
    bank.directions[:] = rng.integers(1, 4, state.HYPOTHESES)
    bank.age_s[:] = rng.uniform(0.0, 3.0, state.HYPOTHESES)
    bank.moments[[state.BELIEVED_FORCED_S, state.PAST_FORCED_S]] = rng.uniform(0.0, 4.0, 2)
    sigma = np.sqrt(np.diag(start.covariance))
    sigma[state.PRELOAD] = rng.uniform(0.02, 0.8)
    base = start.mean.copy()
    base[state.PRELOAD] = math.log(rng.choice([0.1, 1.0, 3.0, 6.8, 9.0]))
    for k in range(state.HYPOTHESES):
        root = rng.standard_normal((size, size)) / math.sqrt(size)
        bank.mean[k] = base + sigma * rng.standard_normal(size)
        bank.covariance[k] = sigma[:, None] * (root @ root.T) * sigma[None, :]
    return bank


def read(bank: Bank, one_encoder: bool = False) -> Posterior:
    model = axis.parts(one_encoder)[0]
    return posterior.posterior_of(
        bank, model, posterior.fault_limits(axis.machine(one_encoder), model, axis.SETTINGS)
    )


def flat(found: Posterior) -> Floats:
    stiffness = found.stiffness or ()
    numbers = (*found.preload, *found.drag, *stiffness, *found.levels.values())
    return np.array([*numbers, *found.faults.values()])


JOINTS = {state.LOOSENESS: 1.0, state.COUPLING: 1.0}


class Another:
    """The same numbers from whole vectors and from scipy."""

    def __init__(self, bank: Bank) -> None:
        rows = bank.alive > 0
        self.mean, self.cov = bank.mean[rows], bank.covariance[rows]
        self.weight = np.exp(bank.log_weight[rows])
        self.weight /= self.weight.sum()
        slots = np.flatnonzero(rows)
        rises = bank.mean[slots, state.PRELOAD] > bank.mean[accepted(bank), state.PRELOAD]
        older = bank.moments[state.BELIEVED_FORCED_S] - bank.age_s[slots] > posterior.LASTED_S
        if bank.moments[state.PAST_FORCED_S] > posterior.LASTED_S:
            older |= bank.moments[state.BELIEVED_FORCED_S] > 0.0
        forced = older | (bank.force[slots] > FORCED)
        doubted = (bank.directions[slots] != BOTH) & (forced | rises)
        doubted |= forced & (bank.age_s[slots] < 0.25 * state.ASSUMED.confirm_s)
        doubted &= slots > state.WEARING
        share = self.weight[doubted].sum()
        if share > posterior.DOUBTED:
            self.weight[doubted] *= posterior.DOUBTED / share
            self.weight[slots == accepted(bank)] += share - posterior.DOUBTED
        self.firm = np.where(doubted & ~rises, 0.0, self.weight)
        self.firm[slots == accepted(bank)] += 1.0 - self.firm.sum()
        self.force = float(self.weight @ bank.force[rows])
        self.q = self.mean[:, state.PRELOAD]
        variance = self.cov[:, state.PRELOAD, state.PRELOAD] + posterior.MODEL_ERROR**2
        variance += (posterior.MODEL_ERROR_SHARE * (self.q - math.log(axis.FRESH))) ** 2
        self.sigma = np.sqrt(variance)
        self.two = self.mean.shape[1] > state.NUT_COMPLIANCE
        self.guide_nm = axis.RATIO * axis.GUIDE_N if self.two else 0.0
        self.bearing_nm = axis.BEARING_NM + axis.RATIO * axis.GUIDE_N - self.guide_nm

    def below(self, percent: float, most: float = MOST) -> float:
        weight = self.weight if most == MOST else self.firm
        total, lost = 0.0, np.minimum(self.q - math.log(axis.FRESH), 0.0)
        for factor, share in zip(posterior.LAW_FACTORS, posterior.LAW_WEIGHTS, strict=True):
            q = self.q + (factor - 1.0) * lost
            within = truncnorm(-np.inf, (most - q) / self.sigma, q, self.sigma)
            total += share * float(weight @ within.cdf(math.log(percent)))
        return total

    def quantile(self, probability: float, most: float = MOST) -> float:
        def missing(x: float) -> float:
            return self.below(math.exp(x), most) - probability

        return math.exp(brentq(missing, -30.0, most, xtol=1e-13))

    def preload(self) -> tuple[float, float, float]:
        low, high = self.quantile(0.025), self.quantile(0.975)
        undetermined = posterior.UNDETERMINED_SHARE * axis.FRESH
        if self.quantile(0.5) < undetermined and low < 0.5 * undetermined:
            low = 0.0
        median = min(self.quantile(0.5, MOST + posterior.READ_ABOVE), axis.FRESH)
        high = max(high, median, posterior.UNDETERMINED_HIGH_SHARE * axis.FRESH)
        return median, min(low, median), high

    def spread(self, mean: Floats, variance: Floats) -> tuple[float, float]:
        value = float(self.weight @ mean)
        return value, 1.96 * math.sqrt(float(self.weight @ (variance + (mean - value) ** 2)))

    def drag(self) -> tuple[float, float, float]:
        """k p (1 + nut) + B (1 + bearing) + R G (1 + guide), to first order."""
        screw = axis.PER_PERCENT_NM * np.exp(self.q)
        slope = np.zeros_like(self.mean)
        nut, bearing = self.mean[:, state.NUT_FRICTION], self.mean[:, state.BEARING_FRICTION]
        slope[:, state.PRELOAD], slope[:, state.NUT_FRICTION] = screw * (1.0 + nut), screw
        slope[:, [state.BEARING_FRICTION, state.GUIDE_FRICTION]] = self.bearing_nm, self.guide_nm
        slope[:, state.TORQUE_WANDER] = 1.0
        mean = screw * (1.0 + nut) + self.bearing_nm * (1.0 + bearing)
        mean += self.guide_nm * (1.0 + self.mean[:, state.GUIDE_FRICTION])
        value, half = self.spread(mean, np.einsum("ki,kij,kj->k", slope, self.cov, slope))
        return value, value - half, value + half

    def stiffness(self) -> tuple[float, ...]:
        """C + Cn ((p0 / p)^(1/3) - 1), the table's mass known to 2 %."""
        if not self.two:
            return ()
        percent, nut = np.exp(self.q), self.mean[:, state.NUT_COMPLIANCE]
        root = np.cbrt(axis.FRESH / np.maximum(percent, 0.5))
        loose = self.mean[:, state.LOOSENESS] + self.mean[:, state.COUPLING]
        compliance = axis.COMPLIANCE + loose + nut * (root - 1.0)
        variance = np.where(percent > 0.5, nut * root / 3.0 * self.sigma, 0.0) ** 2
        joints = self.cov[
            :, [[state.LOOSENESS], [state.COUPLING]], [state.LOOSENESS, state.COUPLING]
        ]
        variance += (0.02 * compliance) ** 2 + joints.sum(axis=(1, 2))
        variance += (root - 1.0) ** 2 * self.cov[:, state.NUT_COMPLIANCE, state.NUT_COMPLIANCE]
        value, half = self.spread(compliance, variance)
        return 1.0 / value, 1.0 / (value + half), 1.0 / max(value - half, 0.1 * value)

    def above(self, slope: dict[int, float], limit: float) -> float:
        vector = np.zeros(self.mean.shape[1])
        vector[list(slope)] = list(slope.values())
        sigma = np.sqrt(np.einsum("i,kij,j->k", vector, self.cov, vector))
        return float(self.weight @ norm.sf(limit, self.mean @ vector, sigma))

    def faults(self) -> list[float]:
        frictions = {
            state.NUT_FRICTION: axis.PER_PERCENT_NM * axis.FRESH,
            state.BEARING_FRICTION: self.bearing_nm,
            state.GUIDE_FRICTION: self.guide_nm,
        }
        found = [self.below((1.0 - posterior.LOST_SHARE) * axis.FRESH)]
        found += [self.above(frictions, posterior.SLICK_SHARE * axis.COULOMB_NM), self.force]
        if not self.two:
            return found
        kg = posterior.PAYLOAD_SHARE * axis.TABLE_KG
        load = self.above({state.PAYLOAD: 1.0}, kg) + self.above({state.PAYLOAD: -1.0}, kg)
        kept = 1.0 - self.below(posterior.UNDETERMINED_SHARE * axis.FRESH)
        return [*found, load, kept * self.above(JOINTS, posterior.LOOSE_SHARE * axis.COMPLIANCE)]

    def numbers(self) -> Floats:
        edges = [0.5 * (a + b) for a, b in pairwise(LEVELS_PERCENT)]
        levels = -np.diff([1.0, *(self.below(edge) for edge in edges), 0.0])
        return np.array([*self.preload(), *self.drag(), *self.stiffness(), *levels, *self.faults()])


@pytest.mark.parametrize("seed", range(15))
def test_the_numbers_are_those_of_another_reading(seed: int) -> None:
    bank = drawn(seed)
    np.testing.assert_allclose(flat(read(bank)), Another(bank).numbers(), rtol=1e-7, atol=1e-9)


class TorqueAlone:
    """Preload of an axis with one encoder by sampling: frictions are drawn, and weighed."""

    def __init__(self, bank: Bank, draws: int = 400_000) -> None:
        rng = np.random.default_rng(3)
        self.percent = axis.FRESH * np.where(
            rng.random(draws) < 0.5,
            truncnorm(-20.0, 1.0, 1.0, 0.05).rvs(draws, random_state=rng),
            rng.uniform(0.0, state.MOST_SHARE, draws),
        )
        warm = 1.0 - 0.35 * rng.integers(0, 5, draws) / 4.0
        nut, other, both = rng.standard_normal((3, draws))
        fresh_nm = axis.PER_PERCENT_NM * axis.FRESH
        other_nm = (axis.COULOMB_NM - fresh_nm) * (warm + 0.07 * other)
        screw_nm = axis.PER_PERCENT_NM * self.percent
        error_nm = posterior.DRAG_ERROR_SHARE * (fresh_nm - screw_nm) * rng.standard_normal(draws)
        every_nm = screw_nm * (warm + 0.07 * nut) + other_nm + error_nm
        every_nm += 0.1 * both * warm * (screw_nm + axis.COULOMB_NM - fresh_nm)
        self.weights = self._weights(bank, every_nm)

    def _weights(self, bank: Bank, every_nm: Floats) -> list[tuple[Floats, bool]]:
        reading, slots = Another(bank), np.flatnonzero(bank.alive)
        found = []
        for i, slot in enumerate(slots):
            one = Another(bank)
            one.mean, one.cov = reading.mean[i : i + 1], reading.cov[i : i + 1]
            one.q, one.weight = reading.q[i : i + 1], np.ones(1)
            level_nm, _, high_nm = one.drag()
            density = norm.pdf(every_nm, level_nm, (high_nm - level_nm) / 1.96)
            share = reading.weight[i] / max(density.sum(), 1e-300)
            found.append(
                (share * density, bool(slot in (state.STEADY, state.WEARING, state.BEFORE)))
            )
        return found

    def quantile(self, probability: float, accepted: bool) -> float:
        weight = sum(each for each, mine in self.weights if mine or not accepted)
        order = np.argsort(self.percent)
        cumulated = np.cumsum(weight[order])
        at = np.searchsorted(cumulated, probability * cumulated[-1])
        return float(self.percent[order][at])


def test_doubt_of_a_challenger_leaves_the_answer_with_what_is_accepted() -> None:
    """However unlikely that has become: rivals of no weight at all do not answer instead."""
    start = axis.parts(False)[1]
    bank = empty_bank(len(start.mean))
    bank.mean[:], bank.covariance[:] = start.mean, start.covariance
    slots = [state.STEADY, state.TOTAL_LOSS, state.BEFORE]
    bank.alive[slots] = 1
    bank.log_weight[slots] = -13.0, -8.0, 0.0
    bank.mean[slots, state.PRELOAD] = np.log([0.9 * axis.FRESH, 0.02 * axis.FRESH, axis.FRESH])
    bank.directions[slots] = BOTH, 0, 1
    assert read(bank).preload[0] > 0.8 * axis.FRESH


@pytest.mark.parametrize(
    ("forced_s", "past_s", "at_once"), [(0.5, 0.9, True), (1.5, 0.0, False), (0.5, 1.1, False)]
)
def test_a_loss_seen_one_way_is_doubted_under_a_force_that_was_there_before_or_where_it_cuts(
    forced_s: float, past_s: float, at_once: bool
) -> None:
    start = axis.parts(False)[1]
    bank = empty_bank(len(start.mean))
    bank.mean[:], bank.covariance[:] = start.mean, start.covariance
    bank.alive[[state.STEADY, state.TOTAL_LOSS]] = 1
    bank.log_weight[[state.STEADY, state.TOTAL_LOSS]] = -3.0, 0.0
    bank.mean[state.TOTAL_LOSS, state.PRELOAD] = math.log(0.02 * axis.FRESH)
    bank.directions[state.TOTAL_LOSS] = 2
    bank.moments[[state.BELIEVED_FORCED_S, state.PAST_FORCED_S]] = forced_s, past_s
    found = read(bank)
    assert found.preload[0] / axis.FRESH == pytest.approx(0.02 if at_once else 1.0, abs=0.1)
    assert found.preload[1] < 0.2 * axis.FRESH


@pytest.mark.parametrize("level", [0.5, 0.7, 0.85, 1.0, 1.2])
def test_torque_alone_leaves_every_preload_that_friction_may_hide(level: float) -> None:
    """The belief and a rival that is not accepted; the numbers are those of drawn frictions."""
    bank, start = empty_bank(state.TORQUE_STATES), axis.parts(True)[1]
    bearings, wander = axis.COULOMB_NM / axis.parts(True)[0].bearing_nm, state.TORQUE_WANDER
    for slot, change, weight in ((state.STEADY, -1.0, 0.7), (state.TOTAL_LOSS, -1.3, 0.3)):
        bank.mean[slot], bank.covariance[slot] = start.mean, 1e-4 * start.covariance
        bank.mean[slot, state.BEARING_FRICTION] = (level + change) * bearings
        bank.covariance[slot, wander, wander] = (0.03 * axis.COULOMB_NM) ** 2
        bank.alive[slot], bank.log_weight[slot] = 1, math.log(weight)
    drawn_ones = TorqueAlone(bank)
    value, low, high = read(bank, one_encoder=True).preload
    lowest = min(drawn_ones.quantile(0.025, accepted) for accepted in (False, True))
    highest = max(drawn_ones.quantile(0.975, accepted) for accepted in (False, True))
    assert value == pytest.approx(drawn_ones.quantile(0.5, True), abs=0.02 * axis.FRESH)
    assert low == pytest.approx(
        lowest if lowest > posterior.LOST_SHARE * axis.FRESH else 0.0, abs=0.03 * axis.FRESH
    )
    assert high == pytest.approx(highest, abs=0.02 * axis.FRESH)
