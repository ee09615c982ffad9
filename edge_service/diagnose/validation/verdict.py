"""Verdict: the word for what was found, how sure its effects are, and what it leaves open."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ..candidates.null_shapes import UNKNOWN
from ..result import ChannelGap, NamedEffect, Verdict, verdict_of
from ..selection.selected_model import SelectedModel
from ..session.session import CHANNEL_UNITS, TORQUE_GAP
from .assessment import Assessment, rms_of
from .caveats import caveats_of, is_blind
from .misattribution import is_misattributed

BLIND_TRUST = 0.5
"""Of the probability of an effect in a torque that is mostly noise: some entry follows noise."""


@dataclass(frozen=True, slots=True, eq=False)
class Conclusion:
    """Verdict and what goes with it.

    Attributes:
        effects: the most probable first.
        nearest: effect that comes nearest to a cause that nobody knows; None where all are known.
        is_blind: the torque's floor hides whatever there may be, and nothing else is named.
    """

    verdict: Verdict
    effects: tuple[NamedEffect, ...]
    nearest: str | None
    caveats: tuple[str, ...]
    is_blind: bool


def channel_gaps(assessment: Assessment) -> dict[str, ChannelGap]:
    """Gap of each channel before and after the named effects, beside its floor."""
    selected, after = assessment.selected, rms_of(assessment.contributions.left)
    noise = selected.problem.noise
    return {
        name: ChannelGap(
            rows.rms,
            after[name],
            noise.floor[name],
            noise.tolerance[name],
            _floor_source(selected, name),
            CHANNEL_UNITS[name],
        )
        for name, rows in selected.session.channels.items()
    }


def _floor_source(selected: SelectedModel, channel: str) -> str:
    """Origin of a channel's floor: `reference` where healthy recordings show it."""
    healthy = selected.session.healthy
    return "reference" if healthy is not None and channel in healthy.floor else "recording"


def conclude(assessment: Assessment, gap: Mapping[str, ChannelGap]) -> Conclusion:
    """Reach the verdict on assessed effects."""
    torque_rms_nm = assessment.selected.session.torque_rms_nm
    blind = TORQUE_GAP in gap and is_blind(gap[TORQUE_GAP].noise_floor, torque_rms_nm)
    effects = [
        replace(each, probability=BLIND_TRUST * each.probability)
        if blind and each.channel == TORQUE_GAP
        else each
        for each in assessment.effects
    ]
    blind = blind and all(each.channel == TORQUE_GAP for each in effects)
    found = sorted(effects, key=lambda each: (-each.probability, -each.shrink.estimate))
    suspects = sorted(assessment.selected.posterior.best.material - {UNKNOWN})
    is_unknown = blind or _is_unknown(assessment, suspects)
    verdict = verdict_of(found, is_unknown=is_unknown)
    nearest = next(iter([*(each.name for each in found), *suspects]), None)
    left_rms = rms_of(assessment.contributions.left_beside_nuisances())
    return Conclusion(
        verdict,
        tuple(found),
        nearest if is_unknown else None,
        caveats_of(gap, left_rms, torque_rms_nm, verdict),
        blind,
    )


def _is_unknown(assessment: Assessment, suspects: Sequence[str]) -> bool:
    """Tell whether something that the library lacks is the better part of the cause."""
    selected = assessment.selected
    return (
        UNKNOWN in selected.posterior.best.material
        or is_misattributed(assessment.attributions, assessment.contributions.channel_of)
        or any(doubt.is_unknown for doubt in assessment.doubts.values())
        or (bool(suspects) and not assessment.named and selected.exceeds_floor(*CHANNEL_UNITS))
    )
