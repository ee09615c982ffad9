"""Named effects as entries of the library, with shapes and amounts of their own."""

import math
from collections.abc import Sequence

import numpy as np

from ...models.effects.registry import get_effect
from ..estimation.refine import Problem, refine
from ..selection.evidence import Fit, Noise
from ..selection.stepwise import pursue
from ..session.session import Session
from .design_matrix import Dictionary
from .force_pulses import Push
from .regressor import EntryAtom, entry_atom

MOST_ENTRIES = {
    **{"stribeck": 1, "backlash": 1, "presliding": 1},
    **{"compliance": 2, "thermal_growth": 2, "warmup": 2},
}
"""Entries of one effect that still say something: sums of many are no better known for it."""


def problem_of(session: Session, dictionary: Dictionary, best: Fit, noise: Noise) -> Problem:
    index = dictionary.indices(range(dictionary.tolerated))
    weights = {}
    for name, rows in session.channels.items():
        variance = best.rms[name] ** 2 + noise.discrepancy[name] ** 2
        weights[name] = math.sqrt(noise.effective[name] / len(rows.gap) / variance)
    return Problem(
        session,
        weights,
        {name: dictionary.columns[name][:, index].astype(np.float64) for name in session.channels},
        best.coefficients[: len(index)],
        1e9 * dictionary.precision[index],
        sum(noise.effective.values()),
    )


def entries_of(
    dictionary: Dictionary, noise: Noise, named: frozenset[str], problem: Problem, best: Fit
) -> list[EntryAtom]:
    """Entries of the library for the named effects, alone fitted, with refined shapes.

    Args:
        best: the best set, with all its forms.
    """
    allowed = [
        k
        for k in dictionary.candidates
        if dictionary.atoms[k].name in named and _as_entry(dictionary.atoms[k]) is not None
    ]
    known = sorted(set(best.atoms) & set(allowed))
    whole = pursue(dictionary, noise, allowed, problem.mean, MOST_ENTRIES, known)
    chosen: list[EntryAtom] = []
    for k in whole.atoms[dictionary.tolerated :]:
        entry = _as_entry(dictionary.atoms[k])
        if entry is not None and entry not in chosen:
            chosen.append(entry)
    for name in sorted(named - {atom.name for atom in chosen}):
        first = next(
            (e for k in allowed if (e := _as_entry(dictionary.atoms[k])) and e.name == name), None
        )
        if first is not None:
            chosen.append(first)
    return _within_bounds(problem, _ordered(refine(problem, _ordered(chosen))))


def _within_bounds(problem: Problem, atoms: list[EntryAtom]) -> list[EntryAtom]:
    """Without entries that only a sibling of the opposite sign keeps from leaving their bounds."""
    while True:
        columns = [problem.columns(atom) for atom in atoms]
        beta = problem.solve(atoms, columns)[0][len(problem.mean) :]
        first = np.cumsum([0, *(atom.size for atom in atoms)])
        names = [atom.name for atom in atoms]
        beyond = {
            k: _beyond(atom, float(np.hypot.reduce(beta[first[k] : first[k + 1]])))
            for k, atom in enumerate(atoms)
            if names.count(atom.name) > 1
        }
        worst = max(beyond, key=lambda k: beyond[k], default=None)
        if worst is None or beyond[worst] <= 1.0:
            return atoms
        atoms = [*atoms[:worst], *atoms[worst + 1 :]]


def _beyond(atom: EntryAtom, amount: float) -> float:
    """Amount over the bound on its size."""
    bound = next((p for p in atom.effect.parameters if p.name == atom.amount), None)
    return 0.0 if bound is None else abs(amount) / max(abs(bound.low), abs(bound.high), 1e-300)


def _as_entry(atom: object) -> EntryAtom | None:
    """The entry that stands for an atom in a machine file; None for a free form."""
    if isinstance(atom, EntryAtom):
        return atom
    if isinstance(atom, Push) and not atom.against_motion:
        shape = {"start_s": max(atom.start_s, 0.0), "duration_s": atom.end_s - atom.start_s}
        return entry_atom(get_effect("external_force"), "force_n", shape)
    return None


def _ordered(atoms: Sequence[EntryAtom]) -> list[EntryAtom]:
    return sorted(atoms, key=lambda atom: atom.name)
