"""Score of a set of regressors as an explanation of the gap, on equal terms for all."""

import functools
import math
import operator
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ..candidates.design_matrix import DesignMatrix, NormalEquations
from ..candidates.null_shapes import UNKNOWN

NAME_COST = 4.0
"""Each effect is there with odds of 1 to 55 before anything is measured."""
UNNAMED_COST = 10.0
"""A cause that no entry describes is some hundred times rarer still."""
_ROUNDS = 6
_RIDGE = 1e-12
_PINNED = 1e9
_AT_ONCE = 256


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise that a fit cannot explain, by channel.

    Attributes:
        floor: root mean square that a healthy axis leaves.
        tolerance: root mean square that nobody needs to know the cause of.
        effective: independent observations among the rows; bounded, because the library is no
            better than an approximation of a real axis.
        discrepancy: root mean square below which one fit is no better than another.
    """

    floor: Mapping[str, float]
    tolerance: Mapping[str, float]
    effective: Mapping[str, float]
    discrepancy: Mapping[str, float]

    def beyond(self, channel: str, rms: float) -> float:
        """Part of a root mean square that is not the floor's."""
        return math.sqrt(max(rms**2 - self.floor[channel] ** 2, 0.0))

    def matters(self, channel: str, rms: float) -> bool:
        """Tell whether a root mean square exceeds the floor by more than the tolerance."""
        return self.beyond(channel, rms) > self.tolerance[channel]


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A set of regressors fitted to all channels.

    Attributes:
        regressors: tolerated parameters first.
        coefficients: of their columns, (p,).
        rms: what is left, by channel.
        score: logarithm of the evidence, up to a constant.
    """

    regressors: tuple[int, ...]
    coefficients: Floats
    rms: Mapping[str, float]
    score: float

    def of_regressors(self, design: DesignMatrix, regressors: Sequence[int]) -> Floats:
        """Coefficients of some of its regressors."""
        place = {c: k for k, c in enumerate(design.indices(self.regressors).tolist())}
        wanted = [place[c] for c in design.indices(regressors).tolist()]
        found: Floats = self.coefficients[wanted]
        return found

    def names(self, design: DesignMatrix) -> frozenset[str]:
        """Effects in the set."""
        return frozenset(
            design.regressors[a].name for a in self.regressors if a >= design.tolerated
        )


def fit(
    design: DesignMatrix, chosen: Sequence[int], noise: Noise, pinned: Floats | None = None
) -> Fit:
    """Fit tolerated parameters, unless pinned to given values, and the chosen regressors."""
    return fits(design, [chosen], noise, pinned)[0]


def fits(
    design: DesignMatrix,
    sets: Sequence[Sequence[int]],
    noise: Noise,
    pinned: Floats | None = None,
) -> list[Fit]:
    """Fit many sets of regressors; those with as many columns are solved at once.

    Each channel has its own noise scale, found together with the coefficients. The score is
    -1/2 sum_c n_c log(s_c^2) with n_c effective observations, less what the prior of the tolerated
    parameters and, as in Schwarz (1978), the number of coefficients and of shapes tried cost.
    """
    sizes: dict[int, list[int]] = {}
    for k, chosen in enumerate(sets):
        sizes.setdefault(sum(design.regressors[a].size for a in chosen), []).append(k)
    found: dict[int, Fit] = {}
    for alike in sizes.values():
        for start in range(0, len(alike), _AT_ONCE):
            some = alike[start : start + _AT_ONCE]
            solved = _solved(design, [sets[k] for k in some], noise, pinned)
            found.update(zip(some, solved, strict=True))
    return [found[k] for k in range(len(sets))]


def _solved(
    design: DesignMatrix, sets: Sequence[Sequence[int]], noise: Noise, pinned: Floats | None
) -> list[Fit]:
    """Fits of sets that all have p columns."""
    regressors = [(*range(design.tolerated), *chosen) for chosen in sets]
    index = np.array([design.indices(each) for each in regressors])
    equations = {
        name: NormalEquations(
            each.gram[index[:, :, None], index[:, None, :]],
            each.cross[index],
            each.square,
            each.rows,
        )
        for name, each in design.equations.items()
    }
    prior, mean = design.precision[index], design.mean[index]
    if pinned is not None:
        mean[:, : len(pinned)] = pinned
        prior[:, : len(pinned)] *= _PINNED
    one = np.ones(len(sets))
    variance = {
        name: max(each.square / each.rows, 1e-300) * one for name, each in equations.items()
    }
    diagonal = np.eye(index.shape[1]) * prior[:, None, :]
    for _ in range(_ROUNDS):
        weights = {
            name: noise.effective[name] / equations[name].rows / variance[name]
            for name in equations
        }
        normal = diagonal + _total(weights[n][:, None, None] * equations[n].gram for n in equations)
        target = prior * mean + _total(weights[n][:, None] * equations[n].cross for n in equations)
        beta = _solution(normal, target)
        left = {name: _left(each, beta) for name, each in equations.items()}
        variance = {name: left[name] + noise.discrepancy[name] ** 2 for name in equations}
    score = -0.5 * _total(noise.effective[name] * np.log(variance[name]) for name in equations)
    score -= 0.5 * np.sum((beta - mean) ** 2 * prior, axis=1)
    return [
        Fit(
            regressors[k],
            beta[k],
            {name: math.sqrt(each[k]) for name, each in left.items()},
            float(score[k]) - _penalty(design, chosen, noise),
        )
        for k, chosen in enumerate(sets)
    ]


def _penalty(design: DesignMatrix, chosen: Sequence[int], noise: Noise) -> float:
    names = {design.regressors[a].name for a in chosen}
    penalty = sum(_cost(design, a, noise) for a in chosen)
    return penalty + NAME_COST * len(names) + (UNNAMED_COST - NAME_COST) * (UNKNOWN in names)


def _solution(normal: Floats, target: Floats) -> Floats:
    """Solutions of positive systems whose rows may differ by many orders of magnitude, (s, p)."""
    diagonal = np.diagonal(normal, axis1=1, axis2=2)
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = normal / (scale[:, :, None] * scale[:, None, :]) + _RIDGE * np.eye(scale.shape[1])
    found: Floats = np.linalg.solve(scaled, (target / scale)[..., None])[..., 0] / scale
    return found


def inverted(normal: Floats) -> Floats:
    """Inverse of a positive matrix whose rows may differ by many orders of magnitude."""
    diagonal = np.diag(normal)
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = normal / np.outer(scale, scale) + _RIDGE * np.eye(len(scale))
    inverse: Floats = np.linalg.inv(scaled) / np.outer(scale, scale)
    return inverse


def _left(equations: NormalEquations, beta: Floats) -> Floats:
    """Mean square that each set leaves, (s,)."""
    modelled = (beta[:, None, :] @ equations.gram)[:, 0]
    square = equations.square + np.sum(beta * (modelled - 2.0 * equations.cross), axis=1)
    left: Floats = np.maximum(square, 1e-12 * equations.square) / equations.rows
    return left


def _cost(design: DesignMatrix, regressor: int, noise: Noise) -> float:
    size = design.regressors[regressor].size
    count = sum(noise.effective.values())
    return 0.5 * size * math.log(count) + math.log(design.alternatives[regressor])


def _total(parts: Iterable[Floats]) -> Floats:
    return functools.reduce(operator.add, parts)


def reductions(design: DesignMatrix, base: Fit, noise: Noise, candidates: Sequence[int]) -> Floats:
    """Fall of the weighted square by each candidate added to a fit, to first order, (n,)."""
    index = design.indices(base.regressors)
    weights = {
        name: noise.effective[name]
        / each.rows
        / (base.rms[name] ** 2 + noise.discrepancy[name] ** 2)
        for name, each in design.equations.items()
    }
    across = _total(weights[n] * s.gram[:, index] for n, s in design.equations.items())
    cross = _total(weights[n] * s.cross for n, s in design.equations.items())
    prior, mean = design.precision[index], design.mean[index]
    covariance = inverted(np.diag(prior) + across[index])
    rest = cross - across @ (covariance @ (prior * mean + cross[index]))
    carried = across @ covariance
    found = np.zeros(len(candidates))
    sizes = np.array([design.regressors[a].size for a in candidates])
    for size in np.unique(sizes).tolist():
        which = np.flatnonzero(sizes == size)
        mine = design.first[np.array(candidates)[which]][:, None] + np.arange(size)
        square = mine[:, :, None], mine[:, None, :]
        own = _total(weights[n] * s.gram[square] for n, s in design.equations.items())
        schur = own - carried[mine] @ across[mine].swapaxes(1, 2)
        found[which] = _falls(own, schur, rest[mine])
    return found


def _falls(own: Floats, schur: Floats, rest: Floats) -> Floats:
    """r S^-1 r of candidates of one size, (n,); 0 for those that the base leaves nothing of.

    Args:
        own, schur: squares of their columns, and of what the base leaves of them, (n, k, k).
        rest: their products with what the base leaves of the gap, (n, k).
    """
    diagonal = np.diagonal(own, axis1=1, axis2=2)
    left = np.diagonal(schur, axis1=1, axis2=2)
    fit_for = np.all((diagonal > 0.0) & (left >= 1e-6 * diagonal), axis=1)
    ridge = 1e-9 * diagonal[fit_for, :, None] * np.eye(rest.shape[1])
    unit = np.linalg.solve(schur[fit_for] + ridge, rest[fit_for, :, None])[..., 0]
    found = np.zeros(len(rest))
    found[fit_for] = np.sum(rest[fit_for] * unit, axis=1)
    return found
