"""Named effects as entries of the library, fitted together by weighted least squares.

Entries come and go, and their shapes are refined between the points of their grid.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from scipy import optimize

from ...messages.samples import Booleans, Floats
from ...models.effects.effect import ActiveEffect, Kind, Term
from ...models.effects.registry import error_of, get_effect
from ..candidates.normal_equations import solved
from ..candidates.regressors import STEADY, EntryRegressor, ForcePulse
from ..selection.problem import Fit, SelectionProblem
from ..session.recordings import STILL_RAD_S
from ..session.session import TRANSMISSION_GAP, Session

CHANGE_SIGMA = 1.0
"""Relative change of a shape that is thinkable, for what a slope says of it."""
LEANING = 4.0
"""Variance factor: an approximate entry leaves bias, not noise, and it pulls the values along."""
_INERTIA = get_effect(error_of(Term.INERTIA))
_HELD = 1e9
"""Precision of the nuisances, over that of their prior."""
_MOST_SWEEPS = 4
_SETTLED = 1e-2  # fall of the square, as a part of it, that is worth no further sweep
_FIRST_STEP = 0.5  # of a search, as a part of its reach
_REACH = 2.0  # of a shape's search around its point of the grid, as a factor
_FINE_REACH = 1.1
"""The same where the grid is fine."""


@dataclass(frozen=True, slots=True, eq=False)
class WeightedLeastSquares:
    """Rows of all channels with their weights, and the nuisances beside whatever is fitted."""

    session: Session
    weights: Mapping[str, float]  # one over the noise, by channel
    fixed: Mapping[str, Floats]  # columns of the nuisances, by channel, (n, q)
    mean: Floats  # prior of their coefficients, (q,)
    precision: Floats  # of the same, (q,)
    observations: float  # number of independent ones among the rows of all channels
    moving: Mapping[str, Booleans]  # rows of a channel, (n,), where only those are foretold

    @classmethod
    def of_fit(cls, problem: SelectionProblem, best: Fit, named: frozenset[str]) -> Self:
        """Least squares with the noise that a fit leaves, its nuisances and named inertia held."""
        design, change = problem.design, problem.coefficients(best, _INERTIA.name)[1].sum()
        heavier = ActiveEffect(_INERTIA, {_INERTIA.parameters[0].name: float(change)})
        session = problem.session.with_load_of([heavier] if _INERTIA.name in named else [])
        index = design.indices(range(design.nuisances))
        effective, weights = problem.noise.effective, {}
        for name, rows in session.channels.items():
            variance = problem.noise.variance(name, best.rms[name])
            weights[name] = math.sqrt(effective[name] / len(rows.gap) / variance)
        fixed = {name: design.columns[name][:, index].astype(np.float64) for name in weights}
        mean, held = best.coefficients[: len(index)], _HELD * design.precision[index]
        moving = {}
        if any(get_effect(name).rests_anywhere for name in named) and TRANSMISSION_GAP in weights:
            speed = session.channels[TRANSMISSION_GAP].variables["motor_speed_rad_s"]
            moving[TRANSMISSION_GAP] = np.abs(speed) > STILL_RAD_S
        return cls(session, weights, fixed, mean, held, sum(effective.values()), moving)

    def columns(self, regressor: EntryRegressor) -> dict[str, Floats]:
        """Columns of one entry, by channel."""
        return {name: regressor.columns(self.session, name) for name in self.session.channels}

    def misfit(self, square: float) -> float:
        """Variance of a fit by what it leaves, over that of its weights, with what it leans by."""
        return LEANING * max(square / self.observations, 1.0)


class Solution(NamedTuple):
    """Coefficients of the nuisances and the entries, (p,), and their covariance, (p, p)."""

    beta: Floats
    covariance: Floats
    square: float  # weighted square that is left


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

    def with_shape(self, k: int, **shape: float) -> Self:
        """Entries of which one has other values of some shapes."""
        changed = self.regressors[k].with_shape(**shape)
        regressors = (*self.regressors[:k], changed, *self.regressors[k + 1 :])
        columns = (*self.columns[:k], self.system.columns(changed), *self.columns[k + 1 :])
        return type(self)(self.system, regressors, columns)

    def delayed(self, name: str, made: Sequence[ActiveEffect]) -> Self:
        """Entries of which one delays what some effects make, too."""
        late = replace(self.system, session=self.system.session.with_torque_of(made))
        pairs = zip(self.regressors, self.columns, strict=True)
        columns = tuple(late.columns(e) if e.name == name else known for e, known in pairs)
        return replace(self, columns=columns)

    def place(self, k: int) -> slice:
        """Coefficients of one entry among those of a solution."""
        start = len(self.system.mean) + sum(each.size for each in self.regressors[:k])
        return slice(start, start + self.regressors[k].size)

    def solve(
        self,
        slopes: Sequence[Mapping[str, Floats]] = (),
        rows: Mapping[str, Booleans] | None = None,
    ) -> Solution:
        """Solve for the nuisances and the entries; one without an amount keeps its strength of 1.

        Args:
            slopes: of the relative changes of shapes that may change too, by channel, (n, 1).
            rows: mask of the rows of each channel, (n,); all of them unless given.
        """
        system = self.system
        columns, moved = (*self.columns, *slopes), len(slopes)
        strict = [not each.form for each in self.regressors for _ in range(each.size)]
        ones = np.array(strict + [False] * moved, dtype=np.bool_)
        known = np.array([0.0] * len(strict) + [CHANGE_SIGMA**-2] * moved)
        mean = np.concatenate((system.mean, np.where(ones, 1.0, 0.0)))
        precision = np.concatenate((system.precision, np.where(ones, 1e12, known)))
        normal, target = np.diag(precision), precision * mean
        square = float(mean @ (precision * mean))
        for name, each in system.session.channels.items():
            x, gap = np.column_stack([system.fixed[name], *(c[name] for c in columns)]), each.gap
            masks = [each[name] for each in (system.moving, rows or {}) if name in each]
            if masks:
                kept = np.logical_and.reduce(masks)
                x, gap = x[kept], gap[kept]
            weight = system.weights[name] ** 2
            normal = normal + weight * (x.T @ x)
            target = target + weight * (x.T @ gap)
            square += weight * float(gap @ gap)
        inverse = solved(normal, np.eye(len(normal)))
        beta = inverse @ target
        left = square - 2.0 * float(beta @ target) + float(beta @ normal @ beta)
        return Solution(beta, inverse, left)


def entries_of(problem: SelectionProblem, best: Fit, named: frozenset[str]) -> Entries:
    """Entries of the library for the named effects of the `best` set, with refined shapes."""
    system, entries = WeightedLeastSquares.of_fit(problem, best, named), {}
    for k in problem.design.of_effects(named):
        each = problem.design.regressors[k]
        entry = each.as_entry() if isinstance(each, ForcePulse) else each
        if isinstance(entry, EntryRegressor):
            entries[k] = entry
    there = sorted(set(best.regressors) & entries.keys())
    shapes = Counter(entries[k].name for k in there)  # what is there but once is sought anew
    known = [k for k in there if entries[k].effect.most_entries > 1 or shapes[entries[k].name] == 1]
    pinned = problem.pinned_to(best)
    whole = pinned.stepwise([*entries], lambda name: get_effect(name).most_entries, known)
    chosen: list[EntryRegressor] = []
    for k in whole.chosen:
        if entries[k] not in chosen:
            chosen.append(entries[k])
    for name in sorted(named - {each.name for each in chosen}):
        chosen += [each for each in entries.values() if each.name == name][:1]
    chosen.sort(key=lambda each: each.name)
    return _under_load(_within_bounds(_refined(Entries.of(system, chosen))))


def _under_load(entries: Entries) -> Entries:
    """Load the springs with what fits best of a steady load, none to all, without a lead's error.

    Its part that is one-sided friction loads none, and what is wound up is like a pitch.
    """
    system, beta, part = entries.system, entries.solve().beta, 0.0
    rest = [each for each in entries.regressors if each.effect.kind is not Kind.TRAVEL]
    steady = (entries.place(k) for k, e in enumerate(entries.regressors) if e.name == STEADY)
    load_nm = sum(float(beta[place].sum()) for place in steady)

    def loaded(part: float, regressors: Sequence[EntryRegressor] = rest) -> Entries:
        held = {"constant_nm": part * load_nm, "asymmetry_nm": 0.0}
        session = system.session.with_load_of([ActiveEffect(get_effect(STEADY), held)])
        return Entries.of(replace(system, session=session), regressors)

    if not load_nm or not any(each.effect.has_one_load for each in rest):
        return entries
    whole = [*zip(loaded(1.0).columns, loaded(0.0).columns, strict=True)]
    for _ in range(_MOST_SWEEPS):
        now = loaded(part)
        beta = now.solve().beta[len(system.mean) :, None]
        slope = {c: np.column_stack([x[c] - y[c] for x, y in whole]) @ beta for c in system.weights}
        part = min(max(part + float(now.solve([slope]).beta[-1]), 0.0), 1.0)
    return loaded(part, entries.regressors)


def _within_bounds(entries: Entries) -> Entries:
    """Drop entries that only a sibling of the opposite sign keeps from leaving their bounds."""
    while True:
        beta, beyond = entries.solve().beta, {}
        names = [each.name for each in entries.regressors]
        for k, each in enumerate(entries.regressors):
            bound = each.bound
            if names.count(each.name) > 1 and bound is not None:
                amount = abs(float(np.hypot.reduce(beta[entries.place(k)])))
                beyond[k] = amount / max(abs(bound.low), abs(bound.high), 1e-300)
        worst = max(beyond, key=lambda k: beyond[k], default=None)
        if worst is None or beyond[worst] <= 1.0:
            return entries
        others = [each for k, each in enumerate(entries.regressors) if k != worst]
        entries = Entries.of(entries.system, others)


def _refined(entries: Entries) -> Entries:
    """Entries whose shapes are moved to where they fit best, one after another."""
    entries = Entries.of(entries.system, [_started(entries, each) for each in entries.regressors])
    left = entries.solve().square
    for _ in range(_MOST_SWEEPS):
        before = left
        for k, entry in enumerate(entries.regressors):
            if entry.effect.kind is not Kind.DISTURBANCE:  # whose search has a finer resolution
                entries, left = _moved(entries, k)
        if left > (1.0 - _SETTLED) * before:
            break
    return entries


def _started(entries: Entries, entry: EntryRegressor) -> EntryRegressor:
    """Start an effect without an amount where its strength would be 1."""
    if entry.form or entry.effect.follows_own_torque:
        return entry
    strength = entry.effect.parameters[0].name
    others = [each for each in entries.regressors if each is not entry]
    free = Entries.of(entries.system, [*others, replace(entry, form=strength)])
    factor = float(np.clip(free.solve().beta[-1], 0.2, 3.0))
    return entry.with_shape(**{strength: dict(entry.shape)[strength] * factor})


def _moved(entries: Entries, k: int) -> tuple[Entries, float]:
    """Entries of which one has its shapes where together they fit best, and the square left."""
    entry, shape = entries.regressors[k], dict(entries.regressors[k].shape)
    free = [p for p in entry.effect.parameters if p.name in shape and not p.whole]
    factor = _FINE_REACH if entry.effect.follows_own_torque else _REACH

    def trial(steps: Floats) -> tuple[Entries, float]:
        wanted = {}
        for each, step in zip(free, steps.tolist(), strict=True):
            value, is_scale = shape[each.name], each.low >= 0.0 and shape[each.name] > 0.0
            span = shape.get("width_m", 0.1 * abs(each.faulty))  # by which a place is moved
            value = value * factor**step if is_scale else value + step * span
            wanted[each.name] = min(max(value, each.low), each.high)
        changed = entries.with_shape(k, **wanted)
        return changed, changed.solve().square

    if not free:
        return entries, entries.solve().square
    start, bounds = np.zeros(len(free)), [(-1.0, 1.0)] * len(free)
    simplex = np.vstack((start, _FIRST_STEP * np.eye(len(free))))
    options = {"initial_simplex": simplex, "xatol": 0.01, "fatol": 0.1}
    found = optimize.minimize(
        lambda x: trial(x)[1], start, method="Nelder-Mead", bounds=bounds, options=options
    )
    return trial(found.x)
