"""Design matrix of a session: the columns of all candidates beside what a healthy axis may have.

Force pulses on the table are candidates too, found where the torque has a mean of its own.
"""

import itertools
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from ...messages.samples import Booleans, Floats, Integers
from ...models.effects.effect import Effect, Kind, Role
from ...models.effects.registry import effects, get_effect
from ...models.machine import Machine
from ...threads import in_threads
from ..session.session import TORQUE_GAP, Session, parameter_tolerances
from .normal_equations import Columns, NormalEquations
from .regressors import CandidateRegressor, EntryRegressor, ForcePulse, entry_regressor

_MOST_OF_GAP = 10.0
"""Coefficients are held where their column makes up to so many times the gap of its channel: two
columns that are nearly one must not stand against each other."""
_LEAST_OF_FAMILY = 1e-8
"""Energy of a regressor over that of the strongest of its family, below which it is not there."""
_STRICT_SIGMA = 0.05
"""Of the strength, about 1, of an effect whose column holds the measured torque."""
_MOST_PULSES = 10


@dataclass(frozen=True, slots=True)
class HealthyPrior:
    """Nuisance effect of a healthy axis: its coefficient is normal with `mean` and `sigma`."""

    regressor: EntryRegressor
    mean: float
    sigma: float


def healthy_priors(machine: Machine, period_s: float, coulomb_nm: float) -> Sequence[HealthyPrior]:
    """Parameters within their tolerance, and traces of what no axis is free of."""

    def regressor(effect: Effect, shape: Mapping[str, float]) -> EntryRegressor:
        amounts = [p.name for p in effect.parameters if p.role is Role.AMOUNT]
        return entry_regressor(effect, amounts[0] if amounts else "", shape)

    def order(effect: Effect) -> tuple[bool, int, str]:
        """Parameters first: on the order of columns depend the last digits of an answer."""
        return effect.term is None, list(Kind).index(effect.kind), effect.name

    known = [
        HealthyPrior(regressor(get_effect(name), {}), 0.0, sigma)
        for name, sigma in parameter_tolerances(machine).items()
        if sigma > 0.0
    ]
    traces = [
        HealthyPrior(regressor(effect, effect.trace.shape), *prior(period_s, coulomb_nm))
        for effect in sorted(effects().values(), key=order)
        if (prior := effect.trace.prior)
    ]
    return known + traces


@dataclass(frozen=True, slots=True, eq=False)
class DesignMatrix:
    """Candidate regressors and their columns."""

    # the nuisances first, then the candidates of the library and the others
    regressors: tuple[CandidateRegressor, ...]
    nuisances: int  # leading regressors that stand for what a healthy axis may have
    mean: Floats  # prior of the coefficient of each column, (p,)
    precision: Floats  # of the same, (p,); 0 knows nothing
    first: Integers  # first column of each regressor, (n_regressors + 1,)
    columns: Mapping[str, Columns]  # by channel, (n, p); none where restricted to some rows
    equations: Mapping[str, NormalEquations]  # by channel
    alternatives: tuple[int, ...]  # regressors that share name and form with each regressor

    @classmethod
    def of_session(
        cls,
        session: Session,
        prior: Sequence[HealthyPrior],
        entries: Sequence[CandidateRegressor] = (),
        more: Sequence[CandidateRegressor] = (),
    ) -> Self:
        """Build the matrix of a session from what may explain its gap.

        Args:
            prior: nuisances and the distributions of their amounts.
            entries: candidates of the library; those of one name and form compete.
            more: candidates beside them; those of one name compete.
        """
        regressors = [*(each.regressor for each in prior), *entries, *more]
        columns = {name: _columns(regressors, session, name) for name in session.channels}
        equations = {
            name: NormalEquations.of(each, session.channels[name].gap)
            for name, each in columns.items()
        }
        first = np.cumsum([0, *(each.size for each in regressors)]).astype(np.int64)
        mean, count = np.zeros(int(first[-1])), len(prior)
        most = {name: max(_MOST_OF_GAP**2 * x.square, 1e-300) for name, x in equations.items()}
        held = [np.diag(each.gram) / most[name] for name, each in equations.items()]
        precision = np.max(held, axis=0)
        mean[:count] = [each.mean for each in prior]
        precision[:count] = [each.sigma**-2 for each in prior]
        strict = {name for name, effect in effects().items() if effect.follows_own_torque}
        own = [
            k for x, k in zip(regressors[count:], first[count:], strict=False) if x.name in strict
        ]
        mean[own], precision[own] = 1.0, _STRICT_SIGMA**-2
        shapes = Counter((each.name, each.form) for each in entries)
        forms = Counter(each.name for each in more)
        alternatives = [1] * count + [shapes[each.name, each.form] for each in entries]
        alternatives += [forms[each.name] for each in more]
        numbers = mean, precision, first, columns, equations, tuple(alternatives)
        return cls(tuple(regressors), count, *numbers)

    def restricted(self, count: int, session: Session, kept: Mapping[str, Booleans]) -> Self:
        """Restrict to the first `count` regressors and to some rows of each channel, (n,)."""
        end, rows = int(self.first[count]), {n: np.flatnonzero(x) for n, x in kept.items()}
        equations = {
            name: NormalEquations.of(self.columns[name][:, :end], each.gap, rows[name])
            for name, each in session.channels.items()
        }
        known, numbers = self.regressors[:count], (self.mean[:end], self.precision[:end])
        first, alike = self.first[: count + 1], self.alternatives[:count]
        return type(self)(known, self.nuisances, *numbers, first, {}, equations, alike)

    def indices(self, regressors: Sequence[int]) -> Integers:
        """Columns of some regressors, in their order."""
        parts = [np.arange(self.first[a], self.first[a + 1]) for a in regressors]
        return np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)

    @property
    def candidates(self) -> list[int]:
        """Regressors that are no nuisances, and that show."""
        energy = sum(np.diag(each.gram) / (each.square or 1.0) for each in self.equations.values())
        energy_of = np.add.reduceat(energy, self.first[:-1]).tolist()
        families = [(each.name, each.form) for each in self.regressors]
        strongest: dict[tuple[str, str], float] = {}
        for family, each in zip(families, energy_of, strict=True):
            strongest[family] = max(strongest.get(family, 0.0), each)
        every = range(self.nuisances, len(families))
        return [k for k in every if energy_of[k] > _LEAST_OF_FAMILY * strongest[families[k]]]

    def of_effects(self, names: Collection[str]) -> list[int]:
        """Candidates that bear one of some names."""
        return [k for k in self.candidates if self.regressors[k].name in names]


def _columns(regressors: Sequence[CandidateRegressor], session: Session, channel: str) -> Columns:
    first = np.cumsum([0, *(regressor.size for regressor in regressors)])
    found = np.zeros((int(first[-1]), len(session.channels[channel].gap)), np.float32).T
    families: dict[tuple[str, str], list[int]] = {}
    for k, regressor in enumerate(regressors):
        families.setdefault((regressor.name, regressor.form), []).append(k)

    def fill(k: int) -> bool:
        columns = regressors[k].columns(session, channel)
        found[:, first[k] : first[k + 1]] = columns
        return bool(np.any(columns))

    shows = in_threads(fill, (each[0] for each in families.values()))
    others = itertools.compress((each[1:] for each in families.values()), shows)
    in_threads(fill, itertools.chain.from_iterable(others))
    return found


def force_pulses(session: Session, left: Floats) -> Iterator[ForcePulse]:
    """Spans in which the torque `left`, N m, (n,), has a mean of its own, strongest first."""
    rows = session.channels[TORQUE_GAP]
    order = np.argsort(rows.variables["time_s"], kind="stable")
    time_s, left = rows.variables["time_s"][order], left[order]
    direction = np.sign(rows.variables["direction"][order])
    cells = np.floor((time_s - time_s[0]) / 0.1).astype(int)
    count = np.bincount(cells).astype(float)
    remaining = {False: left.copy(), True: left * direction}
    for _ in range(_MOST_PULSES):
        spans = [
            (*_strongest_span(np.bincount(cells, values).astype(np.float64), count), against)
            for against, values in remaining.items()
        ]
        _, first, last, against = max(spans, key=lambda span: span[0])  # steady if either will do
        inside = (cells >= first) & (cells < last)
        if not inside.any():
            return
        yield ForcePulse(time_s[0] + 0.1 * first, time_s[0] + 0.1 * last, against)
        taken = remaining[against][inside].mean() * (direction[inside] if against else 1.0)
        remaining[False][inside] -= taken
        remaining[True][inside] -= taken * direction[inside]


def _strongest_span(sums: Floats, count: Floats) -> tuple[float, int, int]:
    """Energy in the mean of the cells [i, j) of at most 20 s that hold most, and these."""
    total = np.concatenate(([0.0], np.cumsum(sums)))
    rows = np.concatenate(([0.0], np.cumsum(count)))
    best = (0.0, 0, 0)
    for length in np.unique(np.geomspace(3, 200, 30).astype(int)):
        if length >= len(total):
            break
        energy = (total[length:] - total[:-length]) ** 2
        energy /= np.maximum(rows[length:] - rows[:-length], 5.0)
        k = int(np.argmax(energy))
        best = max(best, (float(energy[k]), k, k + int(length)))
    return best
