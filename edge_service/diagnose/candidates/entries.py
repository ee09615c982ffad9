"""Named effects as entries of the library, with shapes and amounts of their own."""

import math
from collections.abc import Sequence

import numpy as np

from ...models.effects.registry import get_effect
from ..estimation.refine import Problem, refine
from ..selection.evidence import Fit, Noise
from ..selection.stepwise import select_stepwise
from ..session.session import Session
from .design_matrix import DesignMatrix
from .force_pulses import ForcePulse
from .regressor import EntryRegressor, entry_regressor


def problem_of(session: Session, design: DesignMatrix, best: Fit, noise: Noise) -> Problem:
    index = design.indices(range(design.tolerated))
    weights = {}
    for name, rows in session.channels.items():
        variance = best.rms[name] ** 2 + noise.discrepancy[name] ** 2
        weights[name] = math.sqrt(noise.effective[name] / len(rows.gap) / variance)
    return Problem(
        session,
        weights,
        {name: design.columns[name][:, index].astype(np.float64) for name in session.channels},
        best.coefficients[: len(index)],
        1e9 * design.precision[index],
        sum(noise.effective.values()),
    )


def entries_of(
    design: DesignMatrix, noise: Noise, named: frozenset[str], problem: Problem, best: Fit
) -> list[EntryRegressor]:
    """Entries of the library for the named effects, alone fitted, with refined shapes.

    Args:
        best: the best set, with all its forms.
    """
    allowed = [
        k
        for k in design.candidates
        if design.regressors[k].name in named and _as_entry(design.regressors[k]) is not None
    ]
    known = sorted(set(best.regressors) & set(allowed))
    whole = select_stepwise(design, noise, allowed, problem.mean, _most_entries, known)
    chosen: list[EntryRegressor] = []
    for k in whole.regressors[design.tolerated :]:
        entry = _as_entry(design.regressors[k])
        if entry is not None and entry not in chosen:
            chosen.append(entry)
    for name in sorted(named - {regressor.name for regressor in chosen}):
        first = next(
            (e for k in allowed if (e := _as_entry(design.regressors[k])) and e.name == name), None
        )
        if first is not None:
            chosen.append(first)
    return _within_bounds(problem, _ordered(refine(problem, _ordered(chosen))))


def _within_bounds(problem: Problem, regressors: list[EntryRegressor]) -> list[EntryRegressor]:
    """Without entries that only a sibling of the opposite sign keeps from leaving their bounds."""
    while True:
        columns = [problem.columns(regressor) for regressor in regressors]
        beta = problem.solve(regressors, columns)[0][len(problem.mean) :]
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
    """The entry that stands for a regressor in a machine file; None for an empirical shape."""
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
