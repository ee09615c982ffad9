"""`edge-service drift`: the same moves of one axis in recordings of several days."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...atomic import replaced_file
from ...checks.torque import judge_sign
from ...command_answer import Answer
from ...config import ConfigError, load_machine
from ...fingerprint.drift.changes import SectionDrift, compare_moves
from ...fingerprint.drift.moves import CUTOFF_HZ, Move, by_context, find_moves
from ...fingerprint.drift.sections import most_frequent
from ...messages.samples import SampleFrame
from ...models.machine import Machine
from ...models.screw.ball_screw import transmission_ratio
from ...recordings.columns import TraceError
from ...regression.interval_estimate import LEVEL
from ...regression.prepared_run import PreparationSettings
from ..examination import ExaminationError
from ..recordings import Progress, open_recording, reported, silent
from ..report.page import rendered
from ..report.pictures import as_svg, write_png
from .document import DriftDocument
from .picture import draw_drift
from .wording import QUANTITIES, place, sentences, verdict

BLOCK_COLUMNS = ("HFBlockEvent.ActiveTool", "HFBlockEvent.GCode")
"""Columns of Industrial Edge that tell one program section from another."""

_MOST_ROWS = 5_000_000


class DriftError(ConfigError):
    """Recordings that have nothing in common to compare; one line."""


@dataclass(frozen=True, slots=True)
class DriftReport:
    """Moves that were compared, and what changed.

    Attributes:
        axis: its name.
        recordings: their names, the first is what the others are held against.
        by: columns that tell sections apart beside their course.
    """

    axis: str
    recordings: tuple[str, ...]
    by: tuple[str, ...]
    sections: tuple[SectionDrift, ...]

    @property
    def verdict(self) -> str:
        """One sentence."""
        return verdict(self.sections, self.by)

    def as_text(self) -> str:
        """Verdict, then each section with its quantities."""
        lines = [f"axis {self.axis}: {self.verdict}"]
        for each in self.sections:
            lines += [self.title(each), *(f"  {line}" for line in self.lines(each))]
        return "\n".join(lines)

    def title(self, each: SectionDrift) -> str:
        """A section in words: its move, its context, its repeats."""
        ways = "there and back" if each.section.both_ways else "one way"
        repeats = ", ".join(map(str, each.section.repeats))
        return f"{place(each, self.by)}, {ways} ({repeats} repeats)"

    def lines(self, each: SectionDrift) -> list[str]:
        """Sentences about the quantities of a section."""
        return sentences(each, self.recordings)

    def as_dict(self) -> dict[str, Any]:
        """JSON-able values; what is not recorded is null."""
        return {
            "schema": "drift/1",
            "axis": self.axis,
            "level": LEVEL,
            "recordings": list(self.recordings),
            "verdict": self.verdict,
            "sections": [self._section(each) for each in self.sections],
        }

    def _section(self, each: SectionDrift) -> dict[str, Any]:
        move = each.section.pattern
        return {
            "from_m": move.start_m,
            "to_m": move.end_m,
            "speed_m_s": abs(move.speed_m_s),
            "context": dict(zip(self.by, move.context, strict=True)),
            "both_ways": each.section.both_ways,
            "repeats": list(each.section.repeats),
            "temperature_c": [t if math.isfinite(t) else None for t in each.temperature_c],
            "quantities": [
                {
                    "name": drift.name,
                    "values": list(drift.values),
                    "changes": [
                        {"change": c.value, "low": c.low, "high": c.high, "changed": changed}
                        for c, changed in zip(drift.changes, drift.changed, strict=True)
                    ],
                    "changed_since": None if drift.since is None else self.recordings[drift.since],
                }
                for drift in each.drifts
            ],
        }

    def answer(self, out: Path | None) -> Answer:
        """Words and document; the words say where the report is."""
        report = [] if out is None else [f"report: {out / 'report.html'}"]
        words = "\n".join([self.as_text(), *report])
        return Answer(words, DriftDocument.model_validate(self.as_dict()))


def drift(
    machine_file: Path,
    traces: Sequence[Path],
    out: Path | None = None,
    axis_number: int | None = None,
    by: Sequence[str] = (),
    progress: Progress = silent,
) -> DriftReport:
    """Compare recordings, oldest first; with `out` write `drift.json`, `drift.png`, `report.html`.

    Args:
        by: columns whose values must be alike as well; by default tool and block, where every
            recording has them.

    Raises:
        ConfigError: the machine file is wrong, a unit or a sign is, or nothing is common to all.
        TraceError: a recording cannot be read.
    """
    if len(traces) < 2:
        raise DriftError("drift: expected two recordings or more, oldest first")
    machine = load_machine(machine_file, axis_number)
    read = [_frames(machine, path, progress) for path in traces]
    names = _columns(traces, read, by)
    moves = [
        _moves(machine, path, frames, names) for path, frames in zip(traces, read, strict=True)
    ]
    progress("comparing moves")
    sections = compare_moves(moves)
    if not sections:
        raise DriftError(_nothing_common(traces, moves))
    labels = tuple(path.name for path in traces)
    report = DriftReport(machine.axis.name, labels, names, sections)
    if out is not None:
        _write(report, out)
    return report


def _frames(machine: Machine, path: Path, progress: Progress) -> list[SampleFrame]:
    frames = []
    with open_recording(machine, path, keep_all=True) as reader:
        for frame in reported(reader, f"reading {path.name}", progress):
            frames.append(frame)
            if reader.rows_read > _MOST_ROWS:
                raise TraceError(f"{path}: more than {_MOST_ROWS} rows; cut the recording")
    return frames


def _columns(
    traces: Sequence[Path], read: Sequence[Sequence[SampleFrame]], by: Sequence[str]
) -> tuple[str, ...]:
    """Columns that tell sections apart: as asked, else tool and block if all have them."""
    for path, frames in zip(traces, read, strict=True):
        for name in by:
            if name not in frames[0].channels:
                others = ", ".join(frames[0].channels)
                raise TraceError(f"{path}: no column {name!r} of numbers; it has {others}")
    everywhere = set.intersection(*(set(frames[0].channels) for frames in read))
    return tuple(by) or tuple(name for name in BLOCK_COLUMNS if name in everywhere)


def _moves(
    machine: Machine, path: Path, frames: Sequence[SampleFrame], names: Sequence[str]
) -> list[Move]:
    ratio = transmission_ratio(machine.axis.lead_m)
    try:
        _require_sign(path, frames, ratio)
        return [
            move
            for context, part in by_context(frames, names)
            for move in find_moves(part, ratio, context)
        ]
    except ValueError as error:
        raise TraceError(f"{path}: {error}") from None


def _require_sign(path: Path, frames: Sequence[SampleFrame], ratio: float) -> None:
    """Refuse a torque without a sign: its friction would pass for a load."""
    settings = PreparationSettings.sampled(ratio, frames, CUTOFF_HZ)
    finding = judge_sign(frames, settings)
    if finding is not None and finding.forbids:
        raise ExaminationError(f"{path}: {finding.sentence}; {finding.remedy}")


def _nothing_common(traces: Sequence[Path], moves: Sequence[Sequence[Move]]) -> str:
    each = "; ".join(
        f"{path.name} has mostly {most_frequent(found)}" if found else f"{path.name} has no move"
        for path, found in zip(traces, moves, strict=True)
    )
    return f"drift: no move is made three times in every recording: {each}"


def _write(report: DriftReport, out: Path) -> None:
    figure = draw_drift(report.sections, report.recordings, report.by)
    write_png(figure, out / "drift.png")
    with replaced_file(out / "drift.json") as file:
        file.write(json.dumps(report.as_dict(), indent=1, allow_nan=False) + "\n")
    page = rendered(
        "drift.html",
        {},
        report=report,
        picture=as_svg(figure, "drift"),
        quantities=QUANTITIES,
    )
    with replaced_file(out / "report.html") as file:
        file.write(page)
