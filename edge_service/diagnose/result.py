"""Result of a diagnosis: the document `diagnosis/1`, and the series behind its pictures."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal, Self

from pydantic import Field, InstanceOf
from pydantic.json_schema import SkipJsonSchema

from ..messages.interval import Frozen
from ..messages.samples import Floats
from ..models.effects.effect import ActiveEffect
from ..models.effects.registry import effects_where
from .residual.noise import REPEATS_MAY_MISS

SUREST = 0.99
"""Probability beyond which nothing was shown to be known: of 195 names above .9 on real machines
with errors added and on the benchmark beside the checkout 194 were right (Laplace: 195 of 197)."""
SURE = 0.9
NO_HARM = 1e-3
"""Share by which a gap may grow: the tails of a place leave less elsewhere."""
VIBRATION = "vibration"
"""Cause that no entry of the library describes: what is periodic in time."""


class Verdict(StrEnum):
    """Verdict of a diagnosis."""

    NO_GAP = "no_gap"
    EXPLAINED = "explained"
    AMBIGUOUS = "ambiguous"
    UNKNOWN = "unknown"
    BAD_DATA = "bad_data"


class Shrink(Frozen):
    """Shrinkage 1 - RMS after / RMS before, with its 90 % interval."""

    estimate: float
    low: float
    high: float


class ParameterValue(Frozen):
    """Value of a parameter in `unit`, with its 90 % interval; None where the data set no bound."""

    value: float
    low: float | None = None
    high: float | None = None
    unit: str


class Place(Frozen):
    """Interval of a variable in which a gap lives."""

    channel: str
    variable: str
    low: float = Field(alias="from")
    high: float = Field(alias="to")
    unit: str
    share: float  # of the gap's energy that a function of the variable explains
    energy: float = Field(alias="energy_share")  # of the gap's energy that lies in the interval
    machine_coordinate: str = ""  # the interval as a controller shows it


class NamedEffect(Frozen):
    """Named cause of the gap."""

    name: str
    channel: str
    probability: float
    tied: tuple[str, ...] = Field(alias="class")  # itself and what this data cannot tell from it
    shrink: Shrink  # expected on other motion
    # in the simulated axis on held-out motion; None where nothing was simulated
    replay: Shrink | None = None
    parameters: dict[str, ParameterValue]  # of its strongest entry
    # values of the effect, one set for each time that it is there
    entries: tuple[dict[str, float], ...]

    @property
    def is_known(self) -> bool:
        """Flag of a cause beyond doubt that helps on other motion, and harms on none."""
        is_sure = self.probability >= SURE and len(self.tied) == 1
        return is_sure and self.shrink.low >= -NO_HARM and self.shrink.estimate > 0.0


class ReplayedGap(Frozen):
    """Root mean squares of measured less simulated, held out; `unexplained` exceeds the floor."""

    before: float
    after: float
    unexplained: float
    shrink: Shrink


class ChannelGap(Frozen):
    """Root mean squares of one channel, in `unit`."""

    before: float
    after: float
    noise_floor: float | None  # what no model could explain
    floor_source: str | None = None  # `recording`, or `reference` where healthy recordings tell it
    tolerance: float | None = None  # what nobody needs to know the cause of, beyond the floor
    commissioned: float | None = None  # of the healthy axis as it was then, where known
    unit: str
    replayed: ReplayedGap | None = None

    @property
    def floor(self) -> float:
        """Noise floor; 0 where the data forbid a diagnosis."""
        return self.noise_floor or 0.0

    @property
    def beyond(self) -> float:
        """Part of the gap as it is that is not the floor's."""
        return math.sqrt(max(self.before**2 - self.floor**2, 0.0))

    @property
    def matters(self) -> bool:
        """Excess of the gap over its floor by more than the tolerance."""
        return self.beyond > (self.tolerance or 0.0)


class Misfit(Frozen):
    """Chance that a healthy axis leaves as much beyond the floor, in the least likely channel.

    First with the model as it is, then with the named effects in it; and so by channel.
    """

    p_value: float
    p_value_after: float
    per_channel: dict[str, dict[str, float]]

    @classmethod
    def of_channels(cls, first: Mapping[str, float], then: Mapping[str, float]) -> Self:
        """Misfit of some channels."""
        each = {n: {"p_value": p, "p_value_after": then[n]} for n, p in first.items()}
        return cls(p_value=min(first.values()), p_value_after=min(then.values()), per_channel=each)


class Change(Frozen):
    """Change against healthy recordings, their standard deviation, the chance of one as great.

    Of the spread as a share of itself, of the others of the healthy friction.
    """

    change: float
    scatter: float
    p_value: float


class Unexplained(Frozen):
    """Greatest share of a channel's energy above the floor that is left.

    The nearest effect comes nearest to a cause that nobody knows; None where all are known.
    """

    share: float | None
    nearest: str | None


class WaterfallStep(Frozen):
    """Root mean square that is left with an effect, and all before it."""

    effect: str
    rms: float


class ReplayStatus(Frozen):
    """Possibility of simulating the recordings; `reason` is why there is no replay."""

    possible: bool
    reason: str | None


@dataclass(frozen=True, slots=True, eq=False)
class ReplayedSeries:
    """Gap of one channel, measured less simulated, without and with all effects, (n,) each."""

    time_s: Floats
    before: Floats
    after: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """Series by channel behind the pictures of a diagnosis."""

    left: Mapping[str, Floats] = field(default_factory=dict)  # residual of the named effects, (n,)
    replayed: Mapping[str, ReplayedSeries] = field(default_factory=dict)
    # how far a loss of preload that was known before shrinks the gap in the plant
    loss: Shrink | None = None
    # effects as named, and as fitted without each fold of the blocks of time
    fitted: Sequence[Sequence[ActiveEffect]] = ()
    least: Mapping[str, float] = field(default_factory=dict)  # rms beside what is healthy, too


class Diagnosis(Frozen):
    """Diagnosis of a session, content of diagnosis.json.

    Attributes:
        gap, waterfall: by channel.
        effects: the most probable first.
        not_judged: effects that the recording cannot show, and why.
        withheld: named effects that are a fault, or may be one: no model is to learn them.
        caveats: what bounds the verdict, one line each.
        against_healthy: changes of friction, load, spread and course over the stroke.
        is_blind: the torque's floor hides whatever there may be, and nothing else is named.
        is_doubted: `doctor` doubts a channel, as the remarks say.
        partly: what is left beside the known causes has a cause that is not known.
        augmented: effects that the augmented machine file has learned.
    """

    schema_: Literal["diagnosis/1"] = Field("diagnosis/1", alias="schema")
    verdict: Verdict
    misfit: Misfit | None = None
    partly: bool = False
    gap: dict[str, ChannelGap]
    where: tuple[Place, ...] = ()
    effects: tuple[NamedEffect, ...] = ()
    unexplained: Unexplained = Unexplained(share=None, nearest=None)
    against_healthy: dict[str, Change] = {}
    next_motion: str | None = None
    waterfall: dict[str, tuple[WaterfallStep, ...]] = {}
    not_judged: tuple[str, ...] = ()
    not_judged_reasons: dict[str, str] = {}
    reasons: tuple[str, ...] = ()
    augmented: tuple[str, ...] = ()
    withheld: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    caveats: tuple[str, ...] = ()
    replay: ReplayStatus
    reference: tuple[str, ...] = ()
    is_blind: SkipJsonSchema[bool] = Field(False, exclude=True)
    is_doubted: SkipJsonSchema[bool] = Field(False, exclude=True)
    series: SkipJsonSchema[InstanceOf[Series]] = Field(Series(), exclude=True)

    @property
    def has_changed(self) -> bool:
        """Flag of a torque that only the healthy recordings, place by place, tell from theirs."""
        is_open = bool(self.effects) or any(each.matters for each in self.gap.values())
        return self.verdict is Verdict.UNKNOWN and bool(self.against_healthy) and not is_open

    @property
    def as_commissioned(self) -> tuple[str, ...]:
        """Channels of a healthy axis with about the gap beyond the floor that commissioning had."""
        gaps = self.gap.items() if self.verdict is Verdict.NO_GAP and not self.reference else ()
        most = {name: REPEATS_MAY_MISS * (gap.commissioned or 0.0) for name, gap in gaps}
        return tuple(name for name, gap in gaps if gap.floor < gap.beyond <= most[name])

    def with_effects(
        self, effects: Sequence[NamedEffect], verdict: Verdict, *caveats: str
    ) -> "Diagnosis":
        """Diagnosis with other effects, another verdict and further caveats."""
        partly = self.partly and any(each.is_known for each in effects)
        unclaimed = self.gap.keys() - {each.channel for each in effects}
        is_open = any(self.gap[name].matters for name in unclaimed)
        if self.partly and not partly and not is_open:
            verdict = Verdict.UNKNOWN
        changes = {"effects": tuple(effects), "verdict": verdict, "partly": partly}
        return self.model_copy(update=changes | {"caveats": (*self.caveats, *caveats)})


def withheld(found: Diagnosis) -> tuple[str, ...]:
    """Names of the effects that are a fault, or may be one: no model is to learn them."""
    faults = effects_where(lambda effect: effect.is_fault)
    return tuple(each.name for each in found.effects if faults & {each.name, *each.tied})
