"""Result of a diagnosis: a verdict, the gap, where it lives, and the effects that cause it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from ..messages.samples import Floats
from .estimation.estimates import Interval
from .localisation.places import Place
from .validation.replay import Replay
from .validation.shrink import Shrink

SURE = 0.9


class Verdict(StrEnum):
    """Verdict of a diagnosis."""

    NO_GAP = "no_gap"
    EXPLAINED = "explained"
    AMBIGUOUS = "ambiguous"
    UNKNOWN = "unknown"
    BAD_DATA = "bad_data"


@dataclass(frozen=True, slots=True)
class NamedEffect:
    """Named cause of the gap.

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
    """Root mean squares of one channel.

    Attributes:
        noise_floor: what no model could explain.
        tolerance: what nobody needs to know the cause of, beyond the floor.
        floor_source: `recording`, or `reference` where healthy recordings tell it.
    """

    before: float
    after: float
    noise_floor: float
    tolerance: float
    floor_source: str
    unit: str

    @property
    def beyond(self) -> float:
        """Part of the gap as it is that is not the floor's."""
        return math.sqrt(max(self.before**2 - self.noise_floor**2, 0.0))

    @property
    def matters(self) -> bool:
        """True if the gap exceeds its floor by more than the tolerance."""
        return self.beyond > self.tolerance


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """Result of the diagnosis of a session.

    Attributes:
        gap, left, waterfall: by channel; `left` is the residual of the named effects, (n,).
        where, where_after: places of the gap, and of what the named effects leave of it.
        effects: the most probable first.
        unexplained: greatest share of a channel's energy above the floor that is left.
        nearest: effect that comes nearest to a cause that nobody knows; None where all are known.
        caveats: what bounds the verdict, one line each: a floor that hides what matters, a
            remainder beside the causes.
        is_blind: the torque's floor hides whatever there may be, and nothing else is named.
        suspects: effects that were named at first, and the structure that each left.
    """

    verdict: Verdict
    gap: Mapping[str, ChannelGap]
    where: tuple[Place, ...]
    where_after: tuple[Place, ...]
    effects: tuple[NamedEffect, ...]
    unexplained: float
    next_motion: str | None
    left: Mapping[str, Floats]
    waterfall: Mapping[str, Sequence[tuple[str, float]]]
    nearest: str | None
    replay: Replay
    caveats: tuple[str, ...]
    is_blind: bool
    suspects: Mapping[str, float]


def verdict_of(found: Sequence[NamedEffect], *, is_unknown: bool) -> Verdict:
    """Verdict on some causes, none or more."""
    if is_unknown:
        return Verdict.UNKNOWN
    if not found:
        return Verdict.NO_GAP
    if any(each.probability < SURE or len(each.tied) > 1 for each in found):
        return Verdict.AMBIGUOUS
    return Verdict.EXPLAINED
