"""Recordings of an axis, read as its machine file says, and examined before a command answers.

A machine file names foreign columns and the controller's axis; the checks are those of `doctor`.
"""

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

from ..checks.examination import check_plausibility
from ..checks.finding import Finding
from ..command_answer import progress
from ..config import ConfigError
from ..messages.samples import SampleFrame
from ..models.machine import Machine
from ..recordings.reader import TraceReader, open_trace, read_trace, spread
from ..recordings.sinumerik.signals import ControllerAxis


def reported(reader: TraceReader, words: str) -> Iterator[SampleFrame]:
    """Frames of a recording; each tenth that is read is reported."""
    told = -1
    for frame in reader:
        tenth = int(10.0 * reader.fraction_read)
        if tenth > told:
            told = tenth
            progress(f"{words}: {10 * tenth} %")
        yield frame


def open_recording(
    machine: Machine, path: Path, axis: ControllerAxis | None = None, *, keep_all: bool = False
) -> TraceReader:
    """Open a recording to be read in bounded pieces; arguments and errors as `open_trace`."""
    axis = axis or ControllerAxis(machine.axis.number, machine.axis.lead_m)
    return open_trace(path, machine.columns, axis, keep_all=keep_all)


def read_recording(machine: Machine, path: Path, *, keep_all: bool = False) -> SampleFrame:
    """Read a whole recording into one frame; errors as `read_trace`."""
    axis = ControllerAxis(machine.axis.number, machine.axis.lead_m)
    return read_trace(path, machine.columns, axis, keep_all=keep_all)


class ExaminationError(ConfigError):
    """Recordings that contradict the machine file, so that no answer is right; one line."""


def examine(machine: Machine, traces: Sequence[Path]) -> list[Finding]:
    """Every check that these files allow; errors as `open_trace`."""
    frames: list[SampleFrame] = []
    unread: dict[str, None] = {}
    for path in traces:
        with open_recording(machine, path) as reader:
            frames += spread(reported(reader, f"examining {path.name}"))
            unread |= dict.fromkeys(reader.ignored)
    return check_plausibility(machine, frames, tuple(unread))


def require_sound(machine: Machine, traces: Sequence[Path], strict: Collection[str] = ()) -> None:
    """Examine recordings, and go on only where an answer can be right.

    Args:
        strict: names of checks whose every doubt forbids an answer.

    Raises ExaminationError: a mistake of unit, sign or column; the text names the worst.
    """
    for each in examine(machine, traces):
        if each.forbids or (each.is_doubtful and each.name in strict):
            names = ", ".join(str(path) for path in traces)
            raise ExaminationError(
                f"{names}: {each.sentence}; {each.remedy} (see `edge-service doctor`)"
            )
