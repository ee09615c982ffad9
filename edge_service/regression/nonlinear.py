"""Nonlinear least squares with several starts, and intervals by profile likelihood."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy import optimize

from ..messages.samples import Floats
from .interval_estimate import IntervalEstimate, student_quantile

_MOST_SEARCHED = 60
"""Evaluations from one start; one that has not found its valley by then is in none that counts."""
_FIRST_STEP = 2.0**-8
"""Of a bracket, in coordinates, where the curvature at the optimum says nothing."""
_LEAST_STEP = 1e-9
"""Of a bracket: below it the numbers themselves are as coarse, and a search would never end."""
_BOUND_SHARE = 2e-3
"""Accuracy of a bound over its distance from the value."""


@dataclass(frozen=True, slots=True)
class Unknown:
    """One parameter of a nonlinear model."""

    name: str
    # low, high: hard bounds, finite
    low: float
    high: float
    unit: str  # of the parameter
    # searched in its logarithm, for scales of speed or stiffness; low is then greater than 0. A
    # bound that the data does not rule out stands for 0 or infinity
    logarithmic: bool = False
    # what the lower bound stands for, where it is not logarithmic and means "none"
    floor: float = -math.inf


@dataclass(frozen=True, slots=True, eq=False)
class NonlinearFit:
    """The best fit of all starts."""

    values: Floats  # (p,), in the units of the unknowns
    parameters: dict[str, IntervalEstimate]  # by name, with their intervals
    residual: Floats  # weighted, (n,)


Residual = Callable[[Floats], Floats]
"""Values of the unknowns (p,) -> residual in standard deviations (n,)."""


def fit_profiled(
    residual: Residual,
    unknowns: Sequence[Unknown],
    starts: Sequence[Floats],
    n_effective: float | None = None,
) -> NonlinearFit:
    """Bounded least squares from several starts; intervals by profile likelihood.

    A bound of an interval is where the sum of squares, minimised over all other unknowns, exceeds
    the least one by the square of Student's quantile (Bates and Watts, 1988). If it never does
    within the hard bounds, the data sets no bound. A residual larger than its standard deviations
    widens the intervals; one that is smaller does not narrow them.

    Args:
        residual: in standard deviations.
        starts: values (p,) each; at least one.
        n_effective: independent residuals; all of them if not given.

    Raises ValueError: fewer residuals than unknowns.
    """
    search, optima = _minima(residual, unknowns, starts)
    count = len(residual(starts[0]))
    independent = count if n_effective is None else n_effective
    best = min(optima, key=lambda optimum: optimum.cost)
    chi2 = 2.0 * float(best.cost)
    reduced = chi2 / (count - len(unknowns))
    share = independent / count
    limit = student_quantile(max(independent - len(unknowns), 1.0)) ** 2 * max(reduced, 1.0) / share
    valleys = [best.x]
    for each in optima:
        apart = all(np.max(np.abs(each.x - valley)) > 1e-2 for valley in valleys)
        if apart and each.cost < best.cost + limit:
            valleys.append(each.x)
    curvature = np.asarray(best.jac).T @ np.asarray(best.jac)
    spread = np.linalg.pinv(curvature, rcond=1e-12)
    profile = _Profile(search, best.x, valleys[1:], chi2, limit, independent, spread)
    values = search.outward(best.x)
    parameters = {unknown.name: profile.interval_estimate(k) for k, unknown in enumerate(unknowns)}
    return NonlinearFit(values, parameters, residual(values))


def best_values(
    residual: Residual, unknowns: Sequence[Unknown], starts: Sequence[Floats]
) -> Floats:
    """Values with the least sum of squares, (p,), without intervals, as `fit_profiled`."""
    search, optima = _minima(residual, unknowns, starts)
    return search.outward(min(optima, key=lambda optimum: float(optimum.cost)).x)


def _minima(
    residual: Residual, unknowns: Sequence[Unknown], starts: Sequence[Floats]
) -> tuple["_Search", list[optimize.OptimizeResult]]:
    count = len(residual(starts[0]))
    if count <= len(unknowns):
        raise ValueError(f"{count} points cannot determine {len(unknowns)} parameters; record more")
    search = _Search(residual, unknowns)
    return search, [search.minimise(search.inward(each), most=_MOST_SEARCHED) for each in starts]


def unexplained_share(misfit: Floats, error: Floats, size: Floats, parameters: int) -> float:
    """Scatter of points beyond their errors, as a share of their size; 0 where there is none.

    The s with sum(misfit^2 / (error^2 + (s size)^2)) = n - p (Paule and Mandel, 1982): what a model
    leaves out adds to every point, so that the surest points do not decide alone.

    Args:
        misfit, error, size: (n,) each, in one unit.
        parameters: p of the model.
    """
    freedom = len(misfit) - parameters

    def excess(share: float) -> float:
        return float(np.sum(misfit**2 / (error**2 + (share * size) ** 2))) - freedom

    if freedom <= 0 or excess(0.0) <= 0.0:
        return 0.0
    greatest = 2.0 * float(np.sqrt(np.sum((misfit / np.maximum(size, 1e-300)) ** 2) / freedom))
    return float(optimize.brentq(excess, 0.0, greatest)) if excess(greatest) < 0.0 else greatest


class _Search:
    """Minimisation in coordinates that run from 0 to 1 between the hard bounds."""

    def __init__(self, residual: Residual, unknowns: Sequence[Unknown]) -> None:
        self.unknowns = unknowns
        self._residual = residual
        self._log = np.array([unknown.logarithmic for unknown in unknowns])
        low = np.array([unknown.low for unknown in unknowns])
        high = np.array([unknown.high for unknown in unknowns])
        self._low = np.where(self._log, np.log(np.where(self._log, low, 1.0)), low)
        self._span = np.where(self._log, np.log(np.where(self._log, high, math.e)), high)
        self._span -= self._low

    def inward(self, values: Floats) -> Floats:
        """Values -> coordinates, clipped to the bounds."""
        logged = np.where(self._log, np.log(np.where(self._log, values, 1.0)), values)
        return np.clip((logged - self._low) / self._span, 0.0, 1.0)

    def outward(self, coordinates: Floats) -> Floats:
        plain = self._low + self._span * coordinates
        return np.where(self._log, np.exp(np.where(self._log, plain, 0.0)), plain)

    def minimise(
        self, start: Floats, fixed: int | None = None, at: float = 0.0, most: int | None = None
    ) -> optimize.OptimizeResult:
        """Least squares over all coordinates, or over all but one that is held."""
        free = np.array([k for k in range(len(self.unknowns)) if k != fixed], dtype=np.int64)

        def residual(part: Floats) -> Floats:
            whole = np.full(len(self.unknowns), at)
            whole[free] = part
            return self._residual(self.outward(whole))

        inside = np.clip(start[free], 1e-6, 1.0 - 1e-6)
        return optimize.least_squares(
            residual, inside, bounds=(0.0, 1.0), x_scale="jac", max_nfev=most
        )


@dataclass(frozen=True, slots=True)
class _Profile:
    """The sum of squares around the optimum; `spread` is its inverse curvature, (p, p)."""

    search: _Search
    best: Floats
    elsewhere: Sequence[Floats]
    chi2: float
    limit: float
    n_effective: float
    spread: Floats

    def interval_estimate(self, index: int) -> IntervalEstimate:
        unknown = self.search.unknowns[index]
        low, high = self._bound(index, -1.0), self._bound(index, 1.0)
        value = float(self.search.outward(self.best)[index])
        bottom = 0.0 if unknown.logarithmic else unknown.floor
        note = ""
        if low is None and high is None:
            value, note = math.nan, "any value fits the data"
        elif low is None or high is None:
            note = "bounded on one side only"
        return IntervalEstimate(
            value,
            bottom if low is None else low,
            math.inf if high is None else high,
            unknown.unit,
            self.n_effective,
            note,
        )

    def _bound(self, index: int, direction: float) -> float | None:
        """Point at which the profile leaves the limit on one side; None if it never does."""
        start, end = float(self.best[index]), 1.0 if direction > 0.0 else 0.0
        root, own = math.sqrt(self.limit), float(self.spread[index, index])

        @cache
        def beyond(at: float) -> float:
            """Excess of the root of the rise: nearly linear in the distance, 0 at the bound."""
            near = self.best
            if own > 0.0:
                moved = near + self.spread[:, index] / own * (at - near[index])
                near = np.clip(moved, 0.0, 1.0)
            least = math.inf
            for valley in (near, *self.elsewhere):
                rise = 2.0 * float(self.search.minimise(valley, index, at).cost) - self.chi2
                least = min(least, rise)
                if least <= self.limit:
                    break
            return math.sqrt(max(least, 0.0)) - root

        inside = start
        guess = math.sqrt(max(self.limit * own, 0.0))
        step = min(guess, 1.0) if guess > _LEAST_STEP else _FIRST_STEP
        while inside != end:
            trial = min(max(start + direction * step, 0.0), 1.0)
            if beyond(trial) > 0.0:
                whole = self.best.copy()
                whole[index] = optimize.brentq(beyond, inside, trial, xtol=_BOUND_SHARE * step)
                return float(self.search.outward(whole)[index])
            inside, step = trial, 2.0 * step
        return None
