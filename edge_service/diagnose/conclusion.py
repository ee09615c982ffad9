"""From weighed sets of effects to an answer: which are impostors, how sure, how far it shrinks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..messages.samples import Floats
from ..models.machine import Machine
from .answer import ChannelGap, Diagnosis, NamedEffect, Verdict, verdict_of
from .explained import Explained, Weighed, explained
from .impostor import FORCE, Claim, claims, has_impostor
from .nameless import UNKNOWN
from .replay import replay
from .session import CHANNEL_UNITS, TORQUE_GAP
from .shrink import shrink_of
from .tolerance import parameter_tolerances
from .unknown import LEFT_OVER_FLOOR, Doubt, doubts_of, is_stretched, left_shares
from .waterfall import waterfall
from .where import where

BESIDE_NAMELESS = 0.8
"""Of the probability of an effect, where something that has no name is needed beside it."""
AT_BOUND = 0.5
"""The same of one whose shape would have to leave what the library allows."""
LEAST_GAIN = 0.004
"""Share of the gap's energy below which an effect is none, once impostors are gone."""
NEEDED_GAIN = 0.5
"""Share of the gap's energy from which on an effect counts although it shrinks no gap alone."""
LEAST_PROBABILITY = 0.02
"""Probability below which an effect is not named at all."""
ALL_MOTIONS = "full"
"""Motion that decides what none shorter is known to decide."""


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """Named effects, held against what they leave.

    Attributes:
        claims: effect -> what it has in its channel.
        doubts: by channel.
    """

    entries: Explained
    claims: Mapping[str, Claim]
    doubts: Mapping[str, Doubt]
    effects: tuple[NamedEffect, ...]


def concluded(weighed: Weighed) -> Diagnosis:
    """The answer that names the material effects, or those of them that are no impostors."""
    named = weighed.causes.best.material - {UNKNOWN}
    while True:
        judged = _judged(weighed, named)
        kept = frozenset(
            each.name for each in judged.effects if _is_cause(each, judged.claims[each.name])
        )
        if len(kept) == len(judged.effects):
            return _answer(weighed, judged, named)
        named = kept


def _judged(weighed: Weighed, named: frozenset[str]) -> Judged:
    entries = explained(weighed, named)
    claim_of = claims(
        weighed.session,
        entries.parts,
        entries.left_of_tolerated(),
        weighed.left_by_forms(),
        weighed.unexplained,
        entries.channel_of,
    )
    doubts = _doubts(weighed, entries, named)
    found = tuple(
        _named(weighed, entries, name, doubts, claim_of[name]) for name in entries.columns
    )
    return Judged(entries, claim_of, doubts, found)


def _doubts(weighed: Weighed, entries: Explained, named: frozenset[str]) -> dict[str, Doubt]:
    """The doubt in each channel."""
    session, healthy = weighed.session, weighed.healthy
    by_entries = left_shares(session, entries.left_rms(), healthy, healthy.before)
    places = set(entries.channel_of.values())
    claimed = {name: share for name, share in by_entries.items() if name in places}
    doubts = doubts_of(session, weighed.unexplained, claimed, len(named))
    is_open = TORQUE_GAP in doubts and _exceeds_floor(weighed, (TORQUE_GAP,))
    best, parameters = weighed.causes.best.fit, _parameters(weighed.machine)
    if is_open and is_stretched(weighed.dictionary, best, parameters, named):
        doubts[TORQUE_GAP] = Doubt(is_unknown=True, confidence=0.5)
    return doubts


def _named(
    weighed: Weighed, entries: Explained, name: str, doubts: Mapping[str, Doubt], claim: Claim
) -> NamedEffect:
    """An effect with the probability that it has in the light of its claim."""
    causes, values, channel = weighed.causes, entries.values, entries.channel_of[name]
    trust = BESIDE_NAMELESS if UNKNOWN in causes.best.material else 1.0
    trust = trust * claim.trust * (AT_BOUND if values.is_at_bound(name) else 1.0)
    rows = weighed.session.channels[channel]
    return NamedEffect(
        name,
        channel,
        causes.probability[name] * trust * _confidence(doubts, entries.columns[name]),
        causes.classes[name],
        shrink_of(rows, name, channel, values, entries.blocks),
        values.parameters(name),
        values.entries(name),
    )


def _confidence(doubts: Mapping[str, Doubt], columns: Mapping[str, Floats]) -> float:
    """The least of all channels that an effect shows in: it must be right in each of them."""
    shown = [doubts[name].confidence for name, each in columns.items() if np.any(each)]
    return min(shown, default=1.0)


def _is_cause(each: NamedEffect, claim: Claim) -> bool:
    """Not what makes the gap greater, unless others hide it, or it is a force."""
    if each.name == FORCE:
        return True
    is_likely = each.probability >= LEAST_PROBABILITY and claim.gain >= LEAST_GAIN
    return is_likely and (each.shrink.high > 0.0 or claim.gain > NEEDED_GAIN)


def _answer(weighed: Weighed, judged: Judged, named: frozenset[str]) -> Diagnosis:
    channels, entries = weighed.session.channels, judged.entries
    found = sorted(judged.effects, key=lambda each: (-each.probability, -each.shrink.estimate))
    is_unknown = _is_unknown(weighed, judged, named)
    verdict = verdict_of(found, is_unknown=is_unknown)
    gap = _gap(weighed, entries)
    floors = {name: each.noise_floor for name, each in gap.items()}
    after = {name: replace(rows, gap=entries.left[name]) for name, rows in channels.items()}
    return Diagnosis(
        verdict,
        gap,
        tuple(where(channels, floors)),
        tuple(where(after, floors)),
        tuple(found),
        max(weighed.unexplained.values(), default=0.0),
        ALL_MOTIONS if verdict is Verdict.AMBIGUOUS else None,
        entries.left,
        waterfall(weighed.session, entries.parts),
        _nearest(found, _suspects(weighed)) if is_unknown else None,
        weighed.causes,
        replay(weighed.machine, entries.blocks, entries.channel_of, floors),
    )


def _is_unknown(weighed: Weighed, judged: Judged, named: frozenset[str]) -> bool:
    """Tell whether something that the library lacks is the better part of the cause."""
    return (
        UNKNOWN in weighed.causes.best.material
        or has_impostor(judged.claims, judged.entries.channel_of)
        or any(doubt.is_unknown for doubt in judged.doubts.values())
        or (bool(_suspects(weighed)) and not named and _exceeds_floor(weighed))
    )


def _suspects(weighed: Weighed) -> list[str]:
    return sorted(weighed.causes.best.material - {UNKNOWN})


def _nearest(found: Sequence[NamedEffect], suspects: Sequence[str]) -> str | None:
    """Nearest effect to a cause that nobody knows, even where it was refused."""
    return next(iter([*(each.name for each in found), *suspects]), None)


def _gap(weighed: Weighed, entries: Explained) -> dict[str, ChannelGap]:
    after, floors = entries.left_rms(), weighed.healthy.before
    return {
        name: ChannelGap(rows.rms, after[name], float(np.median(floors[name])), CHANNEL_UNITS[name])
        for name, rows in weighed.session.channels.items()
    }


def _exceeds_floor(weighed: Weighed, channels: Sequence[str] = tuple(CHANNEL_UNITS)) -> bool:
    recorded = weighed.session.channels
    return any(
        recorded[name].rms > LEFT_OVER_FLOOR * float(np.median(weighed.healthy.before[name]))
        for name in channels
        if name in recorded
    )


def _parameters(machine: Machine) -> frozenset[str]:
    return frozenset(name for name, sigma in parameter_tolerances(machine).items() if sigma > 0.0)
