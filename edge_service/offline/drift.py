"""The same moves of one axis in recordings of several days, in words and as `drift.json`."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..atomic import write_whole
from ..checks.torque import judge_sign, rows_in_motion
from ..command_answer import Answer, progress
from ..config import ConfigError, load_machine
from ..fingerprint.compare import Drift, SectionDrift, compare_moves
from ..fingerprint.moves import CUTOFF_HZ, Move, described, find_moves, most_frequent
from ..messages.samples import SampleFrame
from ..models.machine import Machine
from ..models.screw.ball_screw import transmission_ratio
from ..recordings.columns import TraceError
from ..regression.interval_estimate import LEVEL
from ..regression.prepared_run import PreparationSettings
from .recordings import ExaminationError, read_recording
from .report.quantities import amount, estimate, words

BLOCK_COLUMNS = ("HFBlockEvent.ActiveTool", "HFBlockEvent.GCode")
"""Columns of Industrial Edge that tell one program section from another."""


@dataclass(frozen=True, slots=True)
class DriftReport:
    """Moves that were compared, and what changed."""

    axis: str
    recordings: tuple[str, ...]  # their names, the first is what the others are held against
    by: tuple[str, ...]  # columns that tell sections apart beside their course
    sections: tuple[SectionDrift, ...]

    @property
    def verdict(self) -> str:
        """Changes in one sentence, or that there were none and what was compared."""
        changed = [
            f"{short(drift.name)} {_by(drift)} ({self.place(each)})"
            for each in self.sections
            for drift in each.drifts
            if drift.since is not None
        ]
        if not changed:
            names = dict.fromkeys(short(d.name) for each in self.sections for d in each.drifts)
            moves = "; ".join(map(self.place, self.sections))
            compared = f"{', '.join(names)} of {moves}"
            return f"nothing changed beyond repeat scatter (compared: {compared})"
        said = f"changed: {'; '.join(changed)}"
        heat = max((each.heat for each in self.sections if each.may_be_heat), key=abs, default=0.0)
        if not heat:
            return said
        way = f"{abs(heat):.1f} K {'warmer' if heat > 0.0 else 'colder'}"
        return f"{said}; the axis was {way}, which may be all of it but for the load"

    def place(self, each: SectionDrift) -> str:
        """A section in words: its move, and what else tells it from others."""
        move = each.section.pattern
        pairs = zip(self.by, move.context, strict=True)
        return described(move) + "".join(f", {name} {value:g}" for name, value in pairs)

    def title(self, each: SectionDrift) -> str:
        """A section in words: its move, its context, its repeats."""
        ways = "there and back" if each.section.both_ways else "one way"
        return f"{self.place(each)}, {ways} ({', '.join(map(str, each.section.repeats))} repeats)"

    def lines(self, each: SectionDrift) -> list[str]:
        """A sentence about each quantity of a section, and one about its temperature."""
        lines = []
        for drift in each.drifts:
            first = amount(drift.values[0], drift.changes[-1].unit)
            if drift.since is not None:
                is_heat = each.may_be_heat and drift.name != "load_nm"
                heat = ", which the heat may explain" if is_heat else ""
                found = f"{_by(drift)} since {self.recordings[drift.since]}{heat}"
            else:
                later = zip(self.recordings[1:], drift.changed, strict=True)
                between = ", ".join(name for name, was in later if was)
                found = f"only in {between}" if between else "within the scatter"
            change = estimate(drift.changes[-1])
            lines.append(f"{short(drift.name)}: {first} at first, change {change}: {found}")
        values = ", ".join(f"{value:.1f}" for value in each.temperature_c)
        unknown = "not recorded, so heat cannot be told from wear"
        return [*lines, f"temperature: {f'{values} °C' if math.isfinite(each.heat) else unknown}"]

    def document(self) -> dict[str, Any]:
        """Content of `drift.json`; what is not recorded is null."""
        sections = []
        for each in self.sections:
            move = each.section.pattern
            quantities = []
            for drift in each.drifts:
                changes = [
                    {"change": c.value, "low": c.low, "high": c.high, "changed": changed}
                    for c, changed in zip(drift.changes, drift.changed, strict=True)
                ]
                since = None if drift.since is None else self.recordings[drift.since]
                values = {"name": drift.name, "values": list(drift.values)}
                quantities.append(values | {"changes": changes, "changed_since": since})
            told: dict[str, Any] = {"from_m": move.start_m, "to_m": move.end_m}
            told |= {"speed_m_s": abs(move.speed_m_s), "both_ways": each.section.both_ways}
            told |= {"context": dict(zip(self.by, move.context, strict=True))}
            told["repeats"] = list(each.section.repeats)
            warmth = [t if math.isfinite(t) else None for t in each.temperature_c]
            sections.append(told | {"temperature_c": warmth, "quantities": quantities})
        return {
            "schema": "drift/1",
            "axis": self.axis,
            "level": LEVEL,
            "recordings": list(self.recordings),
            "verdict": self.verdict,
            "sections": sections,
        }

    def write(self, out: Path) -> None:
        text = json.dumps(self.document(), indent=1, allow_nan=False)
        write_whole(out / "drift.json", text + "\n")


def drift(
    machine_file: Path,
    traces: Sequence[Path],
    out: Path | None = None,
    axis_number: int | None = None,
    by: Sequence[str] = (),
) -> Answer:
    """Compare recordings, oldest first; with `out` write `drift.json` there.

    The columns `by` must be alike as well; by default tool and block, where all have them.

    Raises ConfigError, TraceError.
    """
    machine = load_machine(machine_file, axis_number)
    progress("reading")
    read = {path: read_recording(machine, path, keep_all=True) for path in traces}
    progress("comparing moves")
    report = compare_days(machine, read, by)
    lines = [f"axis {report.axis}: {report.verdict}"]
    for each in report.sections:
        lines += [report.title(each), *(f"  {line}" for line in report.lines(each))]
    if out is not None:
        report.write(out)
        lines.append(f"written: {out / 'drift.json'}")
    return Answer("\n".join(lines), report.document())


def compare_days(
    machine: Machine, recordings: Mapping[Path, SampleFrame], by: Sequence[str] = ()
) -> DriftReport:
    """Moves that all recordings repeat, each against the first recording; errors as `drift`."""
    if len(recordings) < 2:
        raise ConfigError("drift: expected two recordings or more, oldest first")
    for path, frame in recordings.items():
        for name in by:
            if name not in frame.channels:
                others = ", ".join(frame.channels)
                raise TraceError(f"{path}: no column {name!r} of numbers; it has {others}")
    everywhere = set.intersection(*(set(each.channels) for each in recordings.values()))
    names = tuple(by) or tuple(name for name in BLOCK_COLUMNS if name in everywhere)
    moves = [_moves(machine, path, frame, names) for path, frame in recordings.items()]
    sections = compare_moves(moves)
    if not sections:
        said = [
            f"{path.name} has {f'mostly {most_frequent(found)}' if found else 'no move'}"
            for path, found in zip(recordings, moves, strict=True)
        ]
        every = "no move is made three times in every recording"
        raise ConfigError(f"drift: {every}: {'; '.join(said)}")
    return DriftReport(machine.axis.name, tuple(path.name for path in recordings), names, sections)


def _moves(machine: Machine, path: Path, frame: SampleFrame, names: Sequence[str]) -> list[Move]:
    ratio = transmission_ratio(machine.axis.lead_m)
    try:
        settings = PreparationSettings.sampled(ratio, [frame], CUTOFF_HZ)
        finding = judge_sign(*rows_in_motion([frame], settings))
        if finding is not None and finding.forbids:  # its friction would pass for a load
            raise ExaminationError(f"{path}: {finding.sentence}; {finding.remedy}")
        return find_moves(frame, ratio, names)
    except ValueError as error:
        raise TraceError(f"{path}: {error}") from None


def _by(drift: Drift) -> str:
    """Size of a change: a share where the first value is no smaller than the change."""
    change = drift.changes[-1]
    if math.isfinite(drift.relative) and abs(drift.relative) <= 1.0:
        return f"{100.0 * drift.relative:+.1f} %"
    return f"{'+' if change.value > 0.0 else ''}{amount(change.value, change.unit)}"


def short(name: str) -> str:
    """A quantity's name in words, its unit left out.

    >>> short("lost_motion_m")
    'lost motion'
    """
    return words(name.rpartition("_")[0])
