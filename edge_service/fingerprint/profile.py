"""Nonlinear least squares with several starts, and intervals by profile likelihood."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from ..messages.samples import Floats
from .identified import Identified, student_quantile

_BISECTIONS = 8
_DOUBLINGS = 8


@dataclass(frozen=True, slots=True)
class Unknown:
    """One parameter of a nonlinear model.

    Attributes:
        low, high: hard bounds, finite.
        unit: of the parameter.
        logarithmic: searched in its logarithm, for scales of speed or stiffness; low is then
            greater than 0. A bound that the data does not rule out stands for 0 or infinity.
        floor: what the lower bound stands for, where it is not logarithmic and means "none".
    """

    name: str
    low: float
    high: float
    unit: str
    logarithmic: bool = False
    floor: float = -math.inf


@dataclass(frozen=True, slots=True, eq=False)
class NonlinearFit:
    """The best fit of all starts.

    Attributes:
        values: (p,), in the units of the unknowns.
        parameters: by name, with their intervals.
        residual: weighted, (n,).
        reduced_chi2: mean square of the weighted residual per degree of freedom.
    """

    values: Floats
    parameters: dict[str, Identified]
    residual: Floats
    reduced_chi2: float


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
        unknowns: p of them.
        starts: values (p,) each; at least one.
        n_effective: independent residuals; all of them if not given.

    Raises:
        ValueError: fewer residuals than unknowns.
    """
    search = _Search(residual, unknowns)
    count = len(residual(starts[0]))
    independent = count if n_effective is None else n_effective
    if count <= len(unknowns):
        raise ValueError(f"{count} points cannot determine {len(unknowns)} parameters; record more")
    optima = [search.minimise(search.inward(start)) for start in starts]
    best = min(optima, key=lambda optimum: optimum.cost)
    chi2 = 2.0 * float(best.cost)
    reduced = chi2 / (count - len(unknowns))
    share = independent / count
    limit = student_quantile(max(independent - len(unknowns), 1.0)) ** 2 * max(reduced, 1.0) / share
    elsewhere = _other_valleys(best.x, [each.x for each in optima if each.cost < best.cost + limit])
    profile = _Profile(search, best.x, elsewhere, chi2, limit, independent)
    values = search.outward(best.x)
    parameters = {unknown.name: profile.identified(k) for k, unknown in enumerate(unknowns)}
    return NonlinearFit(values, parameters, residual(values), reduced)


def _other_valleys(best: Floats, optima: Sequence[Floats]) -> list[Floats]:
    """Optima that differ from the best and from each other, in coordinates (p,)."""
    valleys = [best]
    for optimum in optima:
        if all(np.max(np.abs(optimum - valley)) > 1e-2 for valley in valleys):
            valleys.append(optimum)
    return valleys[1:]


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
        """Coordinates -> values."""
        plain = self._low + self._span * coordinates
        return np.where(self._log, np.exp(np.where(self._log, plain, 0.0)), plain)

    def minimise(
        self, start: Floats, fixed: int | None = None, at: float = 0.0
    ) -> optimize.OptimizeResult:
        """Least squares over all coordinates, or over all but one that is held."""
        free = np.array([k for k in range(len(self.unknowns)) if k != fixed], dtype=np.int64)

        def residual(part: Floats) -> Floats:
            whole = np.full(len(self.unknowns), at)
            whole[free] = part
            return self._residual(self.outward(whole))

        inside = np.clip(start[free], 1e-6, 1.0 - 1e-6)
        return optimize.least_squares(residual, inside, bounds=(0.0, 1.0), x_scale="jac")


@dataclass(frozen=True, slots=True)
class _Profile:
    search: _Search
    best: Floats
    elsewhere: Sequence[Floats]
    chi2: float
    limit: float
    n_effective: float

    def identified(self, index: int) -> Identified:
        """The unknown with the interval of its profile."""
        unknown = self.search.unknowns[index]
        low, high = self._bound(index, -1.0), self._bound(index, 1.0)
        value = float(self.search.outward(self.best)[index])
        bottom = 0.0 if unknown.logarithmic else unknown.floor
        note = ""
        if low is None and high is None:
            value, note = math.nan, "any value fits the data"
        elif low is None or high is None:
            note = "bounded on one side only"
        return Identified(
            value,
            bottom if low is None else low,
            math.inf if high is None else high,
            unknown.unit,
            self.n_effective,
            note,
        )

    def _bound(self, index: int, direction: float) -> float | None:
        """Where the profile leaves the limit on one side; None if it never does."""
        inside, outside = self._bracket(index, direction)
        if outside is None:
            return None
        for _ in range(_BISECTIONS):  # of a bracket that is at most half of its distance wide
            middle = 0.5 * (inside + outside)
            if self._excess(index, middle) > self.limit:
                outside = middle
            else:
                inside = middle
        whole = self.best.copy()
        whole[index] = outside
        return float(self.search.outward(whole)[index])

    def _bracket(self, index: int, direction: float) -> tuple[float, float | None]:
        """The last coordinate within the limit and the first one beyond it."""
        start = float(self.best[index])
        end = 1.0 if direction > 0.0 else 0.0
        inside, step = start, 2.0**-_DOUBLINGS
        while inside != end:
            trial = min(max(start + direction * step, 0.0), 1.0)
            if self._excess(index, trial) > self.limit:
                return inside, trial
            inside, step = trial, 2.0 * step
        return inside, None

    def _excess(self, index: int, at: float) -> float:
        """Rise of the sum of squares when one coordinate is held.

        Where the best fit's surroundings rise beyond the limit, the other valleys that the starts
        have found and that fit nearly as well are tried too: a profile may pass into one.
        """
        least = math.inf
        for start in (self.best, *self.elsewhere):
            rise = 2.0 * float(self.search.minimise(start, index, at).cost) - self.chi2
            least = min(least, rise)
            if least <= self.limit:
                break
        return least
