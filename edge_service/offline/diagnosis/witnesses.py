"""Witnesses of a diagnosis: what `doctor` and the live estimator see in the same recordings."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...checks.examination import check_plausibility
from ...checks.finding import Finding
from ...checks.finding import Verdict as Check
from ...diagnose.preload import PreloadReading, fresh_screw
from ...diagnose.result import Diagnosis, Verdict
from ...estimate.mixture.estimator import MixturePreloadEstimator
from ...messages.estimate import PreloadEstimate
from ...messages.samples import ANGLE, TABLE_POSITION, SampleFrame
from ...models.effects.effect import Effect
from ...models.effects.registry import get_effect
from ...models.machine import Machine
from ...nodes.stages import make_downsampler
from ...regression.run import Run
from ..recordings import open_recording

_TRUST = 0.5
"""Of the probability of an effect, where one that it resembles is seen and not among the causes."""


def doubts(machine: Machine, runs: Sequence[Run]) -> list[Finding]:
    """Findings of `doctor` about the two encoders that are no good ones."""
    ratio = machine.transmission_ratio_m_per_rad
    frames = []
    for run in runs:
        if run.transmission_m is not None and not run.misses_acceleration:
            angle_rad = run.motion.angle_rad
            channels = {ANGLE: angle_rad, TABLE_POSITION: run.transmission_m + ratio * angle_rad}
            frames.append(SampleFrame(run.motion.time_s, channels))
    if not frames:
        return []
    found = check_plausibility(machine, frames)
    return [each for each in found if each.verdict is Check.DOUBTFUL and each.name != "rate"]


def beside_doubts(
    found: Diagnosis, doubted: Sequence[Finding], library: Sequence[Effect]
) -> Diagnosis:
    """Diagnosis that names what `doctor` sees by itself with what it may pass for.

    Where `doctor` sees an effect, such as a lag of an encoder, and the causes lack it, effects that
    may be named in its place are no longer sure, and are tied with it.
    """
    named, seen = {each.name for each in found.effects}, {each.name for each in doubted}
    changed = list(found.effects)
    for effect in library:
        name, confirmed = effect.name, effect.confirmation
        if not confirmed or confirmed.check not in seen or name in named:
            continue
        for k, each in enumerate(changed):
            if each.entries and get_effect(each.name).kind in confirmed.resembled_by:
                less = {"probability": _TRUST * each.probability, "tied": (*each.tied, name)}
                changed[k] = each.model_copy(update=less)
    if changed == list(found.effects):
        return found
    verdict = Verdict.AMBIGUOUS if found.verdict is Verdict.EXPLAINED else found.verdict
    changed.sort(key=lambda each: (-each.probability, -each.shrink.estimate))
    return found.with_effects(changed, verdict)


def preload_reading(
    machine: Machine, traces: Sequence[Path]
) -> tuple[PreloadReading | None, tuple[str, ...]]:
    """Last number, what holds the intervals of all recordings, and doubts about the model."""
    fresh, known = machine.fresh_preload_percent, machine.commissioned
    if known is None or fresh is None or fresh_screw(machine) is None:
        return None, ()
    ends = [_last(machine, path) for path in traces]
    said = (f"the running service says of it: {each}" for end in ends for each in end.reasons)
    mismatches = tuple(dict.fromkeys(each for each in said if "model_mismatch" in each))
    read = [(e.preload_percent, e.low, e.high) for e in ends if e.preload_percent is not None]
    if not read:
        return None, mismatches
    values, lows, highs = (100.0 / fresh * np.array(read, np.float64)).T.tolist()
    two = known.transmission is not None
    return PreloadReading(values[-1], min(lows), max(highs), two_encoders=two), mismatches


def _last(machine: Machine, path: Path) -> PreloadEstimate:
    downsampler = make_downsampler(machine)
    estimator = MixturePreloadEstimator(machine)
    with open_recording(machine, path) as frames:
        for frame in frames:
            for block in downsampler.push(frame):
                estimator.update(block)
    return estimator.estimate()
