"""The diagnosis of a session: the gap, where it lives, what causes it, and how far it shrinks."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from ..fingerprint.regression import effective_size
from ..messages.samples import Floats
from ..models.effects.effect import Effect
from ..models.effects.registry import effects, get_effect
from ..models.machine import Machine
from .atoms import EntryAtom, entry_atom
from .causes import Candidate, Causes, find_causes
from .dictionary import Dictionary
from .evidence import Fit, Noise, fit
from .free_forms import Push, lone_forms
from .next_motion import deciding_motion
from .pursuit import pursue
from .refine import Problem, refine, strict_columns
from .session import TORQUE_GAP, TRANSMISSION_GAP, Session
from .shrink import Shrink, held_out, shrink_of
from .tolerance import Tolerated, limits_of, tolerated
from .twin import HealthyGap
from .where import Place, where

MOST_EFFECTIVE = 400.0
"""Independent observations that a channel counts for at most: the library is an approximation."""
DISCREPANCY = 0.05
"""Share of the gap that the best entry may still miss on a real axis."""
UNKNOWN_SHARE = 0.15
"""Share of the gap's energy above the floor; with more left over, the named effects are doubted."""
LEFT_OVER_FLOOR = 1.5
"""What is left counts from this many healthy floors on."""
SURE = 0.9
LEAST_FREE_SHARE = 0.3
"""Share of the motion that must be free of a force for other causes to be sought there alone."""
MOST_CAUSES = 3
"""It takes more than this many causes at once only where none of them is the true one."""


class Verdict(StrEnum):
    """The answer in a word."""

    NO_GAP = "no_gap"
    EXPLAINED = "explained"
    AMBIGUOUS = "ambiguous"
    UNKNOWN = "unknown"
    BAD_DATA = "bad_data"


@dataclass(frozen=True, slots=True)
class Interval:
    """A value with its 90 % interval."""

    value: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True, slots=True)
class NamedEffect:
    """A cause.

    Attributes:
        entries: values of the effect, one set for each time that it is there.
        parameters: of its strongest entry.
    """

    name: str
    channel: str
    probability: float
    tied: tuple[str, ...]
    shrink: Shrink
    parameters: Mapping[str, Interval]
    entries: tuple[Mapping[str, float], ...]


@dataclass(frozen=True, slots=True)
class ChannelGap:
    """Root mean squares of one channel."""

    before: float
    after: float
    noise_floor: float
    unit: str


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """Everything that is said of a session."""

    verdict: Verdict
    gap: Mapping[str, ChannelGap]
    where: tuple[Place, ...]
    where_after: tuple[Place, ...]
    effects: tuple[NamedEffect, ...]
    unexplained: float
    next_motion: str | None
    left: Mapping[str, Floats]
    waterfall: Mapping[str, Sequence[tuple[str, float]]]
    impostor: str | None
    causes: Causes


def diagnose_session(
    session: Session,
    machine: Machine,
    healthy: HealthyGap,
    library: Sequence[Effect] | None = None,
    progress: Callable[[str], None] = lambda _line: None,
) -> Diagnosis:
    """Diagnose one session.

    Args:
        healthy: gaps of healthy twins on the same motion.
        library: entries that may be named; all of them unless given.
    """
    entries = tuple(effects().values()) if library is None else tuple(library)
    progress("signatures of the library")
    dictionary, noise = _prepared(session, machine, healthy, entries)
    progress("sets of effects")
    limits = limits_of(_prior(session, machine))
    causes = find_causes(dictionary, noise, limits)
    noise = _renoised(session, dictionary, causes.best.fit, noise)
    causes = find_causes(dictionary, noise, limits)
    left = dict(causes.best.fit.rms)
    if "external_force" in causes.best.material:
        causes, left = _beside_force(session, dictionary, noise, limits, causes)
    unexplained = _unexplained(session, left, healthy)
    progress("values and held-out motion")
    return _concluded(session, machine, dictionary, noise, healthy, causes, unexplained)


def _prior(session: Session, machine: Machine) -> Sequence[Tolerated]:
    period_s = float(np.diff(session.runs[0].motion.time_s[:2])[0])
    return tolerated(machine, period_s, session.baseline.coulomb_nm)


def _prepared(
    session: Session, machine: Machine, healthy: HealthyGap, entries: Sequence[Effect]
) -> tuple[Dictionary, Noise]:
    prior = _prior(session, machine)
    searched = [each for each in entries if each.name != "external_force"]
    dictionary = Dictionary.of_session(session, prior, searched)
    noise = Noise(
        floor={name: float(np.median(healthy.before[name])) for name in session.channels},
        effective=dict.fromkeys(session.channels, MOST_EFFECTIVE),
        discrepancy={name: DISCREPANCY * rows.rms for name, rows in session.channels.items()},
    )
    if TORQUE_GAP in session.channels and len(searched) < len(entries):
        bare = fit(dictionary, (), noise)
        left = session.channels[TORQUE_GAP].gap - dictionary.modelled(
            TORQUE_GAP, bare.atoms, bare.coefficients
        )
        dictionary = dictionary.with_atoms(session, lone_forms(session, left))
    return dictionary, noise


def _renoised(session: Session, dictionary: Dictionary, best: Fit, noise: Noise) -> Noise:
    """The noise with as many independent observations as the residual of the best fit has."""
    effective = {}
    for name, rows in session.channels.items():
        left = rows.gap - dictionary.modelled(name, best.atoms, best.coefficients)
        effective[name] = float(np.clip(effective_size(left), 40.0, MOST_EFFECTIVE))
    return replace(noise, effective=effective)


def _beside_force(
    session: Session,
    dictionary: Dictionary,
    noise: Noise,
    limits: Mapping[str, tuple[float, float]],
    causes: Causes,
) -> tuple[Causes, dict[str, float]]:
    """Other causes from the motion that no force disturbs: a force hides and feigns them.

    Returns the causes, and what is left outside the force.
    """
    whole = causes.best.fit
    pushes = [a for a in whole.atoms if isinstance(dictionary.atoms[a], Push)]
    free = {name: np.ones(len(rows.gap), np.bool_) for name, rows in session.channels.items()}
    for push in (dictionary.atoms[a] for a in pushes):
        for name, rows in session.channels.items():
            if isinstance(push, Push):
                free[name] &= ~push.covers(rows.variables["time_s"])
    if min(float(each.mean()) for each in free.values()) < LEAST_FREE_SHARE:
        return causes, dict(whole.rms)
    first = next(k for k, atom in enumerate(dictionary.atoms) if isinstance(atom, Push))
    calm = find_causes(dictionary.restricted(first, session, free), noise, limits)
    beside = calm.best.fit
    tolerated_beta = beside.coefficients[: int(dictionary.first[dictionary.tolerated])]
    chosen = [*beside.atoms[dictionary.tolerated :], *pushes]
    both = Candidate(
        fit(dictionary, chosen, noise, tolerated_beta), calm.best.material | {"external_force"}
    )
    return (
        Causes(
            both,
            {**calm.probability, "external_force": causes.probability["external_force"]},
            {**calm.classes, "external_force": causes.classes["external_force"]},
            calm.candidates,
        ),
        dict(beside.rms),
    )


def _unexplained(
    session: Session, left_rms: Mapping[str, float], healthy: HealthyGap
) -> dict[str, float]:
    """Share of each channel's energy above the floor that is left, `left_rms` by channel."""
    found = {}
    for name, rows in session.channels.items():
        floor = float(np.median(healthy.left[name]))
        above = rows.rms**2 - float(np.median(healthy.before[name])) ** 2
        over = left_rms[name] > LEFT_OVER_FLOOR * floor
        left = left_rms[name] ** 2 - floor**2
        found[name] = min(max(left / above, 0.0), 1.0) if over and above > 0.0 else 0.0
    return found


def _concluded(
    session: Session,
    machine: Machine,
    dictionary: Dictionary,
    noise: Noise,
    healthy: HealthyGap,
    causes: Causes,
    unexplained: Mapping[str, float],
) -> Diagnosis:
    named = causes.best.material
    is_unknown = _is_unknown(session, noise, unexplained) or len(named) > MOST_CAUSES
    problem = _problem(session, dictionary, causes.best.fit, noise)
    atoms = _entries_of(dictionary, noise, named, problem)
    columns = [problem.columns(atom) for atom in atoms]
    beta, covariance, _ = problem.solve(atoms, columns)
    values = _Values(
        tuple(limits_of(_prior(session, machine))), problem, tuple(atoms), beta, covariance
    )
    groups = _grouped(atoms, columns)
    sizes = [sum(atom.size for atom in atoms if atom.name == name) for name in groups]
    predicted = held_out(problem, sizes, list(groups.values()), strict_columns(atoms))
    modelled = {
        name: sum(
            (columns[k][name] @ values.coefficients(k) for k in range(len(atoms))),
            np.zeros(len(rows.gap)),
        )
        for name, rows in session.channels.items()
    }
    left = {name: rows.gap - modelled[name] for name, rows in session.channels.items()}
    found = []
    for k, name in enumerate(groups):
        channel = _channel_of(session, name, groups[name], atoms, values)
        shrink = shrink_of(session.channels[channel], predicted[channel][:, k])
        doubt = 1.0 - max(unexplained.values()) if is_unknown else 1.0
        found.append(
            NamedEffect(
                name,
                channel,
                causes.probability[name] * (0.5 * doubt if is_unknown else 1.0),
                causes.classes[name],
                shrink,
                values.parameters(name),
                values.entries(name),
            )
        )
    found.sort(key=lambda each: (-each.probability, -each.shrink.estimate))
    gap = {
        name: ChannelGap(
            rows.rms,
            float(np.sqrt(np.mean(left[name] ** 2))),
            float(np.median(healthy.before[name])),
            {TORQUE_GAP: "N m", TRANSMISSION_GAP: "m"}[name],
        )
        for name, rows in session.channels.items()
    }
    verdict = _verdict(found, is_unknown=is_unknown)
    tied = {n for each in found for n in each.tied}
    return Diagnosis(
        verdict,
        gap,
        tuple(where(session.channels)),
        tuple(where({n: replace(r, gap=left[n]) for n, r in session.channels.items()})),
        tuple(found),
        max(unexplained.values(), default=0.0),
        deciding_motion(tied) if verdict is Verdict.AMBIGUOUS else None,
        left,
        _waterfall(session, groups, atoms, columns, values),
        found[0].name if is_unknown and found else None,
        causes,
    )


def _is_unknown(session: Session, noise: Noise, unexplained: Mapping[str, float]) -> bool:
    return any(
        share > UNKNOWN_SHARE and session.channels[name].rms > 1.2 * noise.floor[name]
        for name, share in unexplained.items()
    )


def _verdict(found: Sequence[NamedEffect], *, is_unknown: bool) -> Verdict:
    if is_unknown:
        return Verdict.UNKNOWN
    if not found:
        return Verdict.NO_GAP
    if any(each.probability < SURE or len(each.tied) > 1 for each in found):
        return Verdict.AMBIGUOUS
    return Verdict.EXPLAINED


def _problem(session: Session, dictionary: Dictionary, best: Fit, noise: Noise) -> Problem:
    index = dictionary.indices(range(dictionary.tolerated))
    weights = {}
    for name, rows in session.channels.items():
        variance = best.rms[name] ** 2 + noise.discrepancy[name] ** 2
        weights[name] = math.sqrt(noise.effective[name] / len(rows.gap) / variance)
    return Problem(
        session,
        weights,
        {name: dictionary.columns[name][:, index] for name in session.channels},
        best.coefficients[: len(index)],
        1e9 * dictionary.precision[index],
    )


def _entries_of(
    dictionary: Dictionary, noise: Noise, named: frozenset[str], problem: Problem
) -> list[EntryAtom]:
    """Entries of the library for the named effects, alone fitted, with refined shapes."""
    allowed = [
        k
        for k in dictionary.candidates
        if dictionary.atoms[k].name in named and _as_entry(dictionary.atoms[k]) is not None
    ]
    whole = pursue(dictionary, noise, allowed, problem.mean)
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
    return _ordered(refine(problem, _ordered(chosen)))


def _as_entry(atom: object) -> EntryAtom | None:
    """The entry that stands for an atom in a machine file; None for a free form."""
    if isinstance(atom, EntryAtom):
        return None if atom.load_share not in (None, 1.0) else replace(atom, load_share=None)
    if isinstance(atom, Push) and not atom.against_motion:
        shape = {"start_s": max(atom.start_s, 0.0), "duration_s": atom.end_s - atom.start_s}
        return entry_atom(get_effect("external_force"), "force_n", shape)
    return None


def _ordered(atoms: Sequence[EntryAtom]) -> list[EntryAtom]:
    return sorted(atoms, key=lambda atom: atom.name)


def _grouped(
    atoms: Sequence[EntryAtom], columns: Sequence[Mapping[str, Floats]]
) -> dict[str, dict[str, Floats]]:
    """Columns of each effect by channel, in the order of the atoms."""
    found: dict[str, dict[str, Floats]] = {}
    for atom, each in zip(atoms, columns, strict=True):
        mine = found.setdefault(atom.name, {})
        for channel, column in each.items():
            mine[channel] = np.column_stack((mine[channel], column)) if channel in mine else column
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _Values:
    """Coefficients of entries; a parameter's tolerated part belongs to its effect."""

    tolerated: tuple[str, ...]
    problem: Problem
    atoms: tuple[EntryAtom, ...]
    beta: Floats
    covariance: Floats

    def _place(self, k: int) -> slice:
        start = len(self.problem.mean) + sum(atom.size for atom in self.atoms[:k])
        return slice(start, start + self.atoms[k].size)

    def coefficients(self, k: int) -> Floats:
        """Of one atom, bounded as the library bounds its amount."""
        found = self.beta[self._place(k)].copy()
        atom = self.atoms[k]
        if atom.name in self.tolerated:
            found[0] += self.beta[self.tolerated.index(atom.name)]
        bound = next((p for p in atom.effect.parameters if p.name == atom.amount), None)
        if bound is not None and atom.size == 1:
            found = np.clip(found, bound.low, bound.high)
        return found

    def entries(self, name: str) -> tuple[dict[str, float], ...]:
        """Complete values of an effect, once for each time it is there."""
        return tuple(
            atom.values(self.coefficients(k))
            for k, atom in enumerate(self.atoms)
            if atom.name == name
        )

    def parameters(self, name: str) -> dict[str, Interval]:
        """Values of the strongest entry with the intervals that the fit gives.

        A parameter whose error is not estimated (a shape, a phase) gets all that its bounds allow.
        """
        mine = [k for k, atom in enumerate(self.atoms) if atom.name == name]
        if not mine:
            return {}
        k = max(mine, key=lambda each: float(np.abs(self.coefficients(each)).max()))
        atom = self.atoms[k]
        values = atom.values(self.coefficients(k))
        place = self._place(k)
        sigma = math.sqrt(max(float(np.diag(self.covariance)[place].max()), 0.0))
        shown = {}
        for parameter in atom.effect.parameters:
            value = values[parameter.name]
            if parameter.name == atom.amount:
                low, high = value - 1.645 * sigma, value + 1.645 * sigma
            elif value != 0.0:
                low, high = parameter.low, parameter.high
            else:
                continue
            shown[parameter.name] = Interval(value, low, high, parameter.unit)
        return shown


def _channel_of(
    session: Session,
    name: str,
    columns: Mapping[str, Floats],
    atoms: Sequence[EntryAtom],
    values: _Values,
) -> str:
    """The channel of which an effect makes the greater part."""
    beta = np.concatenate([values.coefficients(k) for k, a in enumerate(atoms) if a.name == name])
    return max(
        session.channels,
        key=lambda channel: (
            float(np.mean((columns[channel] @ beta) ** 2)) / session.channels[channel].rms ** 2
        ),
    )


def _waterfall(
    session: Session,
    groups: Mapping[str, Mapping[str, Floats]],
    atoms: Sequence[EntryAtom],
    columns: Sequence[Mapping[str, Floats]],
    values: _Values,
) -> dict[str, list[tuple[str, float]]]:
    """Root mean square as effects are added, the most helpful first, by channel."""
    parts = {
        name: {
            channel: sum(
                (
                    columns[k][channel] @ values.coefficients(k)
                    for k, atom in enumerate(atoms)
                    if atom.name == name
                ),
                np.zeros(len(session.channels[channel].gap)),
            )
            for channel in session.channels
        }
        for name in groups
    }
    found: dict[str, list[tuple[str, float]]] = {}
    for channel, rows in session.channels.items():
        left, open_, steps = rows.gap, set(parts), []
        while open_:
            rest = left
            name = min(sorted(open_), key=lambda n: float(np.sum((rest - parts[n][channel]) ** 2)))
            left = left - parts[name][channel]
            open_.remove(name)
            steps.append((name, float(np.sqrt(np.mean(left**2)))))
        found[channel] = steps
    return found
