"""Design matrix of a session: the columns of all candidates, and their normal equations."""

import concurrent.futures
import itertools
import os
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ...messages.samples import Booleans, Floats
from ...models.effects.effect import Effect
from ..session.session import Integers, Session
from .empirical_shapes import empirical_shapes
from .healthy_prior import HealthyPrior
from .normal_equations import Columns, NormalEquations
from .regressor import CandidateRegressor, regressors_of

_MOST_OF_GAP = 10.0
"""Coefficients are held where their column makes up to so many times the gap of its channel: two
columns that are nearly one must not stand against each other."""
_LEAST_OF_FAMILY = 1e-8
"""Energy of a regressor over that of the strongest of its family, below which it is not there."""
_STRICT_SIGMA = 0.05
"""Of the strength, about 1, of an effect whose column holds the measured torque."""


@dataclass(frozen=True, slots=True, eq=False)
class DesignMatrix:
    """Candidate regressors and their columns.

    Attributes:
        regressors: the nuisances first, then the candidates of the library and the others.
        nuisances: number of leading regressors that stand for what a healthy axis may have.
        mean, precision: prior of the coefficient of each column, (p,); precision 0 knows nothing.
        first: first column of each regressor, (n_regressors + 1,).
        columns: by channel, (n, p); none in a matrix that is restricted to some rows.
        equations: normal equations of the columns and the gap, by channel.
        alternatives: number of regressors that share name and form with each regressor.
    """

    regressors: tuple[CandidateRegressor, ...]
    nuisances: int
    mean: Floats
    precision: Floats
    first: Integers
    columns: Mapping[str, Columns]
    equations: Mapping[str, NormalEquations]
    alternatives: tuple[int, ...]

    @classmethod
    def of_session(
        cls,
        session: Session,
        prior: Sequence[HealthyPrior],
        library: Sequence[Effect],
        more: Sequence[CandidateRegressor] = (),
    ) -> Self:
        """Build the matrix of a session from the entries that may explain its gap.

        Args:
            prior: nuisances and the distributions of their amounts.
            more: candidates behind those of the library.
        """
        names, count = {effect.name for effect in library}, len(prior)
        strict = {effect.name for effect in library if effect.follows_own_torque}
        entries: list[CandidateRegressor] = [
            each for effect in library for each in regressors_of(effect, session)
        ]
        if names:
            entries += [shape for shape in empirical_shapes(session) if shape.name in names]
        regressors = [*(each.regressor for each in prior), *entries, *more]
        columns = {name: _columns(regressors, session, name) for name in session.channels}
        equations = {
            name: NormalEquations.of(each, session.channels[name].gap)
            for name, each in columns.items()
        }
        first = np.cumsum([0, *(each.size for each in regressors)]).astype(np.int64)
        mean, precision = np.zeros(int(first[-1])), _bounding(session, equations)
        mean[:count] = [each.mean for each in prior]
        precision[:count] = [each.sigma**-2 for each in prior]
        for k, regressor in enumerate(regressors[count:], start=count):
            if regressor.name in strict:
                mean[first[k]], precision[first[k]] = 1.0, _STRICT_SIGMA**-2
        alternatives = (*(1 for _ in prior), *_alternatives(entries, more))
        return cls(
            tuple(regressors), count, mean, precision, first, columns, equations, alternatives
        )

    def restricted(
        self, count: int, session: Session, kept: Mapping[str, Booleans]
    ) -> "DesignMatrix":
        """Restrict to the first `count` regressors and to some rows of each channel, (n,)."""
        end = int(self.first[count])
        return replace(
            self,
            regressors=self.regressors[:count],
            mean=self.mean[:end],
            precision=self.precision[:end],
            first=self.first[: count + 1],
            columns={},
            equations={
                name: NormalEquations.of(
                    self.columns[name][:, :end], rows.gap, np.flatnonzero(kept[name])
                )
                for name, rows in session.channels.items()
            },
            alternatives=self.alternatives[:count],
        )

    def indices(self, regressors: Sequence[int]) -> Integers:
        """Columns of some regressors, in their order."""
        parts = [np.arange(self.first[a], self.first[a + 1]) for a in regressors]
        return np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)

    @property
    def nuisance_columns(self) -> int:
        """Number of leading columns that are those of the nuisances."""
        return int(self.first[self.nuisances])

    def of_effects(self, names: Collection[str]) -> list[int]:
        """Candidates that bear one of some names."""
        return [k for k in self.candidates if self.regressors[k].name in names]

    @property
    def candidates(self) -> list[int]:
        """Regressors that are no nuisances, and that show."""
        energy = sum(np.diag(each.gram) / (each.square or 1.0) for each in self.equations.values())
        energy_of = np.add.reduceat(energy, self.first[:-1])
        strongest: dict[tuple[str, str], float] = {}
        for regressor, each in zip(self.regressors, energy_of.tolist(), strict=True):
            family = regressor.name, regressor.form
            strongest[family] = max(strongest.get(family, 0.0), each)
        return [
            k
            for k in range(self.nuisances, len(self.regressors))
            for regressor in (self.regressors[k],)
            if energy_of[k] > _LEAST_OF_FAMILY * strongest[regressor.name, regressor.form]
        ]

    def modelled(self, channel: str, regressors: Sequence[int], coefficients: Floats) -> Floats:
        """Gap in a channel as regressors model it, (n,)."""
        return self.columns[channel][:, self.indices(regressors)].astype(np.float64) @ coefficients


def _alternatives(
    entries: Sequence[CandidateRegressor], more: Sequence[CandidateRegressor]
) -> Iterator[int]:
    """Number of regressors that compete with each: of its name and form, or of its name."""
    shapes = Counter((each.name, each.form) for each in entries)
    forms = Counter(each.name for each in more)
    yield from (shapes[each.name, each.form] for each in entries)
    yield from (forms[each.name] for each in more)


def _bounding(session: Session, equations: Mapping[str, NormalEquations]) -> Floats:
    """Precision of the coefficient of each column that bounds it by the gap, (p,)."""
    held = [
        np.diag(each.gram) / max(_MOST_OF_GAP**2 * float(np.sum(rows.gap**2)), 1e-300)
        for name, each in equations.items()
        for rows in (session.channels[name],)
    ]
    found: Floats = np.max(held, axis=0)
    return found


def _columns(regressors: Sequence[CandidateRegressor], session: Session, channel: str) -> Columns:
    """Columns of all regressors, (n, p).

    Of a family that cannot show in the channel only the first is evaluated.
    """
    first = np.cumsum([0, *(regressor.size for regressor in regressors)])
    found = np.zeros((int(first[-1]), len(session.channels[channel].gap)), np.float32).T
    families: dict[tuple[str, str], list[int]] = {}
    for k, regressor in enumerate(regressors):
        families.setdefault((regressor.name, regressor.form), []).append(k)

    def fill(k: int) -> bool:
        columns = regressors[k].columns(session, channel)
        found[:, first[k] : first[k + 1]] = columns
        return bool(np.any(columns))

    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        shows = list(pool.map(fill, [each[0] for each in families.values()]))
        others = itertools.compress((each[1:] for each in families.values()), shows)
        list(pool.map(fill, itertools.chain.from_iterable(others)))
    return found
