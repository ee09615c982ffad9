"""Posterior of a bank, against one of another kind: vectors, scipy, quadrature."""

import inspect
import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import norm, truncnorm

from edge_service.estimate.imm.modes import LEVELS_PERCENT
from edge_service.estimate.mixture import posterior
from edge_service.estimate.mixture.posterior import (
    LOOSE_SHARE,
    LOST_SHARE,
    MODEL_ERROR,
    MODEL_ERROR_SHARE,
    PAYLOAD_SHARE,
    SLICK_SHARE,
    UNDETERMINED_HIGH_SHARE,
    UNDETERMINED_SHARE,
    Posterior,
    fault_limits,
    posterior_of,
)
from edge_service.estimate.mixture.state import (
    BEARING_FRICTION,
    BEFORE,
    COUPLING,
    GUIDE_FRICTION,
    HYPOTHESES,
    LOOSENESS,
    MOST_SHARE,
    NUT_COMPLIANCE,
    NUT_FRICTION,
    PAYLOAD,
    PRELOAD,
    STEADY,
    TORQUE_STATES,
    TORQUE_WANDER,
    TOTAL_LOSS,
    WEARING,
    Bank,
    empty_bank,
)
from edge_service.messages.samples import Floats

from .mixture_axis import (
    BEARING_NM,
    COMPLIANCE,
    COULOMB_NM,
    FRESH,
    GUIDE_N,
    PER_PERCENT_NM,
    RATIO,
    SETTINGS,
    TABLE_KG,
    machine,
    parts,
)

MOST = math.log(MOST_SHARE * FRESH)


def drawn(seed: int, one_encoder: bool = False) -> Bank:
    """Hypotheses drawn around the start, with correlated covariances."""
    start = parts(one_encoder)[1]
    rng, size = np.random.default_rng(seed), len(start.mean)
    bank = empty_bank(size)
    bank.alive[:] = rng.random(HYPOTHESES) < 0.6
    bank.alive[rng.integers(HYPOTHESES)] = 1
    bank.log_weight[:] = np.log(rng.dirichlet(np.full(HYPOTHESES, 0.3)) + 1e-6)
    bank.force[:] = rng.random(HYPOTHESES)
    sigma = np.sqrt(np.diag(start.covariance))
    sigma[PRELOAD] = rng.uniform(0.02, 0.8)
    base = start.mean.copy()
    base[PRELOAD] = math.log(rng.choice([0.1, 1.0, 3.0, 6.8, 9.0]))
    for k in range(HYPOTHESES):
        root = rng.standard_normal((size, size)) / math.sqrt(size)
        bank.mean[k] = base + sigma * rng.standard_normal(size)
        bank.covariance[k] = sigma[:, None] * (root @ root.T) * sigma[None, :]
    return bank


def read(bank: Bank, one_encoder: bool = False) -> Posterior:
    model = parts(one_encoder)[0]
    return posterior_of(bank, model, fault_limits(machine(one_encoder), model, SETTINGS))


def flat(found: Posterior) -> Floats:
    stiffness = found.stiffness or ()
    numbers = (
        *found.preload,
        *found.drag,
        *stiffness,
        *found.levels.values(),
        *found.faults.values(),
    )
    return np.array(numbers)


JOINTS = {LOOSENESS: 1.0, COUPLING: 1.0}


class Another:
    """The same numbers from whole vectors and from scipy."""

    def __init__(self, bank: Bank) -> None:
        rows = bank.alive > 0
        self.mean, self.cov = bank.mean[rows], bank.covariance[rows]
        self.weight = np.exp(bank.log_weight[rows])
        self.weight /= self.weight.sum()
        self.force = float(self.weight @ bank.force[rows])
        self.q = self.mean[:, PRELOAD]
        variance = self.cov[:, PRELOAD, PRELOAD] + MODEL_ERROR**2
        variance += (MODEL_ERROR_SHARE * (self.q - math.log(FRESH))) ** 2
        self.sigma = np.sqrt(variance)
        self.two = self.mean.shape[1] > NUT_COMPLIANCE
        self.guide_nm = RATIO * GUIDE_N if self.two else 0.0
        self.bearing_nm = BEARING_NM + RATIO * GUIDE_N - self.guide_nm

    def below(self, percent: float, most: float = MOST) -> float:
        within = truncnorm(-np.inf, (most - self.q) / self.sigma, self.q, self.sigma)
        return float(self.weight @ within.cdf(math.log(percent)))

    def quantile(self, probability: float, most: float = MOST) -> float:
        def missing(x: float) -> float:
            return self.below(math.exp(x), most) - probability

        return math.exp(brentq(missing, -30.0, most, xtol=1e-13))

    def preload(self) -> tuple[float, float, float]:
        low, high = self.quantile(0.025), self.quantile(0.975)
        if high < UNDETERMINED_SHARE * FRESH and low < 0.5 * UNDETERMINED_SHARE * FRESH:
            low = 0.0
        high = max(high, UNDETERMINED_HIGH_SHARE * FRESH)
        median = min(self.quantile(0.5, MOST + posterior.READ_ABOVE), FRESH)
        return median, min(low, median), max(high, median)

    def spread(self, mean: Floats, variance: Floats) -> tuple[float, float]:
        value = float(self.weight @ mean)
        return value, 1.96 * math.sqrt(float(self.weight @ (variance + (mean - value) ** 2)))

    def drag(self) -> tuple[float, float, float]:
        """k p (1 + nut) + B (1 + bearing) + R G (1 + guide), to first order."""
        screw = PER_PERCENT_NM * np.exp(self.q)
        slope = np.zeros_like(self.mean)
        nut, bearing = self.mean[:, NUT_FRICTION], self.mean[:, BEARING_FRICTION]
        slope[:, PRELOAD], slope[:, NUT_FRICTION] = screw * (1.0 + nut), screw
        slope[:, BEARING_FRICTION], slope[:, GUIDE_FRICTION] = self.bearing_nm, self.guide_nm
        slope[:, TORQUE_WANDER] = 1.0
        mean = screw * (1.0 + nut) + self.bearing_nm * (1.0 + bearing)
        mean += self.guide_nm * (1.0 + self.mean[:, GUIDE_FRICTION])
        value, half = self.spread(mean, np.einsum("ki,kij,kj->k", slope, self.cov, slope))
        return value, value - half, value + half

    def stiffness(self) -> tuple[float, ...]:
        """C + Cn ((p0 / p)^(1/3) - 1), the table's mass known to 2 %."""
        if not self.two:
            return ()
        percent, nut = np.exp(self.q), self.mean[:, NUT_COMPLIANCE]
        root = np.cbrt(FRESH / np.maximum(percent, 0.5))
        loose = self.mean[:, LOOSENESS] + self.mean[:, COUPLING]
        compliance = COMPLIANCE + loose + nut * (root - 1.0)
        variance = np.where(percent > 0.5, nut * root / 3.0 * self.sigma, 0.0) ** 2
        joints = self.cov[:, [[LOOSENESS], [COUPLING]], [LOOSENESS, COUPLING]]
        variance += (0.02 * compliance) ** 2 + joints.sum(axis=(1, 2))
        variance += (root - 1.0) ** 2 * self.cov[:, NUT_COMPLIANCE, NUT_COMPLIANCE]
        value, half = self.spread(compliance, variance)
        return 1.0 / value, 1.0 / (value + half), 1.0 / max(value - half, 0.1 * value)

    def above(self, slope: dict[int, float], limit: float) -> float:
        vector = np.zeros(self.mean.shape[1])
        vector[list(slope)] = list(slope.values())
        sigma = np.sqrt(np.einsum("i,kij,j->k", vector, self.cov, vector))
        return float(self.weight @ norm.sf(limit, self.mean @ vector, sigma))

    def faults(self) -> list[float]:
        frictions = {
            NUT_FRICTION: PER_PERCENT_NM * FRESH,
            BEARING_FRICTION: self.bearing_nm,
            GUIDE_FRICTION: self.guide_nm,
        }
        found = [self.below((1.0 - LOST_SHARE) * FRESH)]
        found += [self.above(frictions, SLICK_SHARE * COULOMB_NM), self.force]
        if not self.two:
            return found
        kg = PAYLOAD_SHARE * TABLE_KG
        load = self.above({PAYLOAD: 1.0}, kg) + self.above({PAYLOAD: -1.0}, kg)
        return [*found, load, self.above(JOINTS, LOOSE_SHARE * COMPLIANCE)]

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
        self.percent = FRESH * np.where(
            rng.random(draws) < 0.5,
            truncnorm(-20.0, 1.0, 1.0, 0.05).rvs(draws, random_state=rng),
            rng.uniform(0.0, MOST_SHARE, draws),
        )
        warm = 1.0 - 0.35 * rng.integers(0, 5, draws) / 4.0
        nut, other, both = rng.standard_normal((3, draws))
        fresh_nm = PER_PERCENT_NM * FRESH
        other_nm = (COULOMB_NM - fresh_nm) * (warm + 0.07 * other)
        screw_nm = PER_PERCENT_NM * self.percent
        error_nm = MODEL_ERROR_SHARE * (fresh_nm - screw_nm) * rng.standard_normal(draws)
        every_nm = screw_nm * (warm + 0.07 * nut) + other_nm + error_nm
        every_nm += 0.1 * both * warm * (screw_nm + COULOMB_NM - fresh_nm)
        self.weights = self._weights(bank, every_nm)

    def _weights(self, bank: Bank, every_nm: Floats) -> list[tuple[Floats, bool]]:
        reading = Another(bank)
        slots = np.flatnonzero(bank.alive)
        found = []
        for i, slot in enumerate(slots):
            one = Another(bank)
            one.mean, one.cov = reading.mean[i : i + 1], reading.cov[i : i + 1]
            one.q, one.weight = reading.q[i : i + 1], np.ones(1)
            level_nm, _, high_nm = one.drag()
            density = norm.pdf(every_nm, level_nm, (high_nm - level_nm) / 1.96)
            share = reading.weight[i] / max(density.sum(), 1e-300)
            found.append((share * density, bool(slot in (STEADY, WEARING, BEFORE))))
        return found

    def quantile(self, probability: float, accepted: bool) -> float:
        weight = sum(each for each, mine in self.weights if mine or not accepted)
        order = np.argsort(self.percent)
        cumulated = np.cumsum(weight[order])
        at = np.searchsorted(cumulated, probability * cumulated[-1])
        return float(self.percent[order][at])


@pytest.mark.parametrize("level", [0.5, 0.7, 0.85, 1.0, 1.2])
def test_torque_alone_leaves_every_preload_that_friction_may_hide(level: float) -> None:
    """The belief and a rival that is not accepted; the numbers are those of drawn frictions."""
    bank = empty_bank(TORQUE_STATES)
    start = parts(True)[1]
    for slot, change, weight in ((STEADY, level - 1.0, 0.7), (TOTAL_LOSS, level - 1.3, 0.3)):
        bank.mean[slot], bank.covariance[slot] = start.mean, 1e-4 * start.covariance
        bank.mean[slot, BEARING_FRICTION] = change * COULOMB_NM / parts(True)[0].bearing_nm
        bank.covariance[slot, TORQUE_WANDER, TORQUE_WANDER] = (0.03 * COULOMB_NM) ** 2
        bank.alive[slot], bank.log_weight[slot] = 1, math.log(weight)
    drawn_ones = TorqueAlone(bank)
    value, low, high = read(bank, one_encoder=True).preload
    lowest = min(drawn_ones.quantile(0.025, accepted) for accepted in (False, True))
    highest = max(drawn_ones.quantile(0.975, accepted) for accepted in (False, True))
    assert value == pytest.approx(drawn_ones.quantile(0.5, True), abs=0.02 * FRESH)
    assert low == pytest.approx(lowest if lowest > LOST_SHARE * FRESH else 0.0, abs=0.03 * FRESH)
    assert high == pytest.approx(highest, abs=0.02 * FRESH)


def test_plain_python_gives_the_same_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    banks = [drawn(seed) for seed in range(4)]
    compiled = [flat(read(bank)) for bank in banks]
    for name, value in inspect.getmembers(posterior):
        if hasattr(value, "py_func"):
            monkeypatch.setattr(posterior, name, value.py_func)
    assert inspect.isfunction(posterior.packed_posterior)
    plain = [flat(read(bank)) for bank in banks]
    np.testing.assert_allclose(plain, compiled, rtol=1e-10, atol=1e-12)
