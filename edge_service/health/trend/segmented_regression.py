"""Segmented regression of the preload with autocorrelated errors, and its extrapolation.

Preload falls "in a somewhat linear fashion", steeper while the screw runs in (the thesis, 4.3).
So the model is a line that may bend once,

    p(s) = a + b min(s, k) + c max(s - k, 0) + e,

against s = time or distance worked, whichever explains the history better, with errors that
depend on each other from point to point (first-order autoregressive, unknown correlation). Bend
and correlation are laid over a grid and weighted by their evidence (Bayesian linear regression
with the reference prior); the band comes from draws of all of it.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...messages.samples import Floats

_CORRELATIONS = (0.0, 0.3, 0.55, 0.75, 0.87, 0.94, 0.975)
_BENDS = 14
_DRAWS = 4000
_FEWEST_POINTS = 24
_RATE_WANDER = 0.08
"""Future wear against that of the past, one sigma: use and lubrication vary (convention)."""
_STILL_RUNNING_IN = 0.25
"""Prior probability that a line without a bend yet will still bend."""
_Draws = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TrendDraws:
    """Equally likely lines through the history.

    Attributes:
        level_percent: preload now, (n,).
        slope: change per unit of s, (n,).
        evidence: log evidence of the model, to compare with another s.
    """

    level_percent: _Draws
    slope: _Draws
    evidence: float

    def falling_probability(self) -> float:
        """Probability that the preload falls."""
        return float(np.mean(self.slope < 0.0))

    def rising_probability(self) -> float:
        """Probability that the preload rises."""
        return float(np.mean(self.slope > 0.0))

    def way_to(self, limit_percent: float) -> _Draws:
        """Additional s that each line needs to reach the limit, (n,); inf if it never does."""
        gap = self.level_percent - limit_percent
        with np.errstate(divide="ignore", invalid="ignore"):
            way = np.where(self.slope < 0.0, -gap / self.slope, np.inf)
        return np.where(gap <= 0.0, 0.0, way)


def draw_trends(
    s: Floats,
    percent: Floats,
    sigma_level: float,
    rng: np.random.Generator,
    memory: float = 0.0,
) -> TrendDraws | None:
    """Draw lines through a history; None if it is too short to tell.

    Args:
        s: Time or distance, rising; only its differences matter, (n,).
        percent: Preload, percent of the dynamic load rating, (n,).
        sigma_level: Standard deviation of an error common to neighbouring points, percent.
        rng: Source of the draws; seed it, so that the same history gives the same answer.
        memory: After so much s that error is another one, as with a filter that forgets.
    """
    if s.size < _FEWEST_POINTS or s[-1] <= s[0]:
        return None
    age = (s - s[0]) / (s[-1] - s[0])
    bends = np.append(np.linspace(0.04, 0.9, _BENDS), 1.0)
    fits = [_fit(age, percent, bend, rho) for bend in bends for rho in _CORRELATIONS]
    logs = np.array([fit.evidence for fit in fits])
    # a bend is one more thing to choose: half the prior for all of them together
    logs += np.where(np.repeat(bends, len(_CORRELATIONS)) < 1.0, -np.log(_BENDS), 0.0)
    weights = np.exp(logs - logs.max())
    counts = rng.multinomial(_DRAWS, weights / weights.sum())
    parts = [fit.draw(int(count), rng) for fit, count in zip(fits, counts, strict=True) if count]
    level, slope = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    level = level + sigma_level * rng.standard_normal(level.size)
    slope = slope * np.exp(_RATE_WANDER * rng.standard_normal(slope.size))
    wander = sigma_level * _slope_of_wander(memory / (s[-1] - s[0]))
    slope = (slope + wander * rng.standard_normal(slope.size)) / (s[-1] - s[0])
    evidence = float(logs.max() + np.log(weights.sum()))
    return TrendDraws(level, slope, evidence)


def _slope_of_wander(memory: float) -> float:
    """Standard deviation of a line's slope over the age 0 to 1 through an error of unit variance.

    The error forgets itself after `memory` of that age: 1 / (2 memory) values are independent,
    and a line through n of them has the slope variance 12 / n. No slope can be worse than that
    through two independent ends.
    """
    return math.sqrt(min(24.0 * memory, 2.0))


@dataclass(frozen=True, slots=True)
class _Fit:
    """One line: bend and correlation given. `mean` and `root` are of [level now, last slope]."""

    bend: float
    mean: Floats
    root: Floats
    freedom: int
    evidence: float

    def draw(self, count: int, rng: np.random.Generator) -> tuple[_Draws, _Draws]:
        """Levels and slopes, (count,) each."""
        scale = np.sqrt(self.freedom / rng.chisquare(self.freedom, count))
        normal = rng.standard_normal((count, self.mean.size)) * scale[:, None]
        line = self.mean + normal @ self.root.T
        level, slope = line[:, 0], line[:, 1]
        if line.shape[1] == 3:
            return level, slope
        bends = rng.random(count) < _STILL_RUNNING_IN
        return level, slope * np.where(bends, rng.uniform(0.3, 1.0, count), 1.0)


def _fit(age: Floats, percent: Floats, bend: float, rho: float) -> _Fit:
    """Least squares of the whitened history on [level at age 1, last slope, first slope]."""
    after = np.minimum(1.0 - age, 1.0 - bend)
    columns = [np.ones_like(age), -after, -np.maximum(bend - age, 0.0)]
    if bend >= 1.0:
        columns = [np.ones_like(age), age - 1.0]
    design = _whitened(np.column_stack(columns), rho)
    target = _whitened(percent[:, None], rho)[:, 0]
    q, r = np.linalg.qr(design)
    projected = q.T @ target
    freedom = target.size - r.shape[0]
    rest = max(float(target @ target - projected @ projected), 1e-12 * target.size)
    inverse = np.linalg.inv(r)
    variance = rest / freedom
    log_det = 2.0 * float(np.sum(np.log(np.abs(np.diag(r)))))
    width = max(float(np.ptp(percent)), 1e-9)
    evidence = (
        math.lgamma(freedom / 2.0)
        - 0.5 * freedom * math.log(math.pi * rest)
        - 0.5 * log_det
        + 0.5 * math.log(1.0 - rho**2)
        - r.shape[0] * math.log(width)  # prior: level and slopes of about the size of the change
    )
    return _Fit(bend, inverse @ projected, inverse * np.sqrt(variance), freedom, evidence)


def _whitened(columns: Floats, rho: float) -> Floats:
    first = columns[:1] * np.sqrt(1.0 - rho**2)
    return np.vstack([first, columns[1:] - rho * columns[:-1]])
