"""What is read from a mixture, held against a reading of another kind: vectors, scipy, brentq."""

import inspect
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import norm

from edge_service.estimate import fused_answers, mixture_interval
from edge_service.estimate.fused_answers import (
    GAIN_SHARE,
    LAG_S,
    MODEL_ERROR_PERCENT,
    PLAY_M,
    Answers,
    answers,
    limits_of,
)
from edge_service.estimate.fused_begin import begun
from edge_service.estimate.fused_model import FusedSettings, fused_model, start_of
from edge_service.estimate.fused_state import (
    DRY,
    GAIN,
    GUIDE,
    LUBE,
    MASS,
    NUT,
    PLAY,
    PRELOAD,
    RATE,
    RUB_NODES,
    WEARING,
    Mixture,
)
from edge_service.estimate.mixture_interval import interval, mixture_cdf
from edge_service.estimate.transition import LEVELS_PERCENT
from edge_service.messages.samples import Floats
from edge_service.studies.estimator_axis import OwnAxis

AXIS = OwnAxis(1)
SETTINGS = FusedSettings()


def drawn(seed: int, one_encoder: bool = False) -> Mixture:
    """Hypotheses drawn around the start, with correlated covariances."""
    machine = replace(AXIS, one_encoder=one_encoder).commissioned()
    model = fused_model(machine, SETTINGS)
    mixture = begun(start_of(machine, model, SETTINGS), model)
    rng, size = np.random.default_rng(seed), mixture.mean.shape[1]
    alive = int(rng.integers(1, 25))
    mixture.alive[0] = alive
    mixture.log_weight[:alive] = np.log(rng.dirichlet(np.full(alive, 0.3)) + 1e-9)
    mixture.mode[:alive] = rng.integers(0, 3, alive)
    mixture.force[:alive] = rng.uniform(0.0, 1.0, alive)
    sigma = np.sqrt(np.diag(mixture.covariance[0]))
    sigma[PRELOAD], sigma[PLAY], sigma[MASS] = rng.uniform(0.05, 1.5), 1e-6, 2.0
    base = mixture.mean[0].copy()
    base[PRELOAD] = rng.choice([0.3, 1.4, 3.0, 6.8, 10.0])
    for k in range(alive):
        root = rng.standard_normal((size, size)) / math.sqrt(size)
        mixture.mean[k] = base + sigma * rng.standard_normal(size)
        mixture.covariance[k] = sigma[:, None] * (root @ root.T) * sigma[None, :]
    mixture.mean[:alive, NUT] = np.abs(mixture.mean[:alive, NUT])
    return mixture


def read(mixture: Mixture, one_encoder: bool = False) -> Answers:
    machine = replace(AXIS, one_encoder=one_encoder).commissioned()
    model = fused_model(machine, SETTINGS)
    limits = limits_of(machine, model, start_of(machine, model, SETTINGS))
    return answers(mixture, model, limits, not one_encoder)


def flat(told: Answers) -> Floats:
    stiffness = told.stiffness or ()
    numbers = (*told.preload, *told.drag, *stiffness, *told.levels.values(), *told.faults.values())
    return np.array(numbers)


class Another:
    """The same numbers from whole vectors and from scipy."""

    def __init__(self, mixture: Mixture, one_encoder: bool) -> None:
        self.machine = replace(AXIS, one_encoder=one_encoder).commissioned()
        self.model = fused_model(self.machine, SETTINGS)
        self.start = start_of(self.machine, self.model, SETTINGS)
        alive = int(mixture.alive[0])
        self.mean, self.cov = mixture.mean[:alive], mixture.covariance[:alive]
        self.weight = np.exp(mixture.log_weight[:alive])
        self.weight /= self.weight.sum()
        self.force = mixture.force[:alive]
        drag = self.machine.model.preload_drag_nm
        assert drag is not None
        share = max(0.02, drag.tolerance) * (self.mean[:, PRELOAD] - self.model.fresh_percent)
        lag = LAG_S * self.mean[:, RATE] * (mixture.mode[:alive] == WEARING)
        variance = self.cov[:, PRELOAD, PRELOAD] + share**2 + MODEL_ERROR_PERCENT**2 + lag**2
        self.sigma = np.sqrt(variance)

    def below(self, x: float) -> float:
        return float(self.weight @ norm.cdf(x, self.mean[:, PRELOAD], self.sigma))

    def quantile(self, probability: float) -> float:
        return float(brentq(lambda x: self.below(x) - probability, -80.0, 80.0, xtol=1e-13))

    def preload(self) -> tuple[float, float, float]:
        mean = float(self.weight @ self.mean[:, PRELOAD])
        zero = self.below(0.0)
        if zero > 0.025 or mean < 1.5:
            low, high = 0.0, self.quantile(zero + 0.95 * (1.0 - zero))
        else:
            shares = (0.025, 0.975)
            low, high = (self.quantile(zero + share * (1.0 - zero)) for share in shares)
        mean = max(mean, 0.0)
        return mean, min(max(low, 0.0), mean), max(high, mean)

    def along(self, slope: dict[int, float]) -> tuple[Floats, Floats]:
        vector = np.zeros(self.mean.shape[1])
        for index, value in slope.items():
            vector[index] = value
        variance = np.einsum("i,kij,j->k", vector, self.cov, vector)
        return self.mean @ vector, np.sqrt(variance)

    def spread(self, mean: Floats, sigma: Floats) -> tuple[float, float]:
        value = float(self.weight @ mean)
        return value, 1.96 * math.sqrt(float(self.weight @ (sigma**2 + (mean - value) ** 2)))

    def stiffness(self) -> tuple[float, float, float]:
        model, table = self.model, self.machine.model.table_mass_kg
        assert table is not None
        percent = self.mean[:, PRELOAD]
        load = np.maximum(percent, 0.5)
        root, nut = np.cbrt(model.fresh_percent / load), self.mean[:, NUT]
        compliance = model.compliance_m_per_n + nut * (root - 1.0)
        slope = np.where(percent > 0.5, nut * root / (3.0 * load), 0.0)
        variance = (slope * self.sigma) ** 2 + (root - 1.0) ** 2 * self.cov[:, NUT, NUT]
        value, half = self.spread(
            compliance, np.sqrt(variance + (table.tolerance * compliance) ** 2)
        )
        return 1.0 / value, 1.0 / (value + half), 1.0 / max(value - half, 0.1 * value)

    def above(self, slope: dict[int, float], limit: float) -> float:
        return float(self.weight @ norm.sf(limit, *self.along(slope)))

    def coulomb(self, screw: float) -> tuple[Floats, Floats]:
        """k (screw + f) p + B + R G, to first order in p and f."""
        rows = [PRELOAD, LUBE, DRY, GUIDE]
        p, f, dry, guide = self.mean[:, rows].T
        k_nm, ratio = self.model.drag_per_percent_nm, self.model.ratio_m_per_rad
        one = np.ones_like(p)
        slopes = np.stack([k_nm * (screw + f), k_nm * p, one, ratio * one], axis=1)
        cov = self.cov[:, rows][:, :, rows]
        variance = np.einsum("ki,kij,kj->k", slopes, cov, slopes)
        return k_nm * (screw + f) * p + dry + ratio * guide, np.sqrt(variance)

    def faults(self) -> list[float]:
        taught, ratio, size = self.machine.commissioned, self.model.ratio_m_per_rad, RUB_NODES
        assert taught is not None
        rest_nm = self.start.mean[DRY] + ratio * self.start.mean[GUIDE] + 0.2 * taught.coulomb_nm
        told = [
            self.below(0.9 * self.model.fresh_percent),
            float(self.weight @ norm.sf(rest_nm, *self.coulomb(0.0))),
            self.above({GAIN: 1.0}, GAIN_SHARE) + self.above({GAIN: -1.0}, GAIN_SHARE),
            float(self.weight @ self.force),
        ]
        if taught.transmission is None:
            return told
        places = range(self.mean.shape[1] - size, self.mean.shape[1])
        even = dict.fromkeys(places, -1.0 / size)
        mass_kg, rub_n = 0.1 * self.model.table_mass_kg, 0.1 * taught.coulomb_nm / ratio
        return [
            *told,
            self.above({MASS: 1.0}, mass_kg) + self.above({MASS: -1.0}, mass_kg),
            self.above({PLAY: 1.0}, PLAY_M),
            max(self.above(even | {i: 1.0 - 1.0 / size}, rub_n) for i in places),
        ]

    def numbers(self) -> Floats:
        value, half = self.spread(*self.coulomb(1.0))
        edges = [0.5 * (a + b) for a, b in pairwise(LEVELS_PERCENT)]
        levels = -np.diff([1.0, *(self.below(edge) for edge in edges), 0.0])
        two = self.machine.commissioned is not None and self.machine.commissioned.transmission
        stiffness = self.stiffness() if two else ()
        drag = (value, value - half, value + half)
        faults = np.clip(self.faults(), 0.0, 1.0)
        return np.array([*self.preload(), *drag, *stiffness, *levels, *faults])


@pytest.mark.parametrize("one_encoder", [False, True])
@pytest.mark.parametrize("seed", range(12))
def test_the_numbers_are_those_of_another_reading(seed: int, one_encoder: bool) -> None:
    mixture = drawn(seed, one_encoder)
    expected = Another(mixture, one_encoder).numbers()
    np.testing.assert_allclose(flat(read(mixture, one_encoder)), expected, rtol=1e-9, atol=1e-9)


def test_plain_python_gives_the_same_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    mixtures = [drawn(seed) for seed in range(4)]
    compiled = [flat(read(mixture)) for mixture in mixtures]
    for room in (mixture_interval, fused_answers):
        for name, value in inspect.getmembers(room):
            if hasattr(value, "py_func"):
                monkeypatch.setattr(room, name, value.py_func)
    assert inspect.isfunction(fused_answers.read)
    plain = [flat(read(mixture)) for mixture in mixtures]
    np.testing.assert_allclose(plain, compiled, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("apart", [0.0, 3.0, 9.0, 50.0])
@pytest.mark.parametrize("narrow", [1.0, 1e-3, 1e-6])
def test_an_interval_holds_its_probability_where_the_density_has_valleys(
    apart: float, narrow: float
) -> None:
    weight, sigma = np.array([0.6, 0.3, 0.1]), np.array([1.0, narrow, 0.5])
    mean = 20.0 + np.array([0.0, apart, -0.2 * apart])
    low, high = interval(weight, mean, sigma, 1.5)
    held = mixture_cdf(high, weight, mean, sigma) - mixture_cdf(low, weight, mean, sigma)
    assert held == pytest.approx(0.95, abs=1e-9)


def test_what_lies_below_zero_is_none() -> None:
    one = np.ones(1)
    assert interval(one, -50.0 * one, one, 1.5) == (0.0, 1.96)
    low, high = interval(one, -1.0 * one, one, 1.5)
    assert low == 0.0
    assert high == pytest.approx(norm.isf(0.05 * norm.sf(1.0)) - 1.0, abs=1e-9)
