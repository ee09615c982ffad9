"""Assessment of the named effects: how sure each is, and how far it shrinks the gap."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..candidates.force_pulses import FORCE
from ..candidates.regressors import UNKNOWN
from ..estimation.estimates import Contributions
from ..result import NamedEffect
from ..selection.posterior import Posterior
from ..session.session import TORQUE_GAP
from .cross_validation import CrossValidation
from .doubts import Attribution, Doubt, attributions, doubts_of

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
    """Named effects of the best set, held against what they leave.

    Attributes:
        attributions: effect -> what it has in its channel.
        doubts: by channel.
        effects: with the probability, the shrinkage and the values of each.
        suspects: effects that were named at first, and the structure that each left.
    """

    posterior: Posterior
    contributions: Contributions
    validation: CrossValidation
    attributions: Mapping[str, Attribution]
    doubts: Mapping[str, Doubt]
    effects: tuple[NamedEffect, ...]
    suspects: Mapping[str, float]

    @classmethod
    def of_effects(cls, posterior: Posterior, named: frozenset[str]) -> "Assessment":
        """Assess some effects of the best set."""
        contributions = Contributions.of_effects(posterior, named)
        validation = CrossValidation.of_estimates(contributions.estimates)
        attributed = attributions(posterior, contributions)
        doubts = doubts_of(posterior, contributions)
        effects = []
        for name, attribution in attributed.items():
            estimates, channel = contributions.estimates, contributions.channel_of[name]
            trust = BESIDE_UNNAMED if UNKNOWN in posterior.best.material else 1.0
            trust = trust * attribution.trust * (AT_BOUND if estimates.is_at_bound(name) else 1.0)
            # the least of all channels that it shows in: it must be right in each of them
            shown = estimates.shown(name)
            confidence = min((doubts[each].confidence for each in shown), default=1.0)
            shrink = validation.shrink(name, channel)
            if name == FORCE:
                high = max(shrink.high, _shrink_by_pulses(posterior))
                shrink = shrink.model_copy(update={"high": high})
            effects.append(
                NamedEffect(
                    name=name,
                    channel=channel,
                    probability=min(posterior.probability[name], SUREST) * trust * confidence,
                    tied=posterior.classes[name],
                    shrink=shrink,
                    parameters=estimates.parameters(name),
                    entries=estimates.entries(name),
                )
            )
        suspects = {name: each.structure for name, each in attributed.items()}
        return cls(
            posterior, contributions, validation, attributed, doubts, tuple(effects), suspects
        )

    def idlest(self) -> str:
        """Named effect that is least of a cause; empty where all are causes."""
        if FORCE in self.contributions.named and all(each.name != FORCE for each in self.effects):
            return FORCE  # no entry can say how it acts
        idle = []
        for each in self.effects:
            # nobody foresees a force
            helps = each.shrink.high if each.name == FORCE else each.shrink.estimate
            if each.probability < LEAST_PROBABILITY or helps < LEAST_SHRINK:
                idle.append(each)
        worst = min(idle, key=lambda each: (each.shrink.estimate, each.probability), default=None)
        return worst.name if worst else ""


def assess_causes(posterior: Posterior) -> Assessment:
    """Assess the material effects, and drop one after another of those that are no causes.

    One at a time: what two effects share is lost only with both. A force that is none hides what
    else there is: without it all sets are weighed anew.
    """
    named = posterior.best.material - {UNKNOWN}
    suspects: dict[str, float] = {}
    while True:
        assessment = Assessment.of_effects(posterior, named)
        for name, structure in assessment.suspects.items():
            suspects.setdefault(name, structure)
        idle = assessment.idlest()
        if not idle:
            return replace(assessment, suspects=suspects)
        calmer = posterior.without(FORCE) if idle == FORCE else None
        if calmer is None:
            named = named - {idle}
        else:
            posterior, named = calmer, calmer.best.material - {UNKNOWN}


def _shrink_by_pulses(posterior: Posterior) -> float:
    """Shrink of the torque's gap by the forces as they were; 0 where they are the lesser part."""
    gap = posterior.problem.session.channels[TORQUE_GAP].gap
    left = float(np.sum((gap - posterior.force_nm) ** 2)) / float(np.sum(gap**2))
    return 1.0 - math.sqrt(left) if left < LESSER_PART else 0.0
