"""All candidate columns of a session at once, and the sums of products that fits need."""

import concurrent.futures
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import numpy.typing as npt

from ...messages.samples import Booleans, Floats
from ...models.effects.effect import Effect
from ..session.healthy_prior import HealthyPrior
from ..session.session import Integers, Session
from .empirical_shapes import empirical_shapes
from .regressor import CandidateRegressor, regressors_of

_MOST_OF_GAP = 10.0
"""Coefficients are held where their column makes up to so many times the gap of its channel: two
columns that are nearly one must not stand against each other."""
_LEAST_OF_FAMILY = 1e-8
"""Energy of a regressor over that of the strongest of its family, below which it is not there."""
_STRICT_SIGMA = 0.05
"""Of the strength, about 1, of an effect whose column holds the measured torque."""


Columns = npt.NDArray[np.float32]
"""Half the memory; products of theirs are summed in double precision."""


_CHUNK = 4096
"""Rows whose products are summed at once, in double precision."""


@dataclass(frozen=True, slots=True, eq=False)
class NormalEquations:
    """Sums over the rows of one channel: gram (p, p), cross (p,), square of the gap, rows."""

    gram: Floats
    cross: Floats
    square: float
    rows: int

    @classmethod
    def of(cls, columns: Columns, gap: Floats, rows: Integers | None = None) -> Self:
        """Of columns (n, p) and the gap (n,), or of some of their rows only.

        Most columns show in one channel only.
        """
        chosen = np.arange(len(gap)) if rows is None else rows
        shown = np.flatnonzero([np.any(column) for column in columns.T])
        gram = np.zeros((columns.shape[1], columns.shape[1]))
        cross = np.zeros(columns.shape[1])
        gram[np.ix_(shown, shown)], cross[shown] = _products(columns, shown, gap, chosen)
        return cls(gram, cross, float(gap[chosen] @ gap[chosen]), len(chosen))


@dataclass(frozen=True, slots=True, eq=False)
class DesignMatrix:
    """Candidate regressors and their columns.

    Attributes:
        regressors: the first `tolerated` of them are what a healthy axis may have.
        mean, precision: prior of the coefficient of each column, (p,); 0 knows nothing.
        first: first column of each regressor, (n_regressors + 1,).
        columns, equations: by channel, (n, p).
        alternatives: how many regressors share name and form with each regressor.
    """

    regressors: tuple[CandidateRegressor, ...]
    tolerated: int
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
        tolerated: Sequence[HealthyPrior],
        library: Sequence[Effect],
        more: Sequence[CandidateRegressor] = (),
    ) -> Self:
        """The design matrix of a session and of the entries that may explain its gap.

        Args:
            more: candidates behind those of the library.
        """
        names = {effect.name for effect in library}
        strict = {effect.name for effect in library if effect.follows_own_torque}
        entries: list[CandidateRegressor] = [
            a for effect in library for a in regressors_of(effect, session)
        ]
        if names:
            entries += [form for form in empirical_shapes(session) if form.name in names]
        regressors = [*(each.regressor for each in tolerated), *entries, *more]
        columns = {name: _columns(regressors, session, name) for name in session.channels}
        equations = {
            name: NormalEquations.of(each, session.channels[name].gap)
            for name, each in columns.items()
        }
        first = np.concatenate(
            ([0], np.cumsum([regressor.size for regressor in regressors]))
        ).astype(np.int64)
        mean, precision = np.zeros(int(first[-1])), _bounding(session, equations)
        mean[: len(tolerated)] = [each.mean for each in tolerated]
        precision[: len(tolerated)] = [each.sigma**-2 for each in tolerated]
        for k, regressor in enumerate(regressors[len(tolerated) :], start=len(tolerated)):
            if regressor.name in strict:
                mean[first[k]], precision[first[k]] = 1.0, _STRICT_SIGMA**-2
        shapes = Counter((regressor.name, regressor.form) for regressor in entries)
        forms = Counter(regressor.name for regressor in more)
        alternatives = (
            *(1 for _ in tolerated),
            *(shapes[regressor.name, regressor.form] for regressor in entries),
            *(forms[regressor.name] for regressor in more),
        )
        count = len(tolerated)
        return cls(
            tuple(regressors), count, mean, precision, first, columns, equations, alternatives
        )

    def restricted(
        self, count: int, session: Session, kept: Mapping[str, Booleans]
    ) -> "DesignMatrix":
        """Its first `count` regressors over some rows of each channel, without columns."""
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
    def candidates(self) -> list[int]:
        """Regressors that are not merely tolerated, and that show."""
        energy = sum(np.diag(each.gram) / (each.square or 1.0) for each in self.equations.values())
        energy_of = np.add.reduceat(energy, self.first[:-1])
        strongest: dict[tuple[str, str], float] = {}
        for regressor, each in zip(self.regressors, energy_of.tolist(), strict=True):
            family = regressor.name, regressor.form
            strongest[family] = max(strongest.get(family, 0.0), each)
        return [
            k
            for k in range(self.tolerated, len(self.regressors))
            for regressor in (self.regressors[k],)
            if energy_of[k] > _LEAST_OF_FAMILY * strongest[regressor.name, regressor.form]
        ]

    def modelled(self, channel: str, regressors: Sequence[int], coefficients: Floats) -> Floats:
        """Gap in a channel as regressors model it, (n,)."""
        return self.columns[channel][:, self.indices(regressors)].astype(np.float64) @ coefficients


def _bounding(session: Session, equations: Mapping[str, NormalEquations]) -> Floats:
    """Precision of the coefficient of each column that bounds it by the gap, (p,)."""
    held = [
        np.diag(each.gram) / max(_MOST_OF_GAP**2 * float(np.sum(rows.gap**2)), 1e-300)
        for name, each in equations.items()
        for rows in (session.channels[name],)
    ]
    found: Floats = np.max(held, axis=0)
    return found


def _products(
    columns: Columns, shown: Integers, gap: Floats, rows: Integers
) -> tuple[Floats, Floats]:
    """Sums of products of the shown columns, (p, p), and of theirs with the gap, (p,)."""
    gram, cross = np.zeros((len(shown), len(shown))), np.zeros(len(shown))
    for start in range(0, len(rows), _CHUNK):
        some = rows[start : start + _CHUNK]
        part = columns[np.ix_(some, shown)].astype(np.float64)
        gram += part.T @ part
        cross += part.T @ gap[some]
    return gram, cross


def _columns(regressors: Sequence[CandidateRegressor], session: Session, channel: str) -> Columns:
    """Columns of all regressors, (n, p).

    Families that cannot show in the channel are not evaluated, and take no memory.
    """
    families: dict[tuple[str, str], CandidateRegressor] = {}
    for regressor in regressors:
        families.setdefault((regressor.name, regressor.form), regressor)
    shows = {
        family: bool(np.any(regressor.columns(session, channel)))
        for family, regressor in families.items()
    }
    first = np.cumsum([0, *(regressor.size for regressor in regressors)])
    found = np.zeros((int(first[-1]), len(session.channels[channel].gap)), np.float32).T

    def fill(k: int) -> None:
        if shows[regressors[k].name, regressors[k].form]:
            found[:, first[k] : first[k + 1]] = regressors[k].columns(session, channel)

    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(fill, range(len(regressors))))
    return found
