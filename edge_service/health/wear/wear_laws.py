"""Regression of the preload on laws of wear with correlated errors, and its extrapolation.

Wear runs steadily, or fast while the screw runs in, or slows down or speeds up (Archard's law with
a load that falls, or with debris in the lubricant). So the model is

    p(s) = a + b (g(s) - 1) + e + d,

against s = time or distance worked, as an age from 0 to 1. Each law is one shape g, rising from 0
to 1: a power of s, or a line that breaks once. The scatter e has an unknown size and memory. The
estimator's own error d is as large as its interval says, and errs anew after minutes, or weeks, or
with the season, or never. Shapes, sizes and memories are weighted by their evidence (Bayesian
linear regression with a flat prior); the band comes from draws of all of them. It is the next
points that reach a limit, so they scatter in it as those before did. Ahead, the rate itself
wanders, the more the further.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...messages.samples import Booleans, Floats

_MEMORIES = (0.0, 0.05, 0.2)
"""Memory of the scatter, share of the history: one that lasts longer cannot be told from wear."""
_SIZES = (0.7, 1.0, 1.5, 2.3, 4.0)
"""Sizes of the scatter, times that about the law that fits best."""
MEMORY_S = 600.0
"""Assumption: an estimator that erred errs anew after so long; a faster change may be its own."""
_WEEKS_S, _YEAR_S = 30.0 * 86400.0, 365.25 * 86400.0
_POWERS = (0.5, 0.65, 0.8, 1.25, 1.5, 2.0, 2.5)
_BREAKS = (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.85)
_RATES = (0.25, 0.5, 2.0, 4.0)
"""Rate of wear before the break against that after it: running in (the thesis' 4.3), or damage."""
_WAY_WEARS = math.log(4.0)
"""Log odds of wear by the way against wear by the hour, before anything is seen (convention)."""
_DRAWS = 4000
_FEWEST_POINTS = 5
_FEWEST_CLOSE_POINTS = 24
"""So many where an estimator that errs may err alike in all of them."""
_SEED = 20260131
_BLOCKS = 8
_SLOWEST_M_S = 1e-9
_RATE_WANDER = 0.08
"""Rate of wear now against that of the newest past, one sigma (convention)."""
_RATE_DRIFT = 0.3
"""Mean rate over a way as long as the history against that now, one sigma of its logarithm.

So the rate may be three fifths more or less, at 90 % (convention); over other ways it grows with
the root, as the mean of a random walk does.
"""
_SIGMA_OF_HALF_WIDTH = 1.0 / 1.96


@dataclass(frozen=True, slots=True)
class WearProjection:
    """Equally likely courses of wear through a history and beyond."""

    level_percent: Floats  # preload now, (n,)
    slope: Floats  # change per age of the history now, (n,)
    power: Floats  # of the age, with which each course goes on, (n,)
    # factor on the way to a limit as far away as the history is long, its logarithm, (n,)
    drift: Floats
    age_per_s: Floats  # ages of the history per second in future, (n,)
    basis: str  # `time` or `distance`, whichever explains more

    def seconds_to(self, limit_percent: float) -> Floats:
        """Time that each course needs to reach the limit, s, (n,); inf if it never does."""
        gap = self.level_percent - limit_percent
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            grown = np.maximum(1.0 - self.power * gap / self.slope, 0.0)
            way = np.maximum(grown ** (1.0 / self.power) - 1.0, 0.0)
            way = way * np.exp(self.drift * np.sqrt(way)) / self.age_per_s
        never = np.where(gap <= 0.0, 0.0, np.inf)
        return np.asarray(np.where((self.slope < 0.0) & (gap > 0.0), way, never))


@dataclass(frozen=True, slots=True)
class _Laws:
    shape: Floats  # g - 1 at each age, (n points, n laws)
    # slope, power: of each law at age 1, and with which it goes on, (n laws,)
    slope: Floats
    power: Floats
    by_way: Booleans  # whether the age is that by the way, else that by the hour, (n laws,)
    log_prior: Floats  # of each law, (n laws,); steady, power and break alike


def _laws(age: Floats, log_prior: float, *, by_way: bool) -> _Laws:
    powers = np.array([1.0, *_POWERS])
    ends, rates = (each.ravel() for each in np.meshgrid(_BREAKS, _RATES))
    late = 1.0 / (1.0 + ends * (rates - 1.0))
    broken = late * (age[:, None] + (rates - 1.0) * np.minimum(age[:, None], ends))
    counts = np.repeat([1.0, len(_POWERS), ends.size], [1, len(_POWERS), ends.size])
    return _Laws(
        np.hstack([age[:, None] ** powers, broken]) - 1.0,
        np.append(powers, late),
        np.append(powers, np.ones_like(late)),
        np.full(counts.size, by_way),
        log_prior - np.log(counts),
    )


def project_wear(
    time_s: Floats, percent: Floats, half_width_percent: Floats, distance_m: Floats
) -> WearProjection | None:
    """Draw courses through a history, the same ones each time; None if it is too short to tell.

    Args:
        time_s, percent, half_width_percent, distance_m: Times in s, preloads and half the widths of
            their 95 % intervals in percent of the dynamic load rating, and way in m, which may be
            NaN or not grow: then time alone counts, (n,).
    """
    span_s = float(time_s[-1] - time_s[0]) if time_s.size else 0.0
    fewest = _FEWEST_POINTS if span_s > MEMORY_S else _FEWEST_CLOSE_POINTS
    if time_s.size < fewest or span_s <= 0.0:
        return None
    rng = np.random.default_rng(_SEED)
    by_time = np.full(_DRAWS, 1.0 / span_s)
    laws, by_way = _laws((time_s - time_s[0]) / span_s, 0.0, by_way=False), by_time
    way_m = distance_m - distance_m[0]
    if np.all(np.diff(way_m) >= 0.0) and way_m[-1] > 0.0:
        other = _laws(way_m / way_m[-1], _WAY_WEARS, by_way=True)
        names = ("shape", "slope", "power", "by_way", "log_prior")
        laws = _Laws(*(np.concatenate([getattr(e, n) for e in (laws, other)], -1) for n in names))
        by_way = _future_speed(time_s, distance_m, rng) / way_m[-1]
    sigma = max(float(np.median(half_width_percent)), half_width_percent[-1]) * _SIGMA_OF_HALF_WIDTH
    fits = _fits(time_s, percent, laws.shape, sigma)
    error, law, level, fall = fits.draw(laws.log_prior, rng)
    seen = float(np.ptp(percent))  # with correlated errors a jump at the end would be more
    slope = np.clip(fall, -seen, seen) * laws.slope[law]
    own = sigma * _slope_of_wander(time_s) * np.maximum(laws.slope[law], 1.0)
    slope = slope + own * rng.standard_normal(_DRAWS)  # of a law's shape, an error is as steep
    below = fits.scatter[error] * np.abs(rng.standard_normal(_DRAWS))
    return WearProjection(
        level_percent=level + sigma * rng.standard_normal(_DRAWS) - below,
        slope=slope * np.exp(_RATE_WANDER * rng.standard_normal(_DRAWS)),
        power=laws.power[law],
        drift=_RATE_DRIFT * rng.standard_normal(_DRAWS),
        age_per_s=np.where(laws.by_way[law], by_way, by_time),
        basis="distance" if np.mean(laws.by_way[law]) > 0.5 else "time",
    )


def _slope_of_wander(time_s: Floats) -> float:
    """Standard deviation of a line's slope over the age 0 to 1 through an error of unit variance.

    The error forgets itself after `MEMORY_S`, so it is another one after twice that, and a line
    through n of them has the slope variance 12 / n. No slope can be worse than that through two
    independent ends.
    """
    return math.sqrt(min(12.0 / np.unique((time_s - time_s[0]) // (2.0 * MEMORY_S)).size, 2.0))


def _future_speed(time_s: Floats, distance_m: Floats, rng: np.random.Generator) -> Floats:
    """Distance per second in future, m/s: that of the newest quarter, and as changeable as ever."""
    index = np.unique(np.linspace(0, time_s.size - 1, _BLOCKS + 1).round().astype(int))
    speed = np.maximum(np.diff(distance_m[index]) / np.diff(time_s[index]), _SLOWEST_M_S)
    recent = float(speed[-max(speed.size // 4, 1) :].mean())
    change = np.diff(np.log(speed))
    spread = float(np.sqrt(np.mean(change**2))) if change.size else 0.0
    speeds_m_s: Floats = recent * np.exp(spread * rng.standard_normal(_DRAWS))
    return speeds_m_s


@dataclass(frozen=True, slots=True)
class _Fits:
    """Every law with every kind of error: [level now, loss so far] and the log evidence."""

    # mean, root: of the two; their covariance is root root^T, (n errors, n laws, 2[, 2])
    mean: Floats
    root: Floats
    scatter: Floats  # standard deviation of a point about its course, (n errors,)
    evidence: Floats  # (n errors, n laws)

    def draw(self, log_prior: Floats, rng: np.random.Generator) -> tuple[Any, Any, Floats, Floats]:
        """Numbers of errors and laws, as often as they are likely, levels and losses, (n,) each."""
        log_weights = self.evidence + log_prior
        weights = np.exp(log_weights - log_weights.max()).ravel()
        cells = np.repeat(np.arange(weights.size), rng.multinomial(_DRAWS, weights / weights.sum()))
        error, law = np.divmod(rng.permutation(cells), log_prior.size)
        spread = np.einsum("nij,nj->ni", self.root[error, law], rng.standard_normal((_DRAWS, 2)))
        return error, law, *(self.mean[error, law] + spread).T


def _fits(time_s: Floats, percent: Floats, shape: Floats, sigma: float) -> _Fits:
    target, centred = percent - percent.mean(), shape - shape.mean(axis=0)
    explained = (centred.T @ target) ** 2 / np.sum(centred**2, axis=0)
    rest = max(float(target @ target - explained.max()), 0.0)
    floor = 1e-6 * max(float(np.ptp(percent)), sigma, 1e-9)
    scatter = math.sqrt(rest / (target.size - 3)) + floor
    gap = np.abs(time_s[:, None] - time_s) / (time_s[-1] - time_s[0])
    found = [
        (size * scatter, *_fit(shape, percent, (size * scatter) ** 2 * correlation + own))
        for correlation in (np.exp(-gap / each) if each else np.eye(len(gap)) for each in _MEMORIES)
        for own in _own_errors(time_s, sigma)
        for size in _SIZES
    ]
    sizes, mean, root, evidence = (np.array(each) for each in zip(*found, strict=True))
    return _Fits(mean, root, sizes, evidence)


def _own_errors(time_s: Floats, sigma: float) -> list[Floats]:
    """Covariances of the estimator's own errors, (n, n) each; one that never changes is in none."""
    gap_s = np.abs(time_s[:, None] - time_s)
    none = np.zeros_like(gap_s)
    if sigma == 0.0:
        return [none]
    weeks, season = np.exp(-gap_s / _WEEKS_S), np.cos(2.0 * np.pi * gap_s / _YEAR_S)
    return [none, sigma**2 * weeks, sigma**2 * (0.5 * weeks + season)]


def _fit(shape: Floats, percent: Floats, covariance: Floats) -> tuple[Floats, Floats, Floats]:
    """Generalised least squares of the history on [1, shape]: mean, root and log evidence."""
    jitter = 1e-9 * float(np.mean(np.diagonal(covariance))) * np.eye(percent.size)
    lower = np.linalg.cholesky(covariance + jitter)
    columns = np.column_stack([np.ones_like(percent), percent, shape])
    white = np.linalg.solve(lower, columns)  # SciPy has a faster one, and takes 30 MB
    one, target, laws = white[:, 0], white[:, 1], white[:, 2:]
    aa, ab, bb = one @ one, one @ laws, np.sum(laws**2, axis=0)
    at, bt = one @ target, target @ laws
    determinant = aa * bb - ab**2
    level, loss = (bb * at - ab * bt) / determinant, (aa * bt - ab * at) / determinant
    rest = target @ target - level * at - loss * bt
    half_log = np.sum(np.log(np.diagonal(lower))) + 0.5 * np.log(determinant)
    root = np.zeros((loss.size, 2, 2))
    root[:, 0, 0] = np.sqrt(bb / determinant)
    root[:, 1, 0] = -ab / determinant / root[:, 0, 0]
    root[:, 1, 1] = 1.0 / np.sqrt(bb)
    return np.stack([level, loss], axis=1), root, -half_log - 0.5 * rest
