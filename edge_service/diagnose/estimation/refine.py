"""Values of named effects: shapes between the points of the grid, amounts, and their spread."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from ...messages.samples import Booleans, Floats
from ...models.effects.effect import Kind, Parameter, Role
from ..candidates.regressor import EntryRegressor, entry_regressor
from ..selection.evidence import inverted
from ..session.session import Session

CHANGE_SIGMA = 1.0
"""Relative change of a shape that is thinkable, for what a slope says of it."""
_MOST_SWEEPS = 4
_SETTLED = 1e-2  # fall of the square, as a part of it, that is worth no further sweep
_EVALUATIONS = 10
_REACH = 2.0  # of a shape's search around its point of the grid, as a factor
_FINE_REACH = 1.1
"""The same where the grid is fine."""


@dataclass(slots=True, eq=False)
class Problem:
    """Weighted least squares over both channels, with columns that come and go.

    Attributes:
        gaps, weights: by channel; a weight is one over the noise.
        fixed: columns of what is tolerated, by channel, (n, q), with their prior.
        observations: independent ones among the rows of all channels.
    """

    session: Session
    weights: Mapping[str, float]
    fixed: Mapping[str, Floats]
    mean: Floats
    precision: Floats
    observations: float

    def columns(self, regressor: EntryRegressor) -> dict[str, Floats]:
        """Of one regressor, by channel."""
        return {name: regressor.columns(self.session, name) for name in self.session.channels}

    def solve(
        self, regressors: Sequence[EntryRegressor], columns: Sequence[Mapping[str, Floats]]
    ) -> tuple[Floats, Floats, float]:
        """Coefficients of fixed and free columns, covariance, and the weighted square left."""
        return self._solved(columns, strict_columns(regressors), None)

    def solve_beside(
        self,
        regressors: Sequence[EntryRegressor],
        columns: Sequence[Mapping[str, Floats]],
        slopes: Mapping[str, Floats],
    ) -> tuple[Floats, Floats, float]:
        """The same while shapes may change, whose relative changes have the columns `slopes`."""
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


def refine(problem: Problem, regressors: Sequence[EntryRegressor]) -> list[EntryRegressor]:
    """Move the shapes of entries to where they fit best, one after another."""
    regressors = [_started(problem, regressor, regressors) for regressor in regressors]
    columns: list[Mapping[str, Floats]] = [problem.columns(regressor) for regressor in regressors]
    left = problem.solve(regressors, columns)[2]
    for _ in range(_MOST_SWEEPS):
        before = left
        for k, regressor in enumerate(regressors):
            for parameter in _shapes(regressor):
                regressors[k], columns[k], left = _moved(problem, regressors, columns, k, parameter)
        if left > (1.0 - _SETTLED) * before:
            break
    return list(regressors)


def _shapes(regressor: EntryRegressor) -> list[Parameter]:
    if regressor.effect.kind is Kind.DISTURBANCE:
        return []  # the search for it has its own, finer resolution
    moved = {name for name, _ in regressor.shape}
    return [
        p
        for p in regressor.effect.parameters
        if p.role is Role.SHAPE and not p.whole and p.name in moved
    ]


def _started(
    problem: Problem, regressor: EntryRegressor, regressors: Sequence[EntryRegressor]
) -> EntryRegressor:
    """An effect without an amount begins where its strength would be 1."""
    if regressor.amount or regressor.effect.follows_own_torque:
        return regressor
    strength = regressor.effect.parameters[0].name
    free = replace(regressor, amount=strength)
    others = [each for each in regressors if each is not regressor]
    beta, _, _ = problem.solve([*others, free], [problem.columns(each) for each in (*others, free)])
    value = dict(regressor.shape)[strength]
    return _at(regressor, strength, value * float(np.clip(beta[-1], 0.2, 3.0)))


def _moved(
    problem: Problem,
    regressors: Sequence[EntryRegressor],
    columns: Sequence[Mapping[str, Floats]],
    k: int,
    parameter: Parameter,
) -> tuple[EntryRegressor, Mapping[str, Floats], float]:
    """The regressor with one shape moved, its columns, and the weighted square left."""
    value = dict(regressors[k].shape)[parameter.name]
    is_scale = parameter.low >= 0.0 and value > 0.0

    def trial(x: float) -> tuple[EntryRegressor, dict[str, Floats], float]:
        wanted = (
            value * float(np.exp(x)) if is_scale else value + x * _span(regressors[k], parameter)
        )
        regressor = _at(
            regressors[k], parameter.name, float(np.clip(wanted, parameter.low, parameter.high))
        )
        mine = problem.columns(regressor)
        changed = [*regressors[:k], regressor, *regressors[k + 1 :]]
        left = problem.solve(changed, [*columns[:k], mine, *columns[k + 1 :]])[2]
        return regressor, mine, left

    factor = _FINE_REACH if regressors[k].effect.follows_own_torque else _REACH
    reach = float(np.log(factor)) if is_scale else 1.0
    found = optimize.minimize_scalar(
        lambda x: trial(x)[2],
        bounds=(-reach, reach),
        method="bounded",
        options={"maxiter": _EVALUATIONS, "xatol": 0.01 * reach},
    )
    here, there = trial(0.0), trial(float(found.x))
    return there if there[2] < here[2] else here


def _span(regressor: EntryRegressor, parameter: Parameter) -> float:
    """Span by which a place or a time is moved: the width or the length of what is there."""
    shape = dict(regressor.shape)
    return shape.get("width_m", shape.get("duration_s", 0.1 * abs(parameter.faulty)))


def _at(regressor: EntryRegressor, name: str, value: float) -> EntryRegressor:
    shape = dict(regressor.shape) | {name: value}
    return entry_regressor(regressor.effect, regressor.amount, shape)
