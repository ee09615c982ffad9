"""Score of a set of atoms as an explanation of the gap, on equal terms for all."""

import functools
import math
import operator
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ..candidates.design_matrix import Dictionary, Sums
from ..candidates.null_shapes import UNKNOWN

NAME_COST = 4.0
"""Each effect is there with odds of 1 to 55 before anything is measured."""
NAMELESS_COST = 10.0
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
    """A set of atoms fitted to all channels.

    Attributes:
        atoms: tolerated parameters first.
        coefficients: of their columns, (p,).
        rms: what is left, by channel.
        score: logarithm of the evidence, up to a constant.
    """

    atoms: tuple[int, ...]
    coefficients: Floats
    rms: Mapping[str, float]
    score: float

    def of_atoms(self, dictionary: Dictionary, atoms: Sequence[int]) -> Floats:
        """Coefficients of some of its atoms."""
        place = {c: k for k, c in enumerate(dictionary.indices(self.atoms).tolist())}
        wanted = [place[c] for c in dictionary.indices(atoms).tolist()]
        found: Floats = self.coefficients[wanted]
        return found

    def names(self, dictionary: Dictionary) -> frozenset[str]:
        """Effects in the set."""
        return frozenset(dictionary.atoms[a].name for a in self.atoms if a >= dictionary.tolerated)


def fit(
    dictionary: Dictionary, chosen: Sequence[int], noise: Noise, pinned: Floats | None = None
) -> Fit:
    """Fit tolerated parameters, unless they are pinned to given values, and the chosen atoms."""
    return fits(dictionary, [chosen], noise, pinned)[0]


def fits(
    dictionary: Dictionary,
    sets: Sequence[Sequence[int]],
    noise: Noise,
    pinned: Floats | None = None,
) -> list[Fit]:
    """Fit many sets of atoms; those with as many columns are solved at once.

    Each channel has its own noise scale, found together with the coefficients. The score is
    -1/2 sum_c n_c log(s_c^2) with n_c effective observations, less what the prior of the tolerated
    parameters and, as in Schwarz (1978), the number of coefficients and of shapes tried cost.
    """
    sizes: dict[int, list[int]] = {}
    for k, chosen in enumerate(sets):
        sizes.setdefault(sum(dictionary.atoms[a].size for a in chosen), []).append(k)
    found: dict[int, Fit] = {}
    for alike in sizes.values():
        for start in range(0, len(alike), _AT_ONCE):
            some = alike[start : start + _AT_ONCE]
            solved = _solved(dictionary, [sets[k] for k in some], noise, pinned)
            found.update(zip(some, solved, strict=True))
    return [found[k] for k in range(len(sets))]


def _solved(
    dictionary: Dictionary, sets: Sequence[Sequence[int]], noise: Noise, pinned: Floats | None
) -> list[Fit]:
    """Fits of sets that all have p columns."""
    atoms = [(*range(dictionary.tolerated), *chosen) for chosen in sets]
    index = np.array([dictionary.indices(each) for each in atoms])
    sums = {
        name: Sums(
            each.gram[index[:, :, None], index[:, None, :]],
            each.cross[index],
            each.square,
            each.rows,
        )
        for name, each in dictionary.sums.items()
    }
    prior, mean = dictionary.precision[index], dictionary.mean[index]
    if pinned is not None:
        mean[:, : len(pinned)] = pinned
        prior[:, : len(pinned)] *= _PINNED
    one = np.ones(len(sets))
    variance = {name: max(each.square / each.rows, 1e-300) * one for name, each in sums.items()}
    diagonal = np.eye(index.shape[1]) * prior[:, None, :]
    for _ in range(_ROUNDS):
        weights = {name: noise.effective[name] / sums[name].rows / variance[name] for name in sums}
        normal = diagonal + _total(weights[n][:, None, None] * sums[n].gram for n in sums)
        target = prior * mean + _total(weights[n][:, None] * sums[n].cross for n in sums)
        beta = _solution(normal, target)
        left = {name: _left(each, beta) for name, each in sums.items()}
        variance = {name: left[name] + noise.discrepancy[name] ** 2 for name in sums}
    score = -0.5 * _total(noise.effective[name] * np.log(variance[name]) for name in sums)
    score -= 0.5 * np.sum((beta - mean) ** 2 * prior, axis=1)
    return [
        Fit(
            atoms[k],
            beta[k],
            {name: math.sqrt(each[k]) for name, each in left.items()},
            float(score[k]) - _penalty(dictionary, chosen, noise),
        )
        for k, chosen in enumerate(sets)
    ]


def _penalty(dictionary: Dictionary, chosen: Sequence[int], noise: Noise) -> float:
    names = {dictionary.atoms[a].name for a in chosen}
    penalty = sum(_cost(dictionary, a, noise) for a in chosen)
    return penalty + NAME_COST * len(names) + (NAMELESS_COST - NAME_COST) * (UNKNOWN in names)


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


def _left(sums: Sums, beta: Floats) -> Floats:
    """Mean square that each set leaves, (s,)."""
    modelled = (beta[:, None, :] @ sums.gram)[:, 0]
    square = sums.square + np.sum(beta * (modelled - 2.0 * sums.cross), axis=1)
    left: Floats = np.maximum(square, 1e-12 * sums.square) / sums.rows
    return left


def _cost(dictionary: Dictionary, atom: int, noise: Noise) -> float:
    size = dictionary.atoms[atom].size
    count = sum(noise.effective.values())
    return 0.5 * size * math.log(count) + math.log(dictionary.alternatives[atom])


def _total(parts: Iterable[Floats]) -> Floats:
    return functools.reduce(operator.add, parts)


def reductions(
    dictionary: Dictionary, base: Fit, noise: Noise, candidates: Sequence[int]
) -> Floats:
    """Fall of the weighted square by each candidate added to a fit, to first order, (n,)."""
    index = dictionary.indices(base.atoms)
    weights = {
        name: noise.effective[name]
        / each.rows
        / (base.rms[name] ** 2 + noise.discrepancy[name] ** 2)
        for name, each in dictionary.sums.items()
    }
    across = _total(weights[n] * s.gram[:, index] for n, s in dictionary.sums.items())
    cross = _total(weights[n] * s.cross for n, s in dictionary.sums.items())
    prior, mean = dictionary.precision[index], dictionary.mean[index]
    covariance = inverted(np.diag(prior) + across[index])
    rest = cross - across @ (covariance @ (prior * mean + cross[index]))
    carried = across @ covariance
    found = np.zeros(len(candidates))
    sizes = np.array([dictionary.atoms[a].size for a in candidates])
    for size in np.unique(sizes).tolist():
        which = np.flatnonzero(sizes == size)
        mine = dictionary.first[np.array(candidates)[which]][:, None] + np.arange(size)
        square = mine[:, :, None], mine[:, None, :]
        own = _total(weights[n] * s.gram[square] for n, s in dictionary.sums.items())
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
