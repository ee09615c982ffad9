"""`edge-service gap`: how far model and machine are apart, in one number per channel.

Recordings of a machine become runs, and one session to be compared with its model.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ...command_answer import Answer
from ...config import load_machine
from ...diagnose.session.recordings import runs_of, unbroken_runs
from ...diagnose.session.session import (
    CHANNEL_UNITS,
    TORQUE_GAP,
    TRANSMISSION_GAP,
    Session,
    channel_gap,
    rigid_baseline,
)
from ...exit_status import BAD_DATA, BadInputError
from ...messages.samples import SampleFrame
from ...models.effects.learned import model_effects
from ...models.machine import Machine
from ...regression.run import Run
from ..recordings import examine_within, open_recording, remarks_of, reported, require_sound
from ..report.quantities import amount

NOTHING_TO_COMPARE = (
    "nothing to compare: expected a second or more of motion with a torque or both encoders, and "
    "beside a reference some speeds and accelerations that it has too"
)


class DiagnosisError(BadInputError):
    """Recordings or a machine that cannot be compared; the text is one line."""


class BadDataError(BadInputError):
    """Recordings that can be read but not diagnosed; the text is one line."""

    status = BAD_DATA


def read_runs(machine: Machine, traces: Sequence[Path]) -> list[Run]:
    """Filtered runs of all recordings, read in bounded pieces, one file at a time."""
    with one_line():
        baseline = rigid_baseline(machine)
    with one_line(*traces):
        return runs_of(opened_recordings(machine, traces), baseline)


@contextmanager
def one_line(*files: Path) -> Iterator[None]:
    """Raise what the rooms below find wrong, perhaps in files, as a DiagnosisError."""
    try:
        yield
    except ValueError as error:
        named = ", ".join(map(str, files))
        raise DiagnosisError(f"{named}: {error}".removeprefix(": ")) from error


def opened_recordings(machine: Machine, traces: Sequence[Path]) -> Iterator[Iterator[SampleFrame]]:
    """Each recording in turn; it is closed when the next is asked for."""
    for number, path in enumerate(traces, start=1):
        with open_recording(machine, path) as reader:
            name = f"{path.name}, {number} of {len(traces)}"
            yield reported(reader, f"reading {name}")


def session_of(machine: Machine, runs: Sequence[Run]) -> Session:
    """The session of runs that hold motion."""
    session = Session.of_runs(runs, rigid_baseline(machine), model_effects(machine))
    if not session.channels or not all(len(rows.gap) for rows in session.channels.values()):
        raise DiagnosisError(NOTHING_TO_COMPARE)
    return session


def gap(machine_file: Path, traces: Sequence[Path], axis_number: int | None = None) -> Answer:
    """Root mean square gap by channel, over every run of all recordings, one at a time.

    Raises ConfigError, TraceError, DiagnosisError, ExaminationError.
    """
    machine = load_machine(machine_file, axis_number)
    found = examine_within(machine, traces)
    require_sound(found, traces)
    known = gap_of(machine, traces)
    lines = [f"{name}: {amount(rms, CHANNEL_UNITS[name])}" for name, rms in known.items()]
    return Answer("\n".join([*lines, *remarks_of(found)]), known)


def gap_of(machine: Machine, traces: Sequence[Path]) -> dict[str, float]:
    """Root mean square gap of recordings, N m or m, by channel. Raises DiagnosisError."""
    modelled = model_effects(machine)
    parts: dict[str, list[tuple[int, float, float]]] = {TORQUE_GAP: [], TRANSMISSION_GAP: []}
    with one_line():
        baseline = rigid_baseline(machine)
    with one_line(*traces):
        for run in unbroken_runs(opened_recordings(machine, traces), baseline):
            there = {TORQUE_GAP: run.has_torque, TRANSMISSION_GAP: run.transmission_m is not None}
            for name in (name for name, is_there in there.items() if is_there):
                values = channel_gap(name, run, baseline, modelled)
                if len(values):
                    parts[name].append((len(values), values.mean(), values.var()))
    known = {}
    for name, each in parts.items():
        if each:
            count, mean, variance = np.array(each).T
            centre = 0.0 if name == TORQUE_GAP else np.average(mean, weights=count)
            square = np.average(variance + (mean - centre) ** 2, weights=count)
            known[name] = float(np.sqrt(square))
    if not known:
        raise DiagnosisError(NOTHING_TO_COMPARE)
    return known
