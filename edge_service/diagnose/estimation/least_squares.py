"""Weighted least squares over all channels, with columns of entries that come and go."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from ...messages.samples import Booleans, Floats
from ..candidates.normal_equations import inverted
from ..candidates.regressor import EntryRegressor
from ..selection.problem import Fit, SelectionProblem
from ..session.session import Session

CHANGE_SIGMA = 1.0
"""Relative change of a shape that is thinkable, for what a slope says of it."""
_HELD = 1e9
"""Precision of the nuisances, over that of their prior."""


@dataclass(frozen=True, slots=True, eq=False)
class WeightedLeastSquares:
    """Weighted least squares over both channels, with columns that come and go.

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
    def of_fit(cls, session: Session, problem: SelectionProblem, best: Fit) -> Self:
        """Least squares with the noise that a fit leaves and its nuisances held."""
        design = problem.design
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

    def solve(
        self, regressors: Sequence[EntryRegressor], columns: Sequence[Mapping[str, Floats]]
    ) -> tuple[Floats, Floats, float]:
        """Solve for coefficients of fixed and free columns; with covariance and weighted square."""
        return self._solved(columns, strict_columns(regressors), None)

    def solve_beside(
        self,
        regressors: Sequence[EntryRegressor],
        columns: Sequence[Mapping[str, Floats]],
        slopes: Mapping[str, Floats],
    ) -> tuple[Floats, Floats, float]:
        """Solve while shapes may change too, whose relative changes have the columns `slopes`."""
        ones = strict_columns(regressors)
        moved = next(iter(slopes.values())).shape[1]
        known = np.concatenate((np.zeros(len(ones)), np.full(moved, CHANGE_SIGMA**-2)))
        ones = np.concatenate((ones, np.zeros(moved, dtype=np.bool_)))
        return self._solved([*columns, slopes], ones, None, known)

    def solve_rows(
        self,
        columns: Sequence[Mapping[str, Floats]],
        ones: Booleans,
        rows: Mapping[str, Booleans],
    ) -> Floats:
        """Coefficients of fixed and free columns from some rows of each channel."""
        return self._solved(columns, ones, rows)[0]

    def _solved(
        self,
        columns: Sequence[Mapping[str, Floats]],
        ones: Booleans,
        rows: Mapping[str, Booleans] | None,
        known: Floats | float = 0.0,
    ) -> tuple[Floats, Floats, float]:
        mean = np.concatenate((self.mean, np.where(ones, 1.0, 0.0)))
        precision = np.concatenate((self.precision, np.where(ones, 1e12, known)))
        normal, target = np.diag(precision), precision * mean
        square = float(mean @ (precision * mean))
        for name, each in self.session.channels.items():
            x, gap = np.column_stack([self.fixed[name], *(c[name] for c in columns)]), each.gap
            if rows is not None:
                x, gap = x[rows[name]], gap[rows[name]]
            weight = self.weights[name] ** 2
            normal = normal + weight * (x.T @ x)
            target = target + weight * (x.T @ gap)
            square += weight * float(gap @ gap)
        inverse = inverted(normal)
        beta = inverse @ target
        left = square - 2.0 * float(beta @ target) + float(beta @ normal @ beta)
        return beta, inverse, left


def strict_columns(regressors: Sequence[EntryRegressor]) -> Booleans:
    """Columns whose coefficient is 1: those of effects without an amount, (p,)."""
    return np.array(
        [not regressor.amount for regressor in regressors for _ in range(regressor.size)],
        dtype=np.bool_,
    )
