"""Weighted least squares over all channels, with entries of the library that come and go."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from ...messages.samples import Booleans, Floats
from ..candidates.normal_equations import inverted
from ..candidates.regressors import EntryRegressor
from ..selection.problem import Fit, SelectionProblem
from ..session.session import Session

CHANGE_SIGMA = 1.0
"""Relative change of a shape that is thinkable, for what a slope says of it."""
LEANING = 4.0
"""Variance factor: an approximate entry leaves bias, not noise, and it pulls the values along."""
_HELD = 1e9
"""Precision of the nuisances, over that of their prior."""


@dataclass(frozen=True, slots=True, eq=False)
class WeightedLeastSquares:
    """Rows of all channels with their weights, and the nuisances beside whatever is fitted.

    Attributes:
        weights: one over the noise, by channel.
        fixed: columns of the nuisances, by channel, (n, q).
        mean, precision: prior of their coefficients, (q,).
        observations: number of independent ones among the rows of all channels.
    """

    session: Session
    weights: Mapping[str, float]
    fixed: Mapping[str, Floats]
    mean: Floats
    precision: Floats
    observations: float

    @classmethod
    def of_fit(cls, problem: SelectionProblem, best: Fit) -> Self:
        """Least squares with the noise that a fit leaves and its nuisances held."""
        session, design = problem.session, problem.design
        index = design.indices(range(design.nuisances))
        effective, weights = problem.noise.effective, {}
        for name, rows in session.channels.items():
            variance = problem.noise.variance(name, best.rms[name])
            weights[name] = math.sqrt(effective[name] / len(rows.gap) / variance)
        return cls(
            session,
            weights,
            {name: design.columns[name][:, index].astype(np.float64) for name in session.channels},
            best.coefficients[: len(index)],
            _HELD * design.precision[index],
            sum(effective.values()),
        )

    def columns(self, regressor: EntryRegressor) -> dict[str, Floats]:
        """Columns of one entry, by channel."""
        return {name: regressor.columns(self.session, name) for name in self.session.channels}

    def misfit(self, square: float) -> float:
        """Variance of a fit over that of its weights, 1 or more, with what it leans by.

        Args:
            square: weighted square that the fit leaves.
        """
        return LEANING * max(square / self.observations, 1.0)


class Solution(NamedTuple):
    """Coefficients of the nuisances and the entries, (p,), and their covariance, (p, p).

    Attributes:
        square: weighted square that is left.
    """

    beta: Floats
    covariance: Floats
    square: float


@dataclass(frozen=True, slots=True, eq=False)
class Entries:
    """Entries of the library that are fitted together, with their columns by channel."""

    system: WeightedLeastSquares
    regressors: tuple[EntryRegressor, ...]
    columns: tuple[Mapping[str, Floats], ...]

    @classmethod
    def of(cls, system: WeightedLeastSquares, regressors: Sequence[EntryRegressor]) -> Self:
        """Entries with columns at the rows of a system."""
        return cls(system, tuple(regressors), tuple(system.columns(each) for each in regressors))

    def with_shape(self, k: int, name: str, value: float) -> Self:
        """Entries of which one has another value of one shape."""
        changed = self.regressors[k].with_shape(name, value)
        regressors = (*self.regressors[:k], changed, *self.regressors[k + 1 :])
        columns = (*self.columns[:k], self.system.columns(changed), *self.columns[k + 1 :])
        return type(self)(self.system, regressors, columns)

    def without(self, k: int) -> Self:
        """Entries but for one."""
        regressors = (*self.regressors[:k], *self.regressors[k + 1 :])
        return type(self)(self.system, regressors, (*self.columns[:k], *self.columns[k + 1 :]))

    def place(self, k: int) -> slice:
        """Coefficients of one entry among those of a solution."""
        start = len(self.system.mean) + sum(each.size for each in self.regressors[:k])
        return slice(start, start + self.regressors[k].size)

    def solve(
        self,
        slopes: Mapping[str, Floats] | None = None,
        rows: Mapping[str, Booleans] | None = None,
    ) -> Solution:
        """Solve for the nuisances and the entries; one without an amount keeps its strength of 1.

        Args:
            slopes: columns of the relative changes of shapes that may change too, by channel.
            rows: mask of the rows of each channel, (n,); all of them unless given.
        """
        system = self.system
        moved = 0 if slopes is None else next(iter(slopes.values())).shape[1]
        columns = self.columns if slopes is None else (*self.columns, slopes)
        strict = [not each.amount for each in self.regressors for _ in range(each.size)]
        ones = np.array(strict + [False] * moved, dtype=np.bool_)
        known = np.array([0.0] * len(strict) + [CHANGE_SIGMA**-2] * moved)
        mean = np.concatenate((system.mean, np.where(ones, 1.0, 0.0)))
        precision = np.concatenate((system.precision, np.where(ones, 1e12, known)))
        normal, target = np.diag(precision), precision * mean
        square = float(mean @ (precision * mean))
        for name, each in system.session.channels.items():
            x, gap = np.column_stack([system.fixed[name], *(c[name] for c in columns)]), each.gap
            if rows is not None:
                x, gap = x[rows[name]], gap[rows[name]]
            weight = system.weights[name] ** 2
            normal = normal + weight * (x.T @ x)
            target = target + weight * (x.T @ gap)
            square += weight * float(gap @ gap)
        inverse = inverted(normal)
        beta = inverse @ target
        left = square - 2.0 * float(beta @ target) + float(beta @ normal @ beta)
        return Solution(beta, inverse, left)
