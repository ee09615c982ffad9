"""Errors of one hypothesis against its own covariance, on data drawn from its own model.

With an honest covariance the normalised estimation error squared (NEES) of independent runs and
the normalised innovation squared (NIS) of all phases add up to chi-square variables
(Bar-Shalom, Li, Kirubarajan 2001, section 5.4). What is considered counts in both as it was drawn.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from edge_service.estimate.mixture import state
from edge_service.estimate.mixture.step import step
from edge_service.messages.samples import Floats

from .mixture_axis import idle, parts
from .mixture_filter import CONSIDERED, alone, expected, motion_of, never, noise_of

SIGNIFICANCE = 1e-3
"""Of both sides together; the seeds are fixed, so a pass stays a pass."""
PRELOAD_SIGMA = 0.02
"""So small that the cube root law is straight over it."""
RUNS, PHASES = 60, 150


def bounds(freedom: int) -> tuple[float, float]:
    """Bounds of a chi-square variable over its degrees of freedom."""
    low, high = chi2.ppf([0.5 * SIGNIFICANCE, 1.0 - 0.5 * SIGNIFICANCE], freedom) / freedom
    return float(low), float(high)


@dataclass(frozen=True)
class Errors:
    """Of independent runs: NEES of what is learned and of the preload, NIS per quantity."""

    nees: Floats
    preload_nees: Floats
    nis: Floats
    freedom: int


def normal(rng: np.random.Generator, covariance: Floats) -> Floats:
    """Drawn from a covariance that may be singular and badly scaled."""
    sigma = np.sqrt(np.diag(covariance))
    scale = np.where(sigma > 0.0, sigma, 1.0)
    value, vector = np.linalg.eigh(covariance / np.outer(scale, scale))
    root = vector * np.sqrt(np.maximum(value, 0.0))
    return np.asarray(scale * (root @ rng.standard_normal(len(sigma))))


@cache
def errors(one_encoder: bool) -> Errors:
    nees, preload_nees, nis = [], [], []
    model, start, process = parts(one_encoder)
    process, size = never(process), len(start.mean)
    left_out = {state.SPEED_ERROR_START, state.SPEED_ERROR_END, *CONSIDERED}
    kept = [i for i in range(size) if i not in left_out]
    for seed in range(RUNS):
        rng = np.random.default_rng((seed, one_encoder))
        bank = alone(start, PRELOAD_SIGMA)
        x = start.mean + normal(rng, bank.covariance[state.STEADY])
        for _ in range(PHASES):
            r, elapsed_s = idle(rng, one_encoder), float(rng.uniform(0.1, 1.0))
            f, q = motion_of(model, process, r, elapsed_s, x, None)
            x = f @ x + normal(rng, q)
            r = r._replace(stretch_m=np.nan if one_encoder else 0.0)
            values, _, _ = expected(model, x, r)
            noise = noise_of(model, process, x, r, len(values))
            values = values + normal(rng, noise)
            r = r._replace(torque_nm=values[0], stretch_m=values[-1] if len(values) > 1 else np.nan)
            nis.append(step(bank, model, process, r, elapsed_s))
        error, covariance = x - bank.mean[state.STEADY], bank.covariance[state.STEADY]
        sigma = np.sqrt(np.diag(covariance)[kept])
        unit = covariance[np.ix_(kept, kept)] / np.outer(sigma, sigma)
        nees.append((error[kept] / sigma) @ np.linalg.solve(unit, error[kept] / sigma))
        preload_nees.append(error[state.PRELOAD] ** 2 / covariance[state.PRELOAD, state.PRELOAD])
    return Errors(np.array(nees), np.array(preload_nees), np.array(nis), len(kept))


@pytest.mark.slow
@pytest.mark.parametrize("one_encoder", [False, True])
def test_errors_of_the_state_are_as_large_as_it_says(one_encoder: bool) -> None:
    of = errors(one_encoder)
    low, high = bounds(RUNS * of.freedom)
    assert low < of.nees.mean() / of.freedom < high
    low, high = bounds(RUNS)
    assert low < of.preload_nees.mean() < high


@pytest.mark.parametrize("one_encoder", [False, True])
def test_innovations_are_as_large_as_it_says(one_encoder: bool) -> None:
    of = errors(one_encoder)
    assert np.isfinite(of.nis).all()
    low, high = bounds(len(of.nis) * (1 if one_encoder else 2))
    assert low < of.nis.mean() < high
