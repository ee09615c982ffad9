"""Recordings of an axis, read as its machine file says: foreign columns, controller's axis."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

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


def joined(frames: Sequence[SampleFrame]) -> SampleFrame:
    """Frames that follow one another as one; quality is left out."""
    channels = {
        name: np.concatenate([frame.channels[name] for frame in frames])
        for name in frames[0].channels
    }
    return SampleFrame(np.concatenate([frame.time_s for frame in frames]), channels)


def open_recording(
    machine: Machine, path: Path, axis: ControllerAxis | None = None, *, keep_all: bool = False
) -> TraceReader:
    """Open a recording to be read in bounded pieces; arguments and errors as `open_trace`."""
    return open_trace(path, machine.columns, axis or controller_axis(machine), keep_all=keep_all)


def read_recording(machine: Machine, path: Path, *, keep_all: bool = False) -> SampleFrame:
    """Read a whole recording into one frame; errors as `read_trace`."""
    return read_trace(path, machine.columns, axis=controller_axis(machine), keep_all=keep_all)


def controller_axis(
    machine: Machine,
    number: int | None = None,
    *,
    interpolate_positions: bool = False,
) -> ControllerAxis:
    """The axis of a machine file as a controller's recording needs it."""
    return ControllerAxis(
        machine.axis.number if number is None else number,
        machine.axis.lead_m,
        interpolate_positions,
    )
