"""Checks of `doctor` on the recordings of a diagnosis, and what they say of its causes."""

from collections.abc import Sequence
from dataclasses import replace

from ..diagnose.pipeline import Diagnosis, NamedEffect, Verdict
from ..diagnose.session.run import Run
from ..fingerprint.checks.check_result import CheckResult
from ..fingerprint.checks.check_result import Verdict as Check
from ..fingerprint.checks.plausibility import check_plausibility
from ..messages.channels import ANGLE, TABLE_POSITION
from ..messages.samples import SampleFrame
from ..models.machine import Machine

_LAG, _SKEW = "encoder_lag", "timestamp_skew"
_LIKE_A_LAG = frozenset({"compliance", "thermal_growth", "lead_error", "backlash"})
"""Effects between the encoders that may be named for what a lag of one of them leaves."""
_TRUST = 0.5
"""Of the probability of such an effect, where a lag is found and not among the causes."""


def doubts(machine: Machine, runs: Sequence[Run]) -> list[CheckResult]:
    """Findings of `doctor` about the two encoders that are no good ones."""
    ratio = machine.transmission_ratio_m_per_rad
    frames = [
        SampleFrame(
            run.motion.time_s,
            {
                ANGLE: run.motion.angle_rad,
                TABLE_POSITION: run.transmission_m + ratio * run.motion.angle_rad,
            },
        )
        for run in runs
        if run.transmission_m is not None and not run.is_slow
    ]
    if not frames:
        return []
    found = check_plausibility(machine, frames)
    return [each for each in found if each.verdict is Check.DOUBTFUL and each.name != "rate"]


def beside_doubts(found: Diagnosis, doubted: Sequence[CheckResult]) -> Diagnosis:
    """The diagnosis that names a lag of an encoder with what it may pass for.

    Where `doctor` finds a lag and the causes lack it, effects between the encoders are no longer
    sure, and are tied with it.
    """
    named = {each.name for each in found.effects}
    if _SKEW in named or all(each.name != _LAG for each in doubted):
        return found
    effects = tuple(_tied(each) if each.name in _LIKE_A_LAG else each for each in found.effects)
    if effects == found.effects:
        return found
    verdict = Verdict.AMBIGUOUS if found.verdict is Verdict.EXPLAINED else found.verdict
    ranked = sorted(effects, key=lambda each: (-each.probability, -each.shrink.estimate))
    return replace(found, effects=tuple(ranked), verdict=verdict)


def _tied(each: NamedEffect) -> NamedEffect:
    return replace(each, probability=_TRUST * each.probability, tied=(*each.tied, _SKEW))
