"""Verdict from selected effects: misattributions, probabilities and shrinkage of each."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...messages.samples import Floats
from ...models.machine import Machine
from ..candidates.force_pulses import FORCE
from ..candidates.null_shapes import UNKNOWN
from ..estimation.contributions import Contributions, SelectedModel, contributions_of
from ..estimation.waterfall import waterfall
from ..localisation.places import where
from ..result import ChannelGap, Diagnosis, NamedEffect, Verdict, verdict_of
from ..selection.posterior import without
from ..session.healthy_prior import parameter_tolerances
from ..session.session import CHANNEL_UNITS, TORQUE_GAP
from .caveats import caveats_of, is_blind, torque_rms_nm
from .misattribution import Attribution, attributions, is_misattributed
from .replay import replay
from .shrink import shrink_of
from .unexplained import Doubt, doubts_of, is_stretched, unexplained_shares

BESIDE_UNNAMED = 0.8
"""Of the probability of an effect, where something that has no name is needed beside it."""
AT_BOUND = 0.5
"""The same of one whose shape would have to leave what the library allows."""
LEAST_SHRINK = 0.04
"""Of what the other causes leave, on motion that was not fitted: with less an effect is no cause.
"""
LESSER_PART = 0.5
"""Of the gap's energy that is left by a force: with more, the force is not what it is about."""
BLIND_TRUST = 0.5
"""Of the probability of an effect in a torque that is mostly noise: some entry follows noise."""
SUREST = 0.99
"""Probability beyond which nothing was shown to be known: of 195 names above .9 on real machines
with errors added and on the benchmark beside the checkout 194 were right (Laplace: 195 of 197)."""
LEAST_PROBABILITY = 0.02
"""Probability below which an effect is not named at all."""
ALL_MOTIONS = "full"
"""Motion that decides what none shorter is known to decide."""


@dataclass(frozen=True, slots=True, eq=False)
class Assessment:
    """Named effects, held against what they leave.

    Attributes:
        attributions: effect -> what it has in its channel.
        doubts: by channel.
    """

    entries: Contributions
    attributions: Mapping[str, Attribution]
    doubts: Mapping[str, Doubt]
    effects: tuple[NamedEffect, ...]


def conclude(selected: SelectedModel) -> Diagnosis:
    """The answer that names the material effects, or those of them that are no misattributions."""
    named = selected.posterior.best.material - {UNKNOWN}
    suspects: dict[str, float] = {}
    while True:
        assessment = _assessed(selected, named)
        for name, attribution in assessment.attributions.items():
            suspects.setdefault(name, attribution.structure)
        idle = _idlest(assessment, named)
        if not idle:
            return _result(selected, assessment, named, suspects)
        calmer = without(selected.posterior, FORCE) if idle == FORCE else None
        if calmer is None:
            named = named - {idle}
        else:
            left = unexplained_shares(selected.session, calmer.best.fit.rms, selected.noise)
            selected = replace(selected, posterior=calmer, unexplained=left)
            named = calmer.best.material - {UNKNOWN}


def _idlest(assessment: Assessment, named: frozenset[str]) -> str:
    """The one named effect that is least of a cause; empty where all are causes.

    One at a time: what two effects share is lost only with both. A force that is none hides what
    else there is: without it all sets are weighed anew.
    """
    if FORCE in named and all(each.name != FORCE for each in assessment.effects):
        return FORCE  # no entry can say how it acts
    idle = [each for each in assessment.effects if not _is_cause(each)]
    worst = min(idle, key=lambda each: (each.shrink.estimate, each.probability), default=None)
    return worst.name if worst else ""


def _assessed(selected: SelectedModel, named: frozenset[str]) -> Assessment:
    entries = contributions_of(selected, named)
    by_effect = attributions(
        selected.session,
        entries.parts,
        entries.left_of_tolerated(),
        selected.left_by_shapes(),
        selected.unexplained,
        entries.channel_of,
        selected.noise.tolerance,
    )
    doubts = _doubts(selected, entries, named)
    found = tuple(
        _named(selected, entries, name, doubts, by_effect[name]) for name in entries.columns
    )
    return Assessment(entries, by_effect, doubts, found)


def _doubts(
    selected: SelectedModel, entries: Contributions, named: frozenset[str]
) -> dict[str, Doubt]:
    """The doubt in each channel."""
    session = selected.session
    by_entries = unexplained_shares(
        session, _rms(_left_beside_force(selected, entries)), selected.noise
    )
    places = set(entries.channel_of.values())
    claimed = {name: share for name, share in by_entries.items() if name in places}
    doubts = doubts_of(session, selected.unexplained, claimed, len(named))
    is_open = TORQUE_GAP in doubts and _exceeds_floor(selected, (TORQUE_GAP,))
    best, parameters = selected.posterior.best.fit, _parameters(selected.machine)
    if is_open and is_stretched(selected.design, best, parameters, named):
        doubts[TORQUE_GAP] = Doubt(is_unknown=True, confidence=0.5)
    return doubts


def _left_beside_force(selected: SelectedModel, entries: Contributions) -> dict[str, Floats]:
    """Residual of the entries and of what is tolerated, by channel, (n,); a force as it was."""
    left = entries.left_of_tolerated()
    if FORCE in entries.parts and TORQUE_GAP in left:
        left[TORQUE_GAP] = (
            left[TORQUE_GAP] + entries.parts[FORCE][TORQUE_GAP] - _force_pulses(selected)
        )
    return left


def _named(
    selected: SelectedModel,
    entries: Contributions,
    name: str,
    doubts: Mapping[str, Doubt],
    attribution: Attribution,
) -> NamedEffect:
    """An effect with the probability that it has in the light of its claim."""
    posterior, values, channel = selected.posterior, entries.values, entries.channel_of[name]
    trust = BESIDE_UNNAMED if UNKNOWN in posterior.best.material else 1.0
    trust = trust * attribution.trust * (AT_BOUND if values.is_at_bound(name) else 1.0)
    rows = selected.session.channels[channel]
    shrink = shrink_of(rows, name, channel, values, entries.folds)
    if name == FORCE:
        shrink = replace(shrink, high=max(shrink.high, _shrink_by_pulses(selected)))
    return NamedEffect(
        name,
        channel,
        min(posterior.probability[name], SUREST)
        * trust
        * _confidence(doubts, entries.columns[name]),
        posterior.classes[name],
        shrink,
        values.parameters(name),
        values.entries(name),
    )


def _shrink_by_pulses(selected: SelectedModel) -> float:
    """Shrink of the torque's gap by the forces as they were; 0 where they are the lesser part."""
    gap = selected.session.channels[TORQUE_GAP].gap
    left = float(np.sum((gap - _force_pulses(selected)) ** 2)) / float(np.sum(gap**2))
    return 1.0 - math.sqrt(left) if left < LESSER_PART else 0.0


def _force_pulses(selected: SelectedModel) -> Floats:
    """Forces of the best set in the torque, N m, (n,)."""
    best, design = selected.posterior.best.fit, selected.design
    mine = [a for a in best.regressors if design.regressors[a].name == FORCE]
    return design.modelled(TORQUE_GAP, mine, best.of_regressors(design, mine))


def _confidence(doubts: Mapping[str, Doubt], columns: Mapping[str, Floats]) -> float:
    """The least of all channels that an effect shows in: it must be right in each of them."""
    shown = [doubts[name].confidence for name, each in columns.items() if np.any(each)]
    return min(shown, default=1.0)


def _is_cause(each: NamedEffect) -> bool:
    """Tell whether an effect is likely, and helps beside the others; nobody foresees a force."""
    helps = each.shrink.high if each.name == FORCE else each.shrink.estimate
    return each.probability >= LEAST_PROBABILITY and helps >= LEAST_SHRINK


def _result(
    selected: SelectedModel,
    assessment: Assessment,
    named: frozenset[str],
    suspects: Mapping[str, float],
) -> Diagnosis:
    channels, entries = selected.session.channels, assessment.entries
    gap, torque_nm = _gap(selected, entries), torque_rms_nm(selected.session)
    blind = TORQUE_GAP in gap and is_blind(gap[TORQUE_GAP].noise_floor, torque_nm)
    effects = [
        replace(each, probability=BLIND_TRUST * each.probability)
        if blind and each.channel == TORQUE_GAP
        else each
        for each in assessment.effects
    ]
    blind = blind and all(each.channel == TORQUE_GAP for each in effects)
    found = sorted(effects, key=lambda each: (-each.probability, -each.shrink.estimate))
    is_unknown = blind or _is_unknown(selected, assessment, named)
    verdict = verdict_of(found, is_unknown=is_unknown)
    floors = {name: each.noise_floor for name, each in gap.items()}
    after = {name: replace(rows, gap=entries.left[name]) for name, rows in channels.items()}
    return Diagnosis(
        verdict,
        gap,
        tuple(where(channels, floors)),
        tuple(where(after, floors)),
        tuple(found),
        max(selected.unexplained.values(), default=0.0),
        ALL_MOTIONS if verdict is Verdict.AMBIGUOUS else None,
        entries.left,
        waterfall(selected.session, entries.parts),
        _nearest(found, _suspects(selected)) if is_unknown else None,
        selected.posterior,
        replay(selected.machine, entries.folds, entries.channel_of, floors),
        caveats_of(gap, _rms(entries.left_of_tolerated()), torque_nm, verdict),
        blind,
        suspects,
    )


def _is_unknown(selected: SelectedModel, assessment: Assessment, named: frozenset[str]) -> bool:
    """Tell whether something that the library lacks is the better part of the cause."""
    return (
        UNKNOWN in selected.posterior.best.material
        or is_misattributed(assessment.attributions, assessment.entries.channel_of)
        or any(doubt.is_unknown for doubt in assessment.doubts.values())
        or (bool(_suspects(selected)) and not named and _exceeds_floor(selected))
    )


def _suspects(selected: SelectedModel) -> list[str]:
    return sorted(selected.posterior.best.material - {UNKNOWN})


def _nearest(found: Sequence[NamedEffect], suspects: Sequence[str]) -> str | None:
    """Nearest effect to a cause that nobody knows, even where it was refused."""
    return next(iter([*(each.name for each in found), *suspects]), None)


def _gap(selected: SelectedModel, entries: Contributions) -> dict[str, ChannelGap]:
    after, noise = entries.left_rms(), selected.noise
    return {
        name: ChannelGap(
            rows.rms,
            after[name],
            noise.floor[name],
            noise.tolerance[name],
            selected.floor_source(name),
            CHANNEL_UNITS[name],
        )
        for name, rows in selected.session.channels.items()
    }


def _rms(left: Mapping[str, Floats]) -> dict[str, float]:
    return {name: float(np.sqrt(np.mean(each**2))) for name, each in left.items()}


def _exceeds_floor(selected: SelectedModel, channels: Sequence[str] = tuple(CHANNEL_UNITS)) -> bool:
    recorded = selected.session.channels
    return any(
        selected.noise.matters(name, recorded[name].rms) for name in channels if name in recorded
    )


def _parameters(machine: Machine) -> frozenset[str]:
    return frozenset(name for name, sigma in parameter_tolerances(machine).items() if sigma > 0.0)
