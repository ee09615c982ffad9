"""Recordings of an axis, read as its machine file says: foreign columns, controller's axis."""

from collections.abc import Callable, Iterator
from pathlib import Path

from ..messages.samples import SampleFrame
from ..models.machine import Machine
from ..recordings.reader import TraceReader, open_trace, read_trace
from ..recordings.sinumerik.signals import ControllerAxis

Progress = Callable[[str], None]
"""Takes a line on what is being done."""


def silent(_line: str) -> None:
    """Tell nobody."""


def reported(reader: TraceReader, words: str, progress: Progress) -> Iterator[SampleFrame]:
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
