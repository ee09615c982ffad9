"""Misattribution: doubt of a named effect that may be the nearest relation of an unknown one."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ...models.effects.registry import effects_where
from ..candidates.force_pulses import FORCE
from ..residual.structure import predicted_structure
from ..session.session import Session

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


def attributions(
    session: Session,
    parts: Mapping[str, Mapping[str, Floats]],
    left: Mapping[str, Floats],
    left_by_shapes: Mapping[str, Floats],
    shares_left: Mapping[str, float],
    channel_of: Mapping[str, str],
    tolerance: Mapping[str, float],
) -> dict[str, Attribution]:
    """Attributions of named effects.

    Args:
        parts: effect -> channel -> what it makes of the gap, (n,).
        left: what all of them and the nuisances leave, by channel, (n,).
        left_by_shapes: what the best fit leaves, with all shapes that bear a name, (n,).
        shares_left: share of each channel's energy above the floor that the best fit leaves.
        channel_of: effect -> the channel that it affects most.
        tolerance: root mean square by channel; structure up to it does not count.
    """
    thermal = effects_where(lambda effect: effect.is_thermal)
    heated = {channel for effect, channel in channel_of.items() if effect in thermal}
    residuals = {
        name: left_by_shapes[name] if name in heated else left[name]
        for name in set(channel_of.values())
    }
    missed = _missed(residuals, predicted_structure(session, residuals), tolerance)
    found = {}
    for effect, channel in channel_of.items():
        rest, mine = left[channel], parts[effect][channel]
        whole = float(np.sum(session.channels[channel].gap ** 2))
        gain = float(np.sum((rest + mine) ** 2) - np.sum(rest**2))
        strain = math.fsum(float(np.sum(each[channel] ** 2)) for each in parts.values())
        unexplained, missed_here = shares_left[channel], missed[channel]
        if effect == FORCE:
            unexplained = FORCE_WEIGHT * max(unexplained, float(np.sum(rest**2)) / whole)
            own = {channel: rest + mine}
            by_motion = predicted_structure(session, own, timed=False)
            by_chance = _missed(own, by_motion, tolerance)[channel]
            missed_here = max(missed_here, by_chance - BY_CHANCE * float(np.sum(own[channel] ** 2)))
        found[effect] = Attribution(
            gain / whole,
            1.0 - float(np.sum(rest**2)) / whole,
            missed_here / whole,
            unexplained,
            strain / whole,
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
    """Tell whether what explains most of a channel is more likely a misattribution than not."""
    leaders: dict[str, Attribution] = {}
    for effect, attribution in found.items():
        channel = channel_of[effect]
        if channel not in leaders or attribution.gain > leaders[channel].gain:
            leaders[channel] = attribution
    return any(attribution.trust < 0.5 for attribution in leaders.values())
