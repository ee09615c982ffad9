"""Regression of the preload on laws of wear with autocorrelated errors, and its extrapolation.

Wear runs steadily, or fast while the screw runs in, or slows down or speeds up (Archard's law with
a load that falls, or with debris in the lubricant). So the model is

    p(s) = a + b (g(s) - 1) + e,

against s = time or distance worked from 0 to 1, with errors that depend on each other from point to
point (first-order autoregressive, unknown correlation: lubrication and temperature drift). Each law
is one shape g, rising from 0 to 1: a power of s, or a line that was steeper at first. Laws and
correlations are weighted by their evidence (Bayesian linear regression with the reference prior);
the band comes from draws of all of them. It is the next points that reach a limit, so they scatter
in it as those before did. Ahead, the rate itself wanders, the more the further.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...messages.samples import Floats

_MEMORIES = (0.0, 0.01, 0.03, 0.1, 0.3)
"""Memory of the errors, share of the history: one that drifts longer cannot be told from wear."""
_POWERS = (0.5, 0.65, 0.8, 1.25, 1.5, 2.0, 2.5)
_RUN_IN_ENDS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5)
_RUN_IN_RATES = (2.0, 4.0)
"""Rate of wear while running in, against that afterwards: the thesis' (4.3) lie between."""
_DRAWS = 4000
_FEWEST_POINTS = 6
_FEWEST_CLOSE_POINTS = 24
"""So many where an estimator that errs may err alike in all of them."""
_RATE_WANDER = 0.08
"""Rate of wear now against that of the newest past, one sigma (convention)."""
_RATE_DRIFT = 0.3
"""Mean rate over a way as long as the history against that now, one sigma of its logarithm.

So the rate may be three fifths more or less, at 90 % (convention); over other ways it grows with
the root, as the mean of a random walk does.
"""
_Draws = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TrendDraws:
    """Equally likely courses of wear through the history and beyond.

    Attributes:
        level_percent: preload now, (n,).
        slope: change per unit of s now, (n,).
        power: of s, with which each course goes on, (n,).
        drift: factor on the way to a limit as far away as the history is long, its logarithm, (n,).
        span: length of the history in s.
        evidence: log evidence of the model, to compare with another s.
    """

    level_percent: _Draws
    slope: _Draws
    power: _Draws
    drift: _Draws
    span: float
    evidence: float

    def way_to(self, limit_percent: float) -> _Draws:
        """Additional s that each course needs to reach the limit, (n,); inf if it never does."""
        gap = self.level_percent - limit_percent
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            grown = np.maximum(1.0 - self.power * gap / (self.slope * self.span), 0.0)
            way = np.maximum(grown ** (1.0 / self.power) - 1.0, 0.0)
            way = way * np.exp(self.drift * np.sqrt(way))
            never = np.where(gap <= 0.0, 0.0, np.inf)
            return np.asarray(self.span * np.where(self.slope < 0.0, way, never))


@dataclass(frozen=True, slots=True)
class _Laws:
    """Shapes of wear over the age of a history.

    Attributes:
        shape: g - 1 at each age, (n points, n laws).
        slope, power: of each law at age 1, and with which it goes on, (n laws,).
        log_prior: of each law, (n laws,); steady, power and running in alike.
    """

    shape: Floats
    slope: Floats
    power: Floats
    log_prior: Floats


def _laws(age: Floats) -> _Laws:
    powers = np.array([1.0, *_POWERS])
    ends, rates = (each.ravel() for each in np.meshgrid(_RUN_IN_ENDS, _RUN_IN_RATES))
    late = 1.0 / (1.0 + ends * (rates - 1.0))
    run_in = late * (age[:, None] + (rates - 1.0) * np.minimum(age[:, None], ends))
    counts = np.repeat([1.0, len(_POWERS), ends.size], [1, len(_POWERS), ends.size])
    return _Laws(
        np.hstack([age[:, None] ** powers, run_in]) - 1.0,
        np.append(powers, late),
        np.append(powers, np.ones_like(late)),
        -np.log(counts),
    )


def draw_trends(
    s: Floats,
    percent: Floats,
    sigma_level: float,
    rng: np.random.Generator,
    memory: float = 0.0,
) -> TrendDraws | None:
    """Draw courses through a history; None if it is too short to tell.

    Args:
        s: Time or distance, rising; only its differences matter, (n,).
        percent: Preload, percent of the dynamic load rating, (n,).
        sigma_level: Standard deviation of an error common to neighbouring points, percent.
        rng: Source of the draws; seed it, so that the same history gives the same answer.
        memory: After so much s that error is another one, as with a filter that forgets.
    """
    span = float(s[-1] - s[0]) if s.size else 0.0
    if s.size < (_FEWEST_POINTS if span > memory else _FEWEST_CLOSE_POINTS) or span <= 0.0:
        return None
    laws = _laws((s - s[0]) / span)
    fits, evidence = _fits(laws, percent)
    weights = np.exp(fits.evidence - evidence)
    which = np.repeat(np.arange(weights.size), rng.multinomial(_DRAWS, weights / weights.sum()))
    level, fall = fits.draw(which, s.size - 2, rng)
    seen = float(np.ptp(percent))  # with correlated errors a jump at the end would be more
    fall = np.clip(fall, -seen, seen)
    level = level + np.hypot(sigma_level, fits.scatter[which]) * rng.standard_normal(_DRAWS)
    law = which % laws.power.size
    slope = fall * laws.slope[law] * np.exp(_RATE_WANDER * rng.standard_normal(_DRAWS))
    erring = sigma_level * _slope_of_wander(memory / span) * np.maximum(laws.slope[law], 1.0)
    slope = slope + erring * rng.standard_normal(_DRAWS)  # of a law's shape, an error is as steep
    drift = _RATE_DRIFT * rng.standard_normal(_DRAWS)
    return TrendDraws(level, slope / span, laws.power[law], drift, span, evidence)


def _slope_of_wander(memory: float) -> float:
    """Standard deviation of a line's slope over the age 0 to 1 through an error of unit variance.

    The error forgets itself after `memory` of that age: 1 / (2 memory) values are independent,
    and a line through n of them has the slope variance 12 / n. No slope can be worse than that
    through two independent ends.
    """
    return math.sqrt(min(24.0 * memory, 2.0))


@dataclass(frozen=True, slots=True)
class _Fits:
    """Laws with correlations: [level now, loss so far] and the log evidence.

    Attributes:
        mean: of the two, (n, 2).
        root: their covariance is root root^T, (n, 2, 2).
        scatter: standard deviation of a point about its course, (n,).
        evidence: with the prior of the law, (n,).
    """

    mean: Floats
    root: Floats
    scatter: Floats
    evidence: Floats

    def draw(self, which: npt.NDArray[np.intp], freedom: int, rng: np.random.Generator) -> Floats:
        """Levels and losses of the fits of these numbers, (2, n)."""
        normal = rng.standard_normal((which.size, 2))
        student = normal * np.sqrt(freedom / rng.chisquare(freedom, which.size))[:, None]
        drawn: Floats = self.mean[which] + np.einsum("nij,nj->ni", self.root[which], student)
        return drawn.T


def _fits(laws: _Laws, percent: Floats) -> tuple[_Fits, float]:
    """Every law with every correlation, laws first, and the log evidence of all of them."""
    between = 1.0 / (percent.size - 1)
    correlations = (math.exp(-between / each) if each else 0.0 for each in _MEMORIES)
    fits = [_fit(laws, percent, correlation) for correlation in correlations]
    names = ("mean", "root", "scatter", "evidence")
    joined = _Fits(*(np.concatenate([getattr(fit, name) for fit in fits]) for name in names))
    return joined, float(np.logaddexp.reduce(joined.evidence))


def _fit(laws: _Laws, percent: Floats, rho: float) -> _Fits:
    """Least squares of the whitened history on [1, shape], for every law."""
    shape, target = _whitened(laws.shape, rho), _whitened(percent, rho)
    ones = np.broadcast_to(_whitened(np.ones_like(percent), rho)[:, None], shape.shape)
    q, r = np.linalg.qr(np.stack([ones, shape], axis=-1).transpose(1, 0, 2))
    projected = np.einsum("lnk,n->lk", q, target)
    freedom = target.size - 2
    rest = np.maximum(target @ target - np.sum(projected**2, axis=1), 1e-12 * target.size)
    inverse = np.linalg.inv(r)
    width = max(float(np.ptp(percent)), 1e-9)
    evidence = (
        math.lgamma(freedom / 2.0)
        - 0.5 * freedom * np.log(math.pi * rest)
        - np.sum(np.log(np.abs(np.diagonal(r, axis1=1, axis2=2))), axis=1)
        + 0.5 * math.log(1.0 - rho**2)
        - 2.0 * math.log(width)  # prior: level and loss of about the size of the change
        + laws.log_prior
    )
    sigma = np.sqrt(rest / freedom)
    return _Fits(
        mean=np.einsum("lij,lj->li", inverse, projected),
        root=inverse * sigma[:, None, None],
        scatter=sigma / math.sqrt(1.0 - rho**2),
        evidence=evidence,
    )


def _whitened(columns: Floats, rho: float) -> Floats:
    first = columns[:1] * np.sqrt(1.0 - rho**2)
    return np.concatenate([first, columns[1:] - rho * columns[:-1]])
