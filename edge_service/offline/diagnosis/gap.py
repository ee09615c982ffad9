"""`edge-service gap`: how far model and machine are apart, in one number per channel."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...command_answer import Answer
from ...config import load_machine
from ...diagnose.session.recordings import unbroken_runs
from ...diagnose.session.session import (
    TORQUE_GAP,
    TRANSMISSION_GAP,
    channel_gap,
    rigid_baseline,
)
from ...messages.samples import Floats
from ...models.effects.learned import model_effects
from ..examination import require_sound
from ..recordings import Progress, silent
from .sessions import NOTHING_TO_COMPARE, DiagnosisError, one_line, opened_recordings


def gap(
    machine_file: Path,
    traces: Sequence[Path],
    progress: Progress = silent,
    axis_number: int | None = None,
) -> Answer:
    """Root mean square gap by channel, over every run of all recordings, one at a time.

    Raises ConfigError, TraceError, DiagnosisError, ExaminationError.
    """
    machine = load_machine(machine_file, axis_number)
    require_sound(machine, traces)
    modelled = model_effects(machine)
    torque, transmission = _Spread(), _Spread()
    with one_line():
        baseline = rigid_baseline(machine)
        for run in unbroken_runs(opened_recordings(machine, traces, progress), baseline):
            if run.has_torque:
                torque.add(channel_gap(TORQUE_GAP, run, baseline, modelled))
            if run.transmission_m is not None:
                transmission.add(channel_gap(TRANSMISSION_GAP, run, baseline, modelled))
    found = {TORQUE_GAP: torque.rms, TRANSMISSION_GAP: transmission.deviation}
    known = {name: value for name, value in found.items() if value is not None}
    if not known:
        raise DiagnosisError(NOTHING_TO_COMPARE)
    words = "\n".join(f"{name}: {rms:.4g}" for name, rms in known.items())
    return Answer(words, known)


@dataclass(slots=True)
class _Spread:
    """Root mean square, and standard deviation, of values that come in parts."""

    count: int = 0
    total: float = 0.0
    square: float = 0.0
    _near: float = 0.0

    def add(self, values: Floats) -> None:
        if not self.count and values.size:
            self._near = float(values.mean())
        self.count += values.size
        self.total += float(np.sum(values - self._near))
        self.square += float(np.sum((values - self._near) ** 2))

    @property
    def deviation(self) -> float | None:
        """About the mean; None of no values."""
        if not self.count:
            return None
        return math.sqrt(max(self.square / self.count - (self.total / self.count) ** 2, 0.0))

    @property
    def rms(self) -> float | None:
        """About zero; None of no values."""
        deviation = self.deviation
        if deviation is None:
            return None
        return math.hypot(deviation, self._near + self.total / self.count)
