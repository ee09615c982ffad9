"""Assessment of the named effects: how sure each is, and how far it shrinks the gap."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...messages.samples import Floats
from ..candidates.force_pulses import FORCE
from ..candidates.null_shapes import UNKNOWN
from ..estimation.contributions import Contributions, contributions_of
from ..result import NamedEffect
from ..selection.posterior import without
from ..selection.selected_model import SelectedModel
from ..session.session import TORQUE_GAP, rms
from ..session.tolerance import parameter_tolerances
from .cross_validation import Fold, folds_of
from .misattribution import Attribution, attributions
from .shrink import shrink_of
from .unexplained import Doubt, doubts_of, is_stretched

BESIDE_UNNAMED = 0.8
"""Of the probability of an effect, where something that has no name is needed beside it."""
AT_BOUND = 0.5
"""The same of one whose shape would have to leave what the library allows."""
LEAST_SHRINK = 0.04
"""Of what the other causes leave, on motion that was not fitted: with less an effect is no cause.
"""
LESSER_PART = 0.5
"""Of the gap's energy that is left by a force: with more, the force is not what it is about."""
SUREST = 0.99
"""Probability beyond which nothing was shown to be known: of 195 names above .9 on real machines
with errors added and on the benchmark beside the checkout 194 were right (Laplace: 195 of 197)."""
LEAST_PROBABILITY = 0.02
"""Probability below which an effect is not named at all."""


@dataclass(frozen=True, slots=True, eq=False)
class Assessment:
    """Named effects of a selected model, held against what they leave.

    Attributes:
        named: effects that were to be assessed; of one without an entry nothing is known.
        folds: the entries fitted without each part of the time.
        attributions: effect -> what it has in its channel.
        doubts: by channel.
        effects: with the probability, the shrinkage and the values of each.
        suspects: effects that were named at first, and the structure that each left.
    """

    selected: SelectedModel
    named: frozenset[str]
    contributions: Contributions
    folds: tuple[Fold, ...]
    attributions: Mapping[str, Attribution]
    doubts: Mapping[str, Doubt]
    effects: tuple[NamedEffect, ...]
    suspects: Mapping[str, float]


def assess_causes(selected: SelectedModel) -> Assessment:
    """Assess the material effects, and drop one after another of those that are no causes.

    One at a time: what two effects share is lost only with both. A force that is none hides what
    else there is: without it all sets are weighed anew.
    """
    named = selected.posterior.best.material - {UNKNOWN}
    suspects: dict[str, float] = {}
    while True:
        assessment = _assessed(selected, named)
        for name, attribution in assessment.attributions.items():
            suspects.setdefault(name, attribution.structure)
        idle = _idlest(assessment, named)
        if not idle:
            return replace(assessment, suspects=suspects)
        calmer = without(selected.posterior, FORCE) if idle == FORCE else None
        if calmer is None:
            named = named - {idle}
        else:
            selected = selected.with_posterior(calmer)
            named = calmer.best.material - {UNKNOWN}


def _idlest(assessment: Assessment, named: frozenset[str]) -> str:
    """Named effect that is least of a cause; empty where all are causes."""
    if FORCE in named and all(each.name != FORCE for each in assessment.effects):
        return FORCE  # no entry can say how it acts
    idle = [each for each in assessment.effects if not _is_cause(each)]
    worst = min(idle, key=lambda each: (each.shrink.estimate, each.probability), default=None)
    return worst.name if worst else ""


def _is_cause(each: NamedEffect) -> bool:
    """Tell whether an effect is likely, and helps beside the others; nobody foresees a force."""
    helps = each.shrink.high if each.name == FORCE else each.shrink.estimate
    return each.probability >= LEAST_PROBABILITY and helps >= LEAST_SHRINK


def _assessed(selected: SelectedModel, named: frozenset[str]) -> Assessment:
    contributions = contributions_of(selected, named)
    folds = folds_of(contributions.estimates)
    by_effect = attributions(
        selected.session,
        contributions.by_effect,
        contributions.left_beside_nuisances(),
        selected.residuals(),
        selected.unexplained,
        contributions.channel_of,
        selected.problem.noise.tolerance,
    )
    doubts = _doubts(selected, contributions, named)
    effects = tuple(
        _named(selected, contributions, folds, doubts, each) for each in by_effect.items()
    )
    return Assessment(selected, named, contributions, folds, by_effect, doubts, effects, {})


def _doubts(
    selected: SelectedModel, contributions: Contributions, named: frozenset[str]
) -> dict[str, Doubt]:
    """Doubt about the causes in each channel."""
    problem, session = selected.problem, selected.session
    left = rms_of(_left_beside_force(selected, contributions))
    by_entries = problem.noise.unexplained_shares(session, left)
    claimed = {name: by_entries[name] for name in set(contributions.channel_of.values())}
    doubts = doubts_of(session, selected.unexplained, claimed, len(named))
    tolerances = parameter_tolerances(selected.machine)
    parameters = frozenset(name for name, sigma in tolerances.items() if sigma > 0.0)
    is_open = TORQUE_GAP in doubts and selected.exceeds_floor(TORQUE_GAP)
    if is_open and is_stretched(problem.design, selected.posterior.best.fit, parameters, named):
        doubts[TORQUE_GAP] = Doubt(is_unknown=True, confidence=0.5)
    return doubts


def _left_beside_force(selected: SelectedModel, contributions: Contributions) -> dict[str, Floats]:
    """Residual of entries and nuisances, by channel, (n,), with a force as its pulses were."""
    left, by_effect = contributions.left_beside_nuisances(), contributions.by_effect
    if FORCE in by_effect and TORQUE_GAP in left:
        as_entry = by_effect[FORCE][TORQUE_GAP]
        left[TORQUE_GAP] = left[TORQUE_GAP] + as_entry - _force_pulses_nm(selected)
    return left


def _named(
    selected: SelectedModel,
    contributions: Contributions,
    folds: tuple[Fold, ...],
    doubts: Mapping[str, Doubt],
    attributed: tuple[str, Attribution],
) -> NamedEffect:
    """Effect with the probability that it has in the light of its attribution."""
    name, attribution = attributed
    posterior, estimates = selected.posterior, contributions.estimates
    channel = contributions.channel_of[name]
    trust = BESIDE_UNNAMED if UNKNOWN in posterior.best.material else 1.0
    trust = trust * attribution.trust * (AT_BOUND if estimates.is_at_bound(name) else 1.0)
    # the least of all channels that it shows in: it must be right in each of them
    confidence = min((doubts[each].confidence for each in estimates.shown(name)), default=1.0)
    shrink = shrink_of(selected.session.channels[channel], name, channel, estimates, folds)
    if name == FORCE:
        shrink = replace(shrink, high=max(shrink.high, _shrink_by_pulses(selected)))
    return NamedEffect(
        name,
        channel,
        min(posterior.probability[name], SUREST) * trust * confidence,
        posterior.classes[name],
        shrink,
        estimates.parameters(name),
        estimates.entries(name),
    )


def _shrink_by_pulses(selected: SelectedModel) -> float:
    """Shrink of the torque's gap by the forces as they were; 0 where they are the lesser part."""
    gap = selected.session.channels[TORQUE_GAP].gap
    left = float(np.sum((gap - _force_pulses_nm(selected)) ** 2)) / float(np.sum(gap**2))
    return 1.0 - math.sqrt(left) if left < LESSER_PART else 0.0


def _force_pulses_nm(selected: SelectedModel) -> Floats:
    """Forces of the best set in the torque, N m, (n,)."""
    best, design = selected.posterior.best.fit, selected.problem.design
    mine = [a for a in best.regressors if design.regressors[a].name == FORCE]
    return design.modelled(TORQUE_GAP, mine, best.of_regressors(design, mine))


def rms_of(left: Mapping[str, Floats]) -> dict[str, float]:
    """Root mean square of series (n,), by channel."""
    return {name: rms(each) for name, each in left.items()}
