"""Examination of recording files before a command answers: the checks that `doctor` prints."""

from collections.abc import Collection, Iterable, Sequence
from pathlib import Path

from ..checks.examination import check_plausibility
from ..checks.finding import Finding
from ..config import ConfigError
from ..messages.samples import SampleFrame
from ..models.machine import Machine
from ..recordings.reader import joined
from .recordings import Progress, open_recording, reported, silent

MOST_ROWS = 600_000
"""Rows of a file that are examined: ten minutes at 1 kHz, in pieces spread over a longer one."""


class ExaminationError(ConfigError):
    """Recordings that contradict the machine file, so that no answer is right; one line."""


def examine(machine: Machine, traces: Sequence[Path], progress: Progress = silent) -> list[Finding]:
    """Every check that these files allow; errors as `open_trace`."""
    frames: list[SampleFrame] = []
    unread: dict[str, None] = {}
    for path in traces:
        with open_recording(machine, path) as reader:
            frames += spread(reported(reader, f"examining {path.name}", progress))
            unread |= dict.fromkeys(reader.ignored)
    return check_plausibility(machine, frames, tuple(unread))


def require_sound(
    machine: Machine,
    traces: Sequence[Path],
    strict: Collection[str] = (),
    progress: Progress = silent,
) -> None:
    """Examine recordings, and go on only where an answer can be right.

    Args:
        strict: names of checks whose every doubt forbids an answer.

    Raises ExaminationError: a mistake of unit, sign or column; the text names the worst.
    """
    for each in examine(machine, traces, progress):
        if each.forbids or (each.is_doubtful and each.name in strict):
            names = ", ".join(str(path) for path in traces)
            raise ExaminationError(
                f"{names}: {each.sentence}; {each.remedy} (see `edge-service doctor`)"
            )


def spread(frames: Iterable[SampleFrame]) -> list[SampleFrame]:
    """Unbroken pieces of a recording, of at most `MOST_ROWS` rows in all.

    Of a longer one every second block is kept, or every fourth, and so on.
    """
    kept: list[tuple[int, SampleFrame]] = []
    stride, held = 1, 0
    for number, frame in enumerate(frames):
        if number % stride == 0:
            kept.append((number, frame))
            held += len(frame)
        while held > MOST_ROWS and len(kept) > 1:
            stride *= 2
            kept = [each for each in kept if each[0] % stride == 0]
            held = sum(len(each) for _, each in kept)
    pieces: list[list[SampleFrame]] = []
    before = -2
    for number, frame in kept:
        if number != before + 1:
            pieces.append([])
        pieces[-1].append(frame)
        before = number
    return [joined(piece) for piece in pieces]
