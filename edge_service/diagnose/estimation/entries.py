"""Named effects as entries of the library, with shapes refined between the points of their grid."""

from dataclasses import replace

import numpy as np
from scipy import optimize

from ...models.effects.effect import Kind, Parameter, Role
from ...models.effects.registry import get_effect
from ..candidates.regressors import EntryRegressor
from ..selection.problem import Fit, SelectionProblem
from .least_squares import Entries, WeightedLeastSquares

_MOST_SWEEPS = 4
_SETTLED = 1e-2  # fall of the square, as a part of it, that is worth no further sweep
_EVALUATIONS = 10
_REACH = 2.0  # of a shape's search around its point of the grid, as a factor
_FINE_REACH = 1.1
"""The same where the grid is fine."""


def entries_of(problem: SelectionProblem, best: Fit, named: frozenset[str]) -> Entries:
    """Entries of the library for the named effects, fitted alone, with refined shapes.

    Args:
        best: the best set, with all its shapes.
    """
    entries = {
        k: entry
        for k in problem.design.of_effects(named)
        if (entry := problem.design.regressors[k].as_entry()) is not None
    }
    known = sorted(set(best.regressors) & entries.keys())
    whole = problem.pinned_to(best).stepwise(
        list(entries), lambda name: get_effect(name).most_entries, known
    )
    chosen: list[EntryRegressor] = []
    for k in whole.chosen:
        if entries[k] not in chosen:
            chosen.append(entries[k])
    for name in sorted(named - {each.name for each in chosen}):
        chosen += [each for each in entries.values() if each.name == name][:1]
    system = WeightedLeastSquares.of_fit(problem, best)
    chosen.sort(key=lambda each: each.name)
    return _within_bounds(_refined(Entries.of(system, chosen)))


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
        entries = entries.without(worst)


def _refined(entries: Entries) -> Entries:
    """Entries whose shapes are moved to where they fit best, one after another."""
    entries = Entries.of(entries.system, [_started(entries, each) for each in entries.regressors])
    left = entries.solve().square
    for _ in range(_MOST_SWEEPS):
        before = left
        for k, entry in enumerate(entries.regressors):
            moved = {name for name, _ in entry.shape}
            if entry.effect.kind is Kind.DISTURBANCE:
                continue  # the search for it has its own, finer resolution
            for parameter in entry.effect.parameters:
                if parameter.role is Role.SHAPE and not parameter.whole and parameter.name in moved:
                    entries, left = _moved(entries, k, parameter)
        if left > (1.0 - _SETTLED) * before:
            break
    return entries


def _started(entries: Entries, entry: EntryRegressor) -> EntryRegressor:
    """Start an effect without an amount where its strength would be 1."""
    if entry.amount or entry.effect.follows_own_torque:
        return entry
    strength = entry.effect.parameters[0].name
    others = [each for each in entries.regressors if each is not entry]
    free = Entries.of(entries.system, [*others, replace(entry, amount=strength)])
    factor = float(np.clip(free.solve().beta[-1], 0.2, 3.0))
    return entry.with_shape(strength, dict(entry.shape)[strength] * factor)


def _moved(entries: Entries, k: int, parameter: Parameter) -> tuple[Entries, float]:
    """Entries with one shape of one of them moved, and the weighted square left."""
    entry = entries.regressors[k]
    shape = dict(entry.shape)
    value = shape[parameter.name]
    is_scale = parameter.low >= 0.0 and value > 0.0
    # a place or a time is moved by the width or the length of what is there
    span = shape.get("width_m", shape.get("duration_s", 0.1 * abs(parameter.faulty)))

    def trial(x: float) -> tuple[Entries, float]:
        wanted = value * float(np.exp(x)) if is_scale else value + x * span
        wanted = float(np.clip(wanted, parameter.low, parameter.high))
        changed = entries.with_shape(k, parameter.name, wanted)
        return changed, changed.solve().square

    factor = _FINE_REACH if entry.effect.follows_own_torque else _REACH
    reach = float(np.log(factor)) if is_scale else 1.0
    found = optimize.minimize_scalar(
        lambda x: trial(x)[1],
        bounds=(-reach, reach),
        method="bounded",
        options={"maxiter": _EVALUATIONS, "xatol": 0.01 * reach},
    )
    here, there = trial(0.0), trial(float(found.x))
    return there if there[1] < here[1] else here
