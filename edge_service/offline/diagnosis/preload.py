"""Preload that the live estimator reads in the recordings of a diagnosis."""

from collections.abc import Sequence
from pathlib import Path

from ...config import DownsampleConfig
from ...diagnose.preload.fresh_screw import fresh_screw
from ...diagnose.preload.known_loss import PreloadReading
from ...estimate.mixture.estimator import FusedPreloadEstimator
from ...models.machine import Machine
from ...nodes.wiring.stages import make_downsampler
from ..recordings import open_recording

Answer = tuple[float, float, float]


def preload_reading(machine: Machine, traces: Sequence[Path]) -> PreloadReading | None:
    """Last number of each recording, and what holds all of their intervals; None without one."""
    fresh = machine.fresh_preload_percent
    if machine.commissioned is None or fresh is None or fresh_screw(machine) is None:
        return None
    answers = [answer for path in traces if (answer := _last(machine, path)) is not None]
    if not answers:
        return None
    share = 100.0 / fresh
    return PreloadReading(
        value=share * answers[-1][0],
        low=share * min(low for _, low, _ in answers),
        high=share * max(high for _, _, high in answers),
        two_encoders=machine.commissioned.transmission is not None,
    )


def _last(machine: Machine, path: Path) -> Answer | None:
    downsampler = make_downsampler(DownsampleConfig(), machine)
    estimator = FusedPreloadEstimator(machine)
    with open_recording(machine, path) as frames:
        for frame in frames:
            for block in downsampler.push(frame):
                estimator.update(block)
    found = estimator.estimate()
    if found.preload_percent is None or found.low is None or found.high is None:
        return None
    return found.preload_percent, found.low, found.high
