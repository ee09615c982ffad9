"""The diagnosis of a session: the gap, where it lives, what causes it, and how far it shrinks."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from ..fingerprint.regression import effective_size
from ..messages.samples import Floats
from ..models.effects.effect import Effect
from ..models.effects.registry import effects
from ..models.machine import Machine
from .beside_force import beside_force
from .causes import Causes, find_causes
from .dictionary import Dictionary
from .entries import entries_of, problem_of
from .evidence import Fit, Noise, fit
from .free_forms import lone_forms
from .held_out import by_blocks
from .impostor import FORCE, Claim, claims, has_impostor
from .nameless import UNKNOWN, nameless_forms
from .next_motion import deciding_motion
from .replay import Replay, replay
from .session import TORQUE_GAP, TRANSMISSION_GAP, Session
from .shrink import Shrink, shrink_of
from .tolerance import Tolerated, limits_of, parameter_tolerances, tolerated
from .twin import HealthyGap
from .unknown import LEFT_OVER_FLOOR, Doubt, doubts_of, is_stretched, left_shares
from .values import Interval, Values
from .waterfall import channel_of, grouped, waterfall
from .where import Place, where

MOST_EFFECTIVE = 400.0
"""Independent observations that a channel counts for at most: the library is an approximation."""
DISCREPANCY = 0.05
"""Share of the gap that the best entry may still miss on a real axis."""
SURE = 0.9
BESIDE_NAMELESS = 0.8
"""Of the probability of an effect, where something that has no name is needed beside it."""
AT_BOUND = 0.5
"""The same of one whose shape would have to leave what the library allows."""
LEAST_GAIN = 0.004
"""Share of the gap's energy below which an effect is none, once impostors are gone."""
NEEDED_GAIN = 0.5
"""Share of the gap's energy from which on an effect counts although it shrinks no gap alone."""
LEAST_PROBABILITY = 0.02
"""What is less likely than this is not named at all."""


class Verdict(StrEnum):
    """The answer in a word."""

    NO_GAP = "no_gap"
    EXPLAINED = "explained"
    AMBIGUOUS = "ambiguous"
    UNKNOWN = "unknown"
    BAD_DATA = "bad_data"


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
    replay: Replay


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
        causes, left = beside_force(session, dictionary, noise, limits, causes)
    unexplained = left_shares(session, left, healthy, healthy.left)
    progress("values and held-out motion")
    named = causes.best.material - {UNKNOWN}
    return _concluded(session, machine, dictionary, noise, healthy, causes, unexplained, named)


def _prior(session: Session, machine: Machine) -> Sequence[Tolerated]:
    period_s = float(np.diff(session.runs[0].motion.time_s[:2])[0])
    return tolerated(machine, period_s, session.baseline.coulomb_nm)


def _prepared(
    session: Session, machine: Machine, healthy: HealthyGap, entries: Sequence[Effect]
) -> tuple[Dictionary, Noise]:
    prior = _prior(session, machine)
    searched = [each for each in entries if each.name != "external_force"]
    dictionary = Dictionary.of_session(session, prior, searched)
    dictionary = dictionary.with_atoms(session, list(nameless_forms(session)))
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


def _concluded(
    session: Session,
    machine: Machine,
    dictionary: Dictionary,
    noise: Noise,
    healthy: HealthyGap,
    causes: Causes,
    unexplained: Mapping[str, float],
    named: frozenset[str],
) -> Diagnosis:
    """The answer that names these effects, or those of them that are no impostors."""
    problem = problem_of(session, dictionary, causes.best.fit, noise)
    atoms = entries_of(dictionary, noise, named, problem)
    columns = [problem.columns(atom) for atom in atoms]
    beta, covariance, square = problem.solve(atoms, columns)
    values = Values(
        limits_of(_prior(session, machine)),
        problem,
        tuple(atoms),
        tuple(columns),
        beta,
        covariance,
        square,
    )
    groups = grouped(atoms, columns)
    blocks = by_blocks(values)
    parts = {name: _part(session, name, values) for name in groups}
    left = {
        name: rows.gap - sum((each[name] for each in parts.values()), np.zeros(len(rows.gap)))
        for name, rows in session.channels.items()
    }
    rest = {name: each - problem.fixed[name] @ problem.mean for name, each in left.items()}
    entry_rms = {name: float(np.sqrt(np.mean(each**2))) for name, each in left.items()}
    places = [channel_of(session, name, groups[name], atoms, values) for name in groups]
    by_entries = left_shares(session, entry_rms, healthy, healthy.before)
    claimed = {name: share for name, share in by_entries.items() if name in places}
    doubts = doubts_of(session, unexplained, claimed, len(named))
    is_open = TORQUE_GAP in doubts and _exceeds_floor(session, healthy, (TORQUE_GAP,))
    if is_open and is_stretched(dictionary, causes.best.fit, _parameters(machine), named):
        doubts[TORQUE_GAP] = Doubt(is_unknown=True, confidence=0.5)
    claimed_by = dict(zip(groups, places, strict=True))
    beside = BESIDE_NAMELESS if UNKNOWN in causes.best.material else 1.0
    formed = {
        name: rows.gap
        - dictionary.modelled(name, causes.best.fit.atoms, causes.best.fit.coefficients)
        for name, rows in session.channels.items()
    }
    claim_of = claims(session, parts, rest, formed, unexplained, claimed_by)
    trust = {
        name: beside * each.trust * (AT_BOUND if values.is_at_bound(name) else 1.0)
        for name, each in claim_of.items()
    }
    is_unknown = UNKNOWN in causes.best.material or has_impostor(claim_of, claimed_by)
    is_unknown |= any(doubt.is_unknown for doubt in doubts.values())
    suspects = sorted(causes.best.material - {UNKNOWN})
    is_unknown |= bool(suspects) and not named and _exceeds_floor(session, healthy)
    found = []
    for name, channel in zip(groups, places, strict=True):
        shrink = shrink_of(session.channels[channel], name, channel, values, blocks)
        found.append(
            NamedEffect(
                name,
                channel,
                causes.probability[name] * trust[name] * _confidence(doubts, groups[name]),
                causes.classes[name],
                shrink,
                values.parameters(name),
                values.entries(name),
            )
        )
    kept = frozenset(each.name for each in found if _is_cause(each, claim_of[each.name]))
    if len(kept) < len(found):
        return _concluded(session, machine, dictionary, noise, healthy, causes, unexplained, kept)
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
    floors = {name: each.noise_floor for name, each in gap.items()}
    replayed = replay(machine, blocks, dict(zip(groups, places, strict=True)), floors)
    tied = {n for each in found for n in each.tied}
    return Diagnosis(
        verdict,
        gap,
        tuple(where(session.channels, floors)),
        tuple(where({n: replace(r, gap=left[n]) for n, r in session.channels.items()}, floors)),
        tuple(found),
        max(unexplained.values(), default=0.0),
        deciding_motion(tied) if verdict is Verdict.AMBIGUOUS else None,
        left,
        waterfall(session, groups, atoms, columns, values),
        _nearest(found, suspects) if is_unknown else None,
        causes,
        replayed,
    )


def _part(session: Session, name: str, values: Values) -> dict[str, Floats]:
    """What the entries of an effect make of the gap, by channel."""
    mine = [k for k, atom in enumerate(values.atoms) if atom.name == name]
    return {
        channel: sum(
            (values.columns[k][channel] @ values.coefficients(k) for k in mine),
            np.zeros(len(rows.gap)),
        )
        for channel, rows in session.channels.items()
    }


def _confidence(doubts: Mapping[str, Doubt], columns: Mapping[str, Floats]) -> float:
    """The least of all channels that an effect shows in: it must be right in each of them."""
    shown = [doubts[name].confidence for name, each in columns.items() if np.any(each)]
    return min(shown, default=1.0)


def _nearest(found: Sequence[NamedEffect], suspects: Sequence[str]) -> str | None:
    """What comes nearest to a cause that nobody knows, even where it was refused."""
    return next(iter([*(each.name for each in found), *suspects]), None)


def _is_cause(each: NamedEffect, claim: Claim) -> bool:
    """Not what makes the gap greater, unless others hide it, or it is a force."""
    if each.name == FORCE:
        return True
    is_likely = each.probability >= LEAST_PROBABILITY and claim.gain >= LEAST_GAIN
    return is_likely and (each.shrink.high > 0.0 or claim.gain > NEEDED_GAIN)


def _exceeds_floor(
    session: Session, healthy: HealthyGap, channels: Sequence[str] = (TORQUE_GAP, TRANSMISSION_GAP)
) -> bool:
    return any(
        session.channels[name].rms > LEFT_OVER_FLOOR * float(np.median(healthy.before[name]))
        for name in channels
        if name in session.channels
    )


def _parameters(machine: Machine) -> frozenset[str]:
    return frozenset(name for name, sigma in parameter_tolerances(machine).items() if sigma > 0.0)


def _verdict(found: Sequence[NamedEffect], *, is_unknown: bool) -> Verdict:
    if is_unknown:
        return Verdict.UNKNOWN
    if not found:
        return Verdict.NO_GAP
    if any(each.probability < SURE or len(each.tied) > 1 for each in found):
        return Verdict.AMBIGUOUS
    return Verdict.EXPLAINED
