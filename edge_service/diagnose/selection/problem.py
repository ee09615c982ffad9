"""Selection problem: which sets of regressors explain the gap, scored on equal terms for all."""

import functools
import math
import operator
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...messages.samples import Floats
from ..candidates.design_matrix import DesignMatrix
from ..candidates.normal_equations import inverted, solved, square_falls
from ..candidates.null_shapes import UNKNOWN
from ..session.session import Session
from .noise import Noise

NAME_COST = 4.0
"""Each effect is there with odds of 1 to 55 before anything is measured."""
UNNAMED_COST = 10.0
"""A cause that no entry describes is some hundred times rarer still."""
_ROUNDS = 6
_PINNED = 1e9
_AT_ONCE = 256


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Fit of a set of candidate regressors and the nuisances to all channels.

    Attributes:
        chosen: the candidates.
        names: effects among them.
        regressors: nuisances first, then the candidates.
        coefficients: of their columns, (p,).
        rms: root mean square that is left, by channel.
        score: logarithm of the evidence, up to a constant.
    """

    chosen: tuple[int, ...]
    names: frozenset[str]
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


@dataclass(frozen=True, slots=True, eq=False)
class SelectionProblem:
    """Candidates, noise and priors, by which any set of effects is scored.

    Attributes:
        priors: effect -> healthy mean and tolerance of its amount, for parameters of the model.
        pinned: coefficients of the nuisances, (p,), where they must not follow; otherwise None.
    """

    design: DesignMatrix
    noise: Noise
    priors: Mapping[str, tuple[float, float]]
    pinned: Floats | None = None

    def pinned_to(self, whole: Fit) -> "SelectionProblem":
        """Pin the nuisances to those of a fit: they must not stretch to hide a cause."""
        return replace(self, pinned=whole.coefficients[: self.design.nuisance_columns])

    def fit(self, chosen: Sequence[int]) -> Fit:
        """Fit the nuisances and the chosen candidates."""
        return self.fits([chosen])[0]

    def fits(self, sets: Sequence[Sequence[int]]) -> list[Fit]:
        """Fit many sets of candidates; those with as many columns are solved at once.

        Each channel has its own noise scale, found together with the coefficients. The score is
        -1/2 sum_c n_c log(s_c^2) with n_c effective observations, less what the prior of the
        nuisances and, as in Schwarz (1978), the number of coefficients and of shapes tried cost.
        """
        regressors = self.design.regressors
        sizes: dict[int, list[int]] = {}
        for k, chosen in enumerate(sets):
            sizes.setdefault(sum(regressors[a].size for a in chosen), []).append(k)
        found: dict[int, Fit] = {}
        for alike in sizes.values():
            for start in range(0, len(alike), _AT_ONCE):
                some = alike[start : start + _AT_ONCE]
                found.update(zip(some, self._solved([sets[k] for k in some]), strict=True))
        return [found[k] for k in range(len(sets))]

    def _solved(self, sets: Sequence[Sequence[int]]) -> list[Fit]:
        """Fits of sets that all have p columns."""
        design, noise = self.design, self.noise
        regressors = [(*range(design.nuisances), *chosen) for chosen in sets]
        index = np.array([design.indices(each) for each in regressors])
        equations = {name: each.of_sets(index) for name, each in design.equations.items()}
        prior, mean = design.precision[index], design.mean[index]
        if self.pinned is not None:
            mean[:, : len(self.pinned)] = self.pinned
            prior[:, : len(self.pinned)] *= _PINNED
        one = np.ones(len(sets))
        variance = {
            name: max(each.square / each.rows, 1e-300) * one for name, each in equations.items()
        }
        diagonal = np.eye(index.shape[1]) * prior[:, None, :]
        for _ in range(_ROUNDS):
            weights = {
                name: noise.effective[name] / each.rows / variance[name]
                for name, each in equations.items()
            }
            normal = diagonal + _total(
                weights[n][:, None, None] * each.gram for n, each in equations.items()
            )
            target = prior * mean + _total(
                weights[n][:, None] * each.cross for n, each in equations.items()
            )
            beta = solved(normal, target)
            left = {name: each.mean_square(beta) for name, each in equations.items()}
            variance = {name: left[name] + noise.discrepancy[name] ** 2 for name in equations}
        score = -0.5 * _total(noise.effective[name] * np.log(variance[name]) for name in equations)
        score -= 0.5 * np.sum((beta - mean) ** 2 * prior, axis=1)
        names = [self._names(chosen) for chosen in sets]
        return [
            Fit(
                tuple(chosen),
                names[k],
                regressors[k],
                beta[k],
                {name: math.sqrt(each[k]) for name, each in left.items()},
                float(score[k]) - self._penalty(chosen, names[k]),
            )
            for k, chosen in enumerate(sets)
        ]

    def _names(self, chosen: Sequence[int]) -> frozenset[str]:
        return frozenset(self.design.regressors[a].name for a in chosen)

    def _penalty(self, chosen: Sequence[int], names: frozenset[str]) -> float:
        penalty = sum(self._cost(a) for a in chosen)
        return penalty + NAME_COST * len(names) + (UNNAMED_COST - NAME_COST) * (UNKNOWN in names)

    def _cost(self, regressor: int) -> float:
        size = self.design.regressors[regressor].size
        count = sum(self.noise.effective.values())
        return 0.5 * size * math.log(count) + math.log(self.design.alternatives[regressor])

    def without(self, whole: Fit, name: str) -> Fit:
        """Fit the set without one of its effects."""
        return self.fit([a for a in whole.chosen if self.design.regressors[a].name != name])

    def names_by_weight(self, whole: Fit) -> list[str]:
        """Names of a fit, the one that it can spare least first."""
        loss = {name: whole.score - self.without(whole, name).score for name in whole.names}
        return sorted(loss, key=lambda name: -loss[name])

    def reductions(self, base: Fit, candidates: Sequence[int]) -> Floats:
        """Fall of the weighted square by each candidate added to a fit, to first order, (n,)."""
        design, noise = self.design, self.noise
        index = design.indices(base.regressors)
        weights = {
            name: noise.effective[name] / each.rows / noise.variance(name, base.rms[name])
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
            found[which] = square_falls(own, schur, rest[mine])
        return found

    def residuals(self, session: Session, best: Fit) -> dict[str, Floats]:
        """Residual that a fit leaves of the gap with all its regressors, by channel, (n,)."""
        return {
            name: rows.gap - self.design.modelled(name, best.regressors, best.coefficients)
            for name, rows in session.channels.items()
        }


def _total(parts: Iterable[Floats]) -> Floats:
    return functools.reduce(operator.add, parts)
