"""`edge-service gap`: how far model and machine are apart, in one number per channel."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..config import load_machine
from ..diagnose.session.recordings import Run, runs_of, unbroken_runs
from ..diagnose.session.session import (
    TORQUE_GAP,
    TRANSMISSION_GAP,
    Session,
    torque_gap,
    transmission_gap,
)
from ..diagnose.session.twin import rigid_baseline
from ..messages.samples import Floats, SampleFrame
from ..models.effects.registry import machine_effects
from ..models.machine import Machine
from ..trace.reader import TraceReader
from .recordings import open_recording

_NOTHING = "nothing to compare: expected a second or more of motion with a torque or both encoders"


class DiagnosisError(Exception):
    """Recordings or a machine that cannot be compared; the text is one line."""


def gap(
    machine_file: Path,
    traces: Sequence[Path],
    progress: Callable[[str], None] = lambda _line: None,
    axis_number: int | None = None,
) -> dict[str, float]:
    """Root mean square gap by channel, over every run of all recordings, one at a time.

    Raises:
        ConfigError: the machine file is wrong.
        TraceError: a recording cannot be read.
        DiagnosisError: the recordings hold no motion to compare.
    """
    machine = load_machine(machine_file, axis_number)
    modelled = machine_effects(machine)
    torque, transmission = _Spread(), _Spread()
    with _one_line():
        baseline = rigid_baseline(machine)
        for run in unbroken_runs(_opened(machine, traces, progress), baseline):
            if run.has_torque:
                torque.add(torque_gap(run, baseline, modelled))
            if run.transmission_m is not None:
                transmission.add(transmission_gap(run, run.transmission_m, baseline, modelled))
    found = {TORQUE_GAP: torque.rms, TRANSMISSION_GAP: transmission.deviation}
    known = {name: value for name, value in found.items() if value is not None}
    if not known:
        raise DiagnosisError(_NOTHING)
    return known


class BadDataError(Exception):
    """Recordings that can be read but not diagnosed; the text is one line."""


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


def read_runs(
    machine: Machine, traces: Sequence[Path], progress: Callable[[str], None] = lambda _line: None
) -> list[Run]:
    """Filtered runs of all recordings, read in bounded pieces, one file at a time."""
    if not traces:
        raise DiagnosisError("no recording given; expected one trace or more")
    with _one_line():
        return runs_of(_opened(machine, traces, progress), rigid_baseline(machine))


@contextmanager
def _one_line() -> Iterator[None]:
    try:
        yield
    except ValueError as error:
        raise DiagnosisError(str(error)) from error


def _opened(
    machine: Machine, traces: Sequence[Path], progress: Callable[[str], None]
) -> Iterator[Iterator[SampleFrame]]:
    """Each recording in turn; it is closed when the next is asked for."""
    for number, path in enumerate(traces, start=1):
        with open_recording(machine, path) as reader:
            yield _reporting(reader, f"{path.name}, {number} of {len(traces)}", progress)


def _reporting(
    reader: TraceReader, name: str, progress: Callable[[str], None]
) -> Iterator[SampleFrame]:
    """The frames of a recording; each tenth that is read is reported."""
    reported = -1
    for frame in reader:
        tenth = int(10.0 * reader.fraction_read)
        if tenth > reported:
            reported = tenth
            progress(f"reading {name}: {10 * tenth} %")
        yield frame


def session_of(machine: Machine, runs: Sequence[Run]) -> Session:
    """The session of runs that hold motion."""
    session = Session.of_runs(runs, rigid_baseline(machine), machine_effects(machine))
    if not session.channels or not all(len(rows.gap) for rows in session.channels.values()):
        raise DiagnosisError(_NOTHING)
    return session
