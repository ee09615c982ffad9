"""Doubts of the named effects: the nearest relation of a cause that no entry describes.

An effect may be a misattribution, by the structure that it leaves; and the best explanation of a
channel may be none, by how much it leaves and what it had to bend for it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ...models.effects.registry import effects_where
from ..candidates.force_pulses import FORCE
from ..estimation.estimates import Contributions
from ..residual.structure import predicted_structure
from ..selection.posterior import Posterior
from ..session.session import TORQUE_GAP, rms
from ..session.twin import parameter_tolerances

_EVEN = 0.08
"""With this much structure left, over what it explains, an effect is as likely a misattribution.

Of 168 true causes 1 left more: of 90 on recordings of real machines with errors added (`bench
diagnose --real-machines`) one, of 78 on the benchmark beside the checkout (seed 7108) none. So a
further true cause is refused with a chance of 2 in 169 (split conformal prediction, Vovk et al.,
2005). Of 38 effects that were not there, 32 left more.
"""
_STEEP = 3.0
BY_CHANCE = 0.5
"""Of a force's energy: so much the motion may predict, for a force also falls on some motion."""
OWN = 1.0 / 3.0
"""Weight of an effect's own gain in what is missed beside it."""
LEFT_WEIGHT = 0.8
"""Of what is left but follows nothing that is known."""
FORCE_WEIGHT = 0.2
"""The same of a force's bursts, over other effects': its entry is a rectangle."""
MOST_STRAIN = 3.0
"""Energy of effects in one channel over that of its gap: beyond it they fit each other."""
UNKNOWN_SHARE = 0.15
"""Share of the gap's energy above the floor; with more left over, the named effects are doubted."""
UNKNOWN_ENTRY_SHARE = 0.6
"""The same of what the entries alone leave, without the forms that an effect takes beside them."""
MOST_CAUSES = 3
"""It takes more than this many causes at once only where none of them is the true one."""
MOST_STRETCH = 6.0
"""Tolerances by which a parameter that is not named may be off."""


@dataclass(frozen=True, slots=True)
class Attribution:
    """Contribution of an effect to the channel that it affects most, as shares of its energy.

    Attributes:
        gain: what leaving it out would bring back.
        explained: what all effects in the channel take away.
        missed: what is left although smooth functions predict it on other motion.
        left: what the best fit leaves, with all shapes that bear the effect's name.
        strain: energy of all effects in the channel.
    """

    gain: float
    explained: float
    missed: float
    left: float
    strain: float

    @property
    def structure(self) -> float:
        """Structure that is left beside it, over what it explains; infinite if it explains nothing.

        What is missed may be its own, but mostly is that of greater effects beside it: it counts by
        a mean, in logarithms, of what this one and what all of them explain.
        """
        if self.gain <= 0.0:
            return math.inf
        share = self.gain**OWN * max(self.explained, self.gain) ** (1.0 - OWN)
        strain = max(self.strain / MOST_STRAIN, 1.0)
        structure: float = (self.missed / share + LEFT_WEIGHT * self.left) * strain
        return structure

    @property
    def trust(self) -> float:
        """Probability that it is no misattribution."""
        return 1.0 / (1.0 + math.pow(self.structure / _EVEN, _STEEP))


def attributions(posterior: Posterior, contributions: Contributions) -> dict[str, Attribution]:
    """Attributions of named effects.

    Structure up to the tolerance does not count. Where an effect of heat is named, structure is
    what the best set leaves with all shapes that bear its names.
    """
    problem, session = posterior.problem, posterior.problem.session
    tolerance, channel_of = problem.noise.tolerance, contributions.channel_of
    left, by_shapes = contributions.left_beside_nuisances, problem.residuals(posterior.best.fit)
    thermal = effects_where(lambda effect: effect.is_thermal)
    heated = {channel for effect, channel in channel_of.items() if effect in thermal}
    residuals = {
        name: by_shapes[name] if name in heated else left[name] for name in set(channel_of.values())
    }
    missed = _missed(residuals, predicted_structure(session, residuals), tolerance)
    found, unexplained = {}, posterior.unexplained
    for effect, channel in channel_of.items():
        rest, mine = left[channel], contributions.by_effect[effect][channel]
        whole = float(np.sum(session.channels[channel].gap ** 2))
        gain = float(np.sum((rest + mine) ** 2) - np.sum(rest**2))
        energies = [float(np.sum(e[channel] ** 2)) for e in contributions.by_effect.values()]
        share, missed_here = unexplained[channel], missed[channel]
        if effect == FORCE:
            share = FORCE_WEIGHT * max(share, float(np.sum(rest**2)) / whole)
            own = {channel: rest + mine}
            by_motion = predicted_structure(session, own, timed=False)
            by_chance = _missed(own, by_motion, tolerance)[channel]
            missed_here = max(missed_here, by_chance - BY_CHANCE * float(np.sum(own[channel] ** 2)))
        found[effect] = Attribution(
            gain=gain / whole,
            explained=1.0 - float(np.sum(rest**2)) / whole,
            missed=missed_here / whole,
            left=share,
            strain=math.fsum(energies) / whole,
        )
    return found


def _missed(
    left: Mapping[str, Floats], structure: Mapping[str, Floats], tolerance: Mapping[str, float]
) -> dict[str, float]:
    """Energy of what is left that smooth functions predict, beyond the tolerance, by channel."""
    found = {}
    for name, rest in left.items():
        predicted = float(np.sum(rest**2) - np.sum((rest - structure[name]) ** 2))
        found[name] = max(predicted - len(rest) * tolerance[name] ** 2, 0.0)
    return found


def is_misattributed(found: Mapping[str, Attribution], channel_of: Mapping[str, str]) -> bool:
    """True if what explains most of a channel is more likely a misattribution than not."""
    leaders: dict[str, Attribution] = {}
    for effect, attribution in found.items():
        channel = channel_of[effect]
        if channel not in leaders or attribution.gain > leaders[channel].gain:
            leaders[channel] = attribution
    return any(attribution.trust < 0.5 for attribution in leaders.values())


@dataclass(frozen=True, slots=True)
class Doubt:
    """Doubt about the causes in one channel: `confidence` scales their probabilities."""

    is_unknown: bool
    confidence: float


def doubts_of(posterior: Posterior, contributions: Contributions) -> dict[str, Doubt]:
    """Doubt about the causes in each channel.

    They leave too much, with the empirical shapes or, where they claim a channel, by their entries
    alone; they are too many; or a parameter that is not named has to leave its tolerance for them.
    """
    problem, session = posterior.problem, posterior.problem.session
    entries_left, by_effect = contributions.left_beside_nuisances, contributions.by_effect
    if FORCE in by_effect and TORQUE_GAP in entries_left:  # a force is taken as its pulses were
        as_entry = by_effect[FORCE][TORQUE_GAP]
        entries_left[TORQUE_GAP] = entries_left[TORQUE_GAP] + as_entry - posterior.force_nm
    left_rms = {name: rms(each) for name, each in entries_left.items()}
    by_entries = problem.noise.unexplained_shares(session, left_rms)
    claimed, left = set(contributions.channel_of.values()), posterior.unexplained
    doubts = {}
    for name in session.channels:
        is_unknown = left[name] > UNKNOWN_SHARE or len(contributions.named) > MOST_CAUSES
        is_unknown |= name in claimed and by_entries[name] > UNKNOWN_ENTRY_SHARE
        doubts[name] = Doubt(is_unknown, 0.5 * (1.0 - left[name]) if is_unknown else 1.0)
    if TORQUE_GAP in posterior.exceeding and _is_stretched(posterior, contributions.named):
        doubts[TORQUE_GAP] = Doubt(is_unknown=True, confidence=0.5)
    return doubts


def _is_stretched(posterior: Posterior, named: frozenset[str]) -> bool:
    """True if a parameter that is not named has to leave its tolerance for the fit."""
    design, best = posterior.problem.design, posterior.best.fit
    tolerances = parameter_tolerances(posterior.problem.machine)
    for k in range(design.nuisances):
        name = design.regressors[k].name
        if tolerances.get(name, 0.0) > 0.0 and name not in named:
            place = int(design.first[k])
            off = best.coefficients[place] - design.mean[place]
            if abs(float(off)) * float(np.sqrt(design.precision[place])) > MOST_STRETCH:
                return True
    return False
