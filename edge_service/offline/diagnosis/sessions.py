"""Recordings of a machine as runs and as one session to be compared with its model."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from ...diagnose.session.recordings import runs_of
from ...diagnose.session.session import Session, rigid_baseline
from ...exit_status import BAD_DATA, BadInputError
from ...messages.samples import SampleFrame
from ...models.effects.learned import model_effects
from ...models.machine import Machine
from ...regression.run import Run
from ..recordings import Progress, open_recording, reported, silent

NOTHING_TO_COMPARE = (
    "nothing to compare: expected a second or more of motion with a torque or both encoders"
)


class DiagnosisError(BadInputError):
    """Recordings or a machine that cannot be compared; the text is one line."""


class BadDataError(BadInputError):
    """Recordings that can be read but not diagnosed; the text is one line."""

    status = BAD_DATA


def read_runs(machine: Machine, traces: Sequence[Path], progress: Progress = silent) -> list[Run]:
    """Filtered runs of all recordings, read in bounded pieces, one file at a time."""
    if not traces:
        raise DiagnosisError("no recording given; expected one trace or more")
    with one_line():
        return runs_of(opened_recordings(machine, traces, progress), rigid_baseline(machine))


@contextmanager
def one_line() -> Iterator[None]:
    """Raise what the rooms below find wrong as a DiagnosisError."""
    try:
        yield
    except ValueError as error:
        raise DiagnosisError(str(error)) from error


def opened_recordings(
    machine: Machine, traces: Sequence[Path], progress: Progress
) -> Iterator[Iterator[SampleFrame]]:
    """Each recording in turn; it is closed when the next is asked for."""
    for number, path in enumerate(traces, start=1):
        with open_recording(machine, path) as reader:
            name = f"{path.name}, {number} of {len(traces)}"
            yield reported(reader, f"reading {name}", progress)


def session_of(machine: Machine, runs: Sequence[Run]) -> Session:
    """The session of runs that hold motion."""
    session = Session.of_runs(runs, rigid_baseline(machine), model_effects(machine))
    if not session.channels or not all(len(rows.gap) for rows in session.channels.values()):
        raise DiagnosisError(NOTHING_TO_COMPARE)
    return session
