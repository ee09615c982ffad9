"""Checks of `doctor` on the recordings of a diagnosis, and what they say of its causes."""

from collections.abc import Sequence
from dataclasses import replace

from ...checks.examination import check_plausibility
from ...checks.finding import Finding
from ...checks.finding import Verdict as Check
from ...diagnose.pipeline import Diagnosis, NamedEffect, Verdict
from ...diagnose.session.run import Run
from ...messages.channels import ANGLE, TABLE_POSITION
from ...messages.samples import SampleFrame
from ...models.effects.registry import effects, get_effect
from ...models.machine import Machine

_TRUST = 0.5
"""Of the probability of an effect, where one that it resembles is seen and not among the causes."""


def doubts(machine: Machine, runs: Sequence[Run]) -> list[Finding]:
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


def beside_doubts(found: Diagnosis, doubted: Sequence[Finding]) -> Diagnosis:
    """The diagnosis that names what `doctor` sees by itself with what it may pass for.

    Where `doctor` sees an effect, such as a lag of an encoder, and the causes lack it, effects that
    may be named in its place are no longer sure, and are tied with it.
    """
    named, seen = {each.name for each in found.effects}, {each.name for each in doubted}
    lacking = [
        (name, effect.confirmation.resembled_by)
        for name, effect in effects().items()
        if effect.confirmation and effect.confirmation.check in seen and name not in named
    ]
    named_effects = found.effects
    for name, kinds in lacking:
        named_effects = tuple(
            _tied(each, name) if get_effect(each.name).kind in kinds else each
            for each in named_effects
        )
    if named_effects == found.effects:
        return found
    verdict = Verdict.AMBIGUOUS if found.verdict is Verdict.EXPLAINED else found.verdict
    ranked = sorted(named_effects, key=lambda each: (-each.probability, -each.shrink.estimate))
    return replace(found, effects=tuple(ranked), verdict=verdict)


def _tied(each: NamedEffect, name: str) -> NamedEffect:
    return replace(each, probability=_TRUST * each.probability, tied=(*each.tied, name))
