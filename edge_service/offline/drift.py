"""The same moves of one axis in recordings of several days: words, picture, `drift.json`."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..atomic import replaced_file
from ..checks.torque import judge_sign
from ..command_answer import Answer
from ..config import ConfigError, load_machine
from ..fingerprint.drift import Drift, SectionDrift, compare_moves
from ..fingerprint.moves import CUTOFF_HZ, Move, by_context, described, find_moves, most_frequent
from ..messages.samples import SampleFrame
from ..models.machine import Machine
from ..models.screw.ball_screw import transmission_ratio
from ..recordings.columns import TraceError
from ..regression.interval_estimate import LEVEL
from ..regression.prepared_run import PreparationSettings
from .examination import ExaminationError
from .recordings import Progress, open_recording, reported, silent
from .report.page import ESTIMATE, MUTED, STYLE, TRUTH
from .report.quantities import SHOWN_UNITS, amount, estimate

BLOCK_COLUMNS = ("HFBlockEvent.ActiveTool", "HFBlockEvent.GCode")
"""Columns of Industrial Edge that tell one program section from another."""

_MOST_ROWS = 5_000_000


QUANTITIES = {
    "friction_nm": "friction (torque that turns with the direction)",
    "load_nm": "load (torque that does not: gravity, counterweight, offset)",
    "torque_nm": "torque, friction and load together, for there is no way back",
    "torque_spread_nm": "spread of the torque along the move",
    "lag_m": "following error that turns with the direction",
    "offset_m": "following error that does not",
    "following_error_m": "following error",
    "lost_motion_m": "stretch between the encoders that turns with the direction",
    "stretch_m": "stretch between the encoders; for both ways what does not turn",
}
"""Quantity -> what it is."""
_DEAF_TO_HEAT = ("load_nm",)


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
        """A sentence about each quantity of a section, and one about its temperature."""
        lines = []
        for drift in each.drifts:
            first = amount(drift.values[0], drift.changes[-1].unit)
            words = f"{_short(drift.name)}: {first} at first, change {estimate(drift.changes[-1])}"
            if drift.since is not None:
                is_heat = each.may_be_heat and drift.name not in _DEAF_TO_HEAT
                heat = ", which the heat may explain" if is_heat else ""
                lines.append(f"{words}: {_by(drift)} since {self.recordings[drift.since]}{heat}")
                continue
            later = zip(self.recordings[1:], drift.changed, strict=True)
            between = ", ".join(name for name, was in later if was)
            lines.append(f"{words}: {f'only in {between}' if between else 'within the scatter'}")
        if math.isfinite(each.heat):
            values = ", ".join(f"{value:.1f}" for value in each.temperature_c)
            return [*lines, f"temperature: {values} °C"]
        return [*lines, "temperature: not recorded, so heat cannot be told from wear"]

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


def drift(
    machine_file: Path,
    traces: Sequence[Path],
    out: Path | None = None,
    axis_number: int | None = None,
    by: Sequence[str] = (),
    progress: Progress = silent,
) -> Answer:
    """Compare recordings, oldest first; with `out` write `drift.json` there.

    Args:
        by: columns whose values must be alike as well; by default tool and block, where every
            recording has them.

    Raises:
        ConfigError: the machine file is wrong, a unit or a sign is, or nothing is common to all.
        TraceError: a recording cannot be read.
    """
    machine = load_machine(machine_file, axis_number)
    read = {path: _frames(machine, path, progress) for path in traces}
    progress("comparing moves")
    report = compare_days(machine, read, by)
    if out is not None:
        write_drift(report, out)
    said = [] if out is None else [f"written: {out / 'drift.json'}"]
    return Answer("\n".join([report.as_text(), *said]), report.as_dict())


def compare_days(
    machine: Machine, recordings: Mapping[Path, Sequence[SampleFrame]], by: Sequence[str] = ()
) -> DriftReport:
    """Moves that all recordings repeat, each against the first recording; errors as `drift`."""
    if len(recordings) < 2:
        raise DriftError("drift: expected two recordings or more, oldest first")
    for path, frames in recordings.items():
        for name in by:
            if name not in frames[0].channels:
                others = ", ".join(frames[0].channels)
                raise TraceError(f"{path}: no column {name!r} of numbers; it has {others}")
    everywhere = set.intersection(*(set(each[0].channels) for each in recordings.values()))
    names = tuple(by) or tuple(name for name in BLOCK_COLUMNS if name in everywhere)
    moves = [_moves(machine, path, frames, names) for path, frames in recordings.items()]
    sections = compare_moves(moves)
    if not sections:
        each = "; ".join(
            f"{path.name} has mostly {most_frequent(found)}"
            if found
            else f"{path.name} has no move"
            for path, found in zip(recordings, moves, strict=True)
        )
        raise DriftError(f"drift: no move is made three times in every recording: {each}")
    labels = tuple(path.name for path in recordings)
    return DriftReport(machine.axis.name, labels, names, sections)


def write_drift(report: DriftReport, out: Path) -> None:
    """Write `drift.json` into a folder."""
    with replaced_file(out / "drift.json") as file:
        file.write(json.dumps(report.as_dict(), indent=1, allow_nan=False) + "\n")


def _frames(machine: Machine, path: Path, progress: Progress) -> list[SampleFrame]:
    frames = []
    with open_recording(machine, path, keep_all=True) as reader:
        for frame in reported(reader, f"reading {path.name}", progress):
            frames.append(frame)
            if reader.rows_read > _MOST_ROWS:
                raise TraceError(f"{path}: more than {_MOST_ROWS} rows; cut the recording")
    return frames


def _moves(
    machine: Machine, path: Path, frames: Sequence[SampleFrame], names: Sequence[str]
) -> list[Move]:
    ratio = transmission_ratio(machine.axis.lead_m)
    try:
        settings = PreparationSettings.sampled(ratio, frames, CUTOFF_HZ)
        finding = judge_sign(frames, settings)
        if finding is not None and finding.forbids:  # its friction would pass for a load
            raise ExaminationError(f"{path}: {finding.sentence}; {finding.remedy}")
        return [
            move
            for context, part in by_context(frames, names)
            for move in find_moves(part, ratio, context)
        ]
    except ValueError as error:
        raise TraceError(f"{path}: {error}") from None


def place(each: SectionDrift, by: Sequence[str]) -> str:
    """A section in words: its move, and what else tells it from others."""
    move = each.section.pattern
    context = "".join(f", {name} {value:g}" for name, value in zip(by, move.context, strict=True))
    return f"{described(move)}{context}"


def verdict(sections: Sequence[SectionDrift], by: Sequence[str]) -> str:
    """Changes in one sentence, or that there were none and what was compared."""
    changed = [
        f"{_short(drift.name)} {_by(drift)} ({place(each, by)})"
        for each in sections
        for drift in each.drifts
        if drift.since is not None
    ]
    if changed:
        heat = max((each.heat for each in sections if each.may_be_heat), key=abs, default=0.0)
        way = "warmer" if heat > 0.0 else "colder"
        warmer = f"; the axis was {abs(heat):.1f} K {way}, which may be all of it but for the load"
        return f"changed: {'; '.join(changed)}{warmer if heat else ''}"
    names = dict.fromkeys(_short(drift.name) for each in sections for drift in each.drifts)
    moves = "; ".join(place(each, by) for each in sections)
    return f"nothing changed beyond repeat scatter (compared: {', '.join(names)} of {moves})"


def _by(drift: Drift) -> str:
    """Size of a change: a share where the first value is no smaller than the change."""
    change = drift.changes[-1]
    if math.isfinite(drift.relative) and abs(drift.relative) <= 1.0:
        return f"{100.0 * drift.relative:+.1f} %"
    return f"{'+' if change.value > 0.0 else ''}{amount(change.value, change.unit)}"


def _short(name: str) -> str:
    return name.rpartition("_")[0].replace("_", " ")


def draw_drift(report: DriftReport) -> Figure:
    """Change against the first recording with its interval; what is beyond the scatter is blue."""
    sections, recordings = report.sections, report.recordings
    across = max(len(each.drifts) for each in sections)
    names = [name if len(name) <= 12 else f"{name[:5]}…{name[-6:]}" for name in recordings]
    with mpl.rc_context(STYLE):
        size = (1.75 * across, 0.2 + 2.3 * len(sections))
        figure = Figure(figsize=size, layout="constrained")
        panels = figure.subplots(len(sections), across, squeeze=False)
        for row, each in zip(panels, sections, strict=True):
            for axes in row[len(each.drifts) :]:
                axes.set_axis_off()
            title = place(each, report.by).replace(" at ", "\nat ").replace(", ", "\n")
            row[0].set_ylabel(title, fontsize=7)
            for axes, drift in zip(row, each.drifts, strict=False):
                _draw(axes, drift)
                axes.set_xticks(range(len(names)), names, fontsize=6, rotation=30, ha="right")
    return figure


def _draw(axes: Axes, drift: Drift) -> None:
    unit, factor = SHOWN_UNITS.get(drift.changes[0].unit, (drift.changes[0].unit, 1.0))
    axes.axhline(0.0, color=MUTED, lw=1.0)
    axes.plot(0, 0.0, "o", color=TRUTH, ms=4)
    for number, (change, changed) in enumerate(zip(drift.changes, drift.changed, strict=True), 1):
        colour = ESTIMATE if changed else MUTED
        axes.vlines(number, factor * change.low, factor * change.high, color=colour, lw=2.0)
        axes.plot(number, factor * change.value, "o", color=colour, ms=4)
    axes.set_title(f"{_short(drift.name)}, {unit}", fontsize=8)
    axes.tick_params(axis="y", labelsize=7)
    axes.margins(x=0.25)
