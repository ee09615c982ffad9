"""Named effects as entries of the library, with shapes and amounts of their own."""

from collections.abc import Sequence

import numpy as np

from ...models.effects.registry import get_effect
from ..candidates.force_pulses import ForcePulse
from ..candidates.regressor import EntryRegressor, entry_regressor
from ..selection.problem import Fit, SelectionProblem
from ..selection.stepwise import select_stepwise
from .least_squares import WeightedLeastSquares
from .refine import refine


def entries_of(
    problem: SelectionProblem,
    best: Fit,
    named: frozenset[str],
    system: WeightedLeastSquares,
) -> list[EntryRegressor]:
    """Entries of the library for the named effects, fitted alone, with refined shapes.

    Args:
        best: the best set, with all its shapes.
    """
    regressors = problem.design.regressors
    entries = {
        k: entry
        for k in problem.design.of_effects(named)
        if (entry := _as_entry(regressors[k])) is not None
    }
    known = sorted(set(best.regressors) & entries.keys())
    whole = select_stepwise(problem.pinned_to(best), list(entries), _most_entries, known)
    chosen: list[EntryRegressor] = []
    for k in whole.chosen:
        if entries[k] not in chosen:
            chosen.append(entries[k])
    for name in sorted(named - {each.name for each in chosen}):
        chosen += [each for each in entries.values() if each.name == name][:1]
    return _within_bounds(system, _ordered(refine(system, _ordered(chosen))))


def _within_bounds(
    system: WeightedLeastSquares, regressors: list[EntryRegressor]
) -> list[EntryRegressor]:
    """Drop entries that only a sibling of the opposite sign keeps from leaving their bounds."""
    while True:
        columns = [system.columns(regressor) for regressor in regressors]
        beta = system.solve(regressors, columns)[0][len(system.mean) :]
        first = np.cumsum([0, *(regressor.size for regressor in regressors)])
        names = [regressor.name for regressor in regressors]
        beyond = {
            k: _beyond(regressor, float(np.hypot.reduce(beta[first[k] : first[k + 1]])))
            for k, regressor in enumerate(regressors)
            if names.count(regressor.name) > 1
        }
        worst = max(beyond, key=lambda k: beyond[k], default=None)
        if worst is None or beyond[worst] <= 1.0:
            return regressors
        regressors = [*regressors[:worst], *regressors[worst + 1 :]]


def _beyond(regressor: EntryRegressor, amount: float) -> float:
    """Amount over the bound on its size."""
    bound = next((p for p in regressor.effect.parameters if p.name == regressor.amount), None)
    return 0.0 if bound is None else abs(amount) / max(abs(bound.low), abs(bound.high), 1e-300)


def _as_entry(regressor: object) -> EntryRegressor | None:
    """Entry that stands for a regressor in a machine file; None for an empirical shape."""
    if isinstance(regressor, EntryRegressor):
        return regressor
    if isinstance(regressor, ForcePulse) and not regressor.against_motion:
        shape = {
            "start_s": max(regressor.start_s, 0.0),
            "duration_s": regressor.end_s - regressor.start_s,
        }
        return entry_regressor(get_effect(regressor.name), "force_n", shape)
    return None


def _most_entries(name: str) -> int:
    return get_effect(name).most_entries


def _ordered(regressors: Sequence[EntryRegressor]) -> list[EntryRegressor]:
    return sorted(regressors, key=lambda regressor: regressor.name)
