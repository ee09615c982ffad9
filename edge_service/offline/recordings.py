"""Recordings of an axis, read as its machine file says, and examined before a command answers.

A machine file names foreign columns and the controller's axis; the checks are those of `doctor`.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path

from ..checks.examination import check_plausibility
from ..checks.finding import Finding, Verdict
from ..command_answer import progress
from ..config import ConfigError
from ..messages.features import FAULT_WORDS, Fault, FeatureBlock
from ..messages.samples import SampleFrame
from ..models.machine import Machine
from ..nodes.stages import make_downsampler
from ..recordings.reader import MOST_SPREAD, TraceReader, open_trace, read_trace, spread
from ..recordings.sinumerik.signals import ControllerAxis

FAULTY = Fault.TORQUE_STUCK | Fault.ANGLE_STUCK | Fault.TABLE_STUCK | Fault.TABLE_DISAGREES
LEAST_FAULTY_S = 1.0
"""Time for which a channel fails before that is told; a level that has shifted stays so."""


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


def failing(blocks: Iterable[FeatureBlock]) -> str:
    """Channels that fail within a recording, in the words of a running axis; empty if none does."""
    faulty_s = Counter[Fault]()
    for block in blocks:
        kinds = block.fault & (FAULTY | Fault.TABLE_SHIFTED)
        faulty_s.update(dict.fromkeys(kinds, block.duration_s))
    shifted = [FAULT_WORDS[Fault.TABLE_SHIFTED]] if faulty_s.pop(Fault.TABLE_SHIFTED, 0.0) else []
    long = {kind: span_s for kind, span_s in faulty_s.items() if span_s >= LEAST_FAULTY_S}
    told = [f"{FAULT_WORDS[kind]} ({span_s:.3g} s)" for kind, span_s in sorted(long.items())]
    return "; ".join([*told, *shifted])


def examine_within(machine: Machine, traces: Sequence[Path]) -> list[Finding]:
    """Every check, and whether a channel fails within a file; errors as `open_trace`."""
    found, words = examine(machine, traces), list[str]()
    if any(each.forbids for each in found):
        return found
    for path in traces:
        downsampler = make_downsampler(machine)
        with open_recording(machine, path) as reader:
            frames = reported(reader, f"watching {path.name}")
            said = failing(block for frame in frames for block in downsampler.push(frame))
            words += [said] if said else []
    verdict, said = Verdict.DOUBTFUL if words else Verdict.FITS, "; ".join(words)
    remedy = "look at sensor, cable and signal; no answer rests on what fails" if words else ""
    return [*found, Finding("channels", verdict, said or "no channel fails", remedy=remedy)]


def remarks_of(found: Iterable[Finding]) -> tuple[str, ...]:
    """Sentences of `doctor` on the channels that fail within recordings."""
    said = [each for each in found if each.is_doubtful and each.name == "channels"]
    return tuple(f"doctor: {each.sentence}" for each in said)


def examine(machine: Machine, traces: Sequence[Path], most: int = MOST_SPREAD) -> list[Finding]:
    """Every check that these files allow; errors as `open_trace`."""
    frames: list[SampleFrame] = []
    unread: dict[str, None] = {}
    for path in traces:
        with open_recording(machine, path) as reader:
            frames += spread(reported(reader, f"examining {path.name}"), most)
            unread |= dict.fromkeys(reader.ignored)
    return check_plausibility(machine, frames, tuple(unread))


def require_sound(
    found: Iterable[Finding], traces: Sequence[Path], strict: Collection[str] = ()
) -> None:
    """Go on only where an answer can be right, by what the checks of these recordings found.

    Args:
        strict: names of checks whose every doubt forbids an answer.

    Raises ExaminationError: a mistake of unit, sign or column; the text names the worst.
    """
    for each in found:
        if each.forbids or (each.is_doubtful and each.name in strict):
            names = ", ".join(str(path) for path in traces)
            raise ExaminationError(
                f"{names}: {each.sentence}; {each.remedy} (see `edge-service doctor`)"
            )
