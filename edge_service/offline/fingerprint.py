"""`edge-service fingerprint`: the tests of an axis as one JSON file and one page."""

import json
import math
from collections.abc import Iterator, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from ..atomic import write_whole
from ..command_answer import Answer, progress
from ..config import ConfigError, load_machine
from ..fingerprint.compare import FigureChange, appeared_figures, compare_fingerprints
from ..fingerprint.fingerprint import fingerprint_axis
from ..fingerprint.response.control_response import Mode, servo_tuning
from ..fingerprint.result import AxisFingerprint, FingerprintError, Status, read_fingerprint
from ..recordings.columns import TraceError
from ..recordings.sinumerik.tuning import is_tuning, read_tuning
from .drift import DriftReport, compare_days
from .recordings import examine_within, read_recording, remarks_of, require_sound
from .report.fingerprint_page import WORDING, draw_drift, draw_sections, headline, plain
from .report.page import as_svg, rendered
from .report.quantities import estimate

RESPONSE = "frequency_response"


@dataclass(frozen=True, slots=True, eq=False)
class FingerprintDocument(AxisFingerprint):
    """Content of `fingerprint.json`; null is left out there."""

    verdict: str  # one sentence
    # changes, appeared: against the baseline
    changes: list[dict[str, Any]] | None = None
    appeared: tuple[str, ...] | None = None
    # stated, modes: of a servo tuning: what the control states, notches and peaks
    stated: dict[str, float] | None = None
    modes: list[Mode] | None = None
    # remarks: what fails within the recordings
    remarks: tuple[str, ...] | None = None


def fingerprint(
    machine_file: Path,
    traces: Sequence[Path],
    out_dir: Path,
    baseline_file: Path | None = None,
    axis_number: int | None = None,
    by: Sequence[str] = (),
) -> Answer:
    """Write `fingerprint.json` and `report.html` into `out_dir`; returns a summary.

    Moves that several recordings repeat are compared, with the first as the oldest (`drift.json`).
    A servo tuning or frequency response of a SINUMERIK is a recording as well; on its own it needs
    no machine file.

    Raises ConfigError, TraceError, FingerprintError, ExaminationError.
    """
    names = [path.name for path in traces]
    if not names:
        raise FingerprintError("no recording given; expected one trace or more")
    if twice := [name for name in names if names.count(name) > 1]:
        raise FingerprintError(f"two recordings are called {twice[0]}; expected each once")
    tunings = list(filter(is_tuning, traces))
    if len(tunings) > 1:
        raise FingerprintError(f"{tunings[1]}: a second servo tuning; expected one at most")
    baseline = None if baseline_file is None else read_fingerprint(baseline_file)
    measured = read_tuning(tunings[0]) if tunings else None
    recorded = [path for path in traces if path not in tunings]
    machine = load_machine(machine_file, axis_number) if recorded or measured is None else None
    axis = "" if measured is None else measured.axis or tunings[0].stem
    axis = axis if machine is None else machine.axis.name
    if baseline is not None and baseline.machine != axis:
        raise FingerprintError(f"{baseline_file}: of axis {baseline.machine}, expected axis {axis}")
    found = AxisFingerprint(axis, (), {})
    days: DriftReport | None = None
    modes: list[Mode] | None = None
    remarks: tuple[str, ...] = ()
    if machine is not None:
        several = len(recorded) > 1
        frames = {path: read_recording(machine, path, keep_all=several) for path in recorded}
        require_sound(examined := examine_within(machine, recorded), recorded)
        remarks = remarks_of(examined)
        progress("friction, stiffness, backlash, modes")
        found = fingerprint_axis(machine, {p.name: each for p, each in frames.items()}, baseline)
        if several:
            progress("comparing moves")
            with nullcontext() if by else suppress(ConfigError, TraceError):
                days = compare_days(machine, frames, by)
    if measured is not None:
        section, modes = servo_tuning(measured)
        sources = tuple(sorted({*found.sources, tunings[0].name}))
        found = replace(found, sources=sources, sections={**found.sections, RESPONSE: section})
    changes = None if baseline is None else compare_fingerprints(found, baseline)
    document = FingerprintDocument(
        found.machine,
        found.sources,
        found.sections,
        _verdict(found, changes, days),
        None if changes is None else [each.document() for each in changes],
        None if baseline is None else appeared_figures(found, baseline),
        None if measured is None else dict(measured.stated),
        modes,
        remarks or None,
    )
    progress("pictures")
    page = rendered(
        "fingerprint.html",
        {"shown": estimate, "plain": plain},
        found=document,
        changes=sorted(changes or (), key=lambda each: (not each.changed, -abs(each.sigmas))),
        wording=WORDING,
        headlines={name: headline(name, section) for name, section in found.sections.items()},
        pictures={
            name: as_svg(figure, name) for name, figure in draw_sections(found, baseline).items()
        },
        determined=Status.DETERMINED,
        days=days,
        moves=None if days is None else as_svg(draw_drift(days), "drift"),
    )
    content = TypeAdapter(FingerprintDocument).dump_python(document, mode="json")
    kept = {name: each for name, each in content.items() if each is not None}
    write_whole(out_dir / "fingerprint.json", json.dumps(kept, indent=2, allow_nan=False) + "\n")
    write_whole(out_dir / "report.html", page)
    lines = [f"axis {axis}: {document.verdict}", *_section_lines(document), *remarks]
    if document.appeared:
        lines.append(f"seen only now: {', '.join(map(plain, document.appeared))}")
    if days is not None:
        days.write(out_dir)
        lines.append(f"from recording to recording: {days.verdict}")
    return Answer("\n".join([*lines, f"report: {out_dir / 'report.html'}"]), document)


def _verdict(
    found: AxisFingerprint, changes: Sequence[FigureChange] | None, days: DriftReport | None
) -> str:
    """Greatest change of each test against the baseline, or from day to day; or what is known."""
    if changes is None:
        if days is not None:
            return days.verdict
        sections = found.sections.values()
        known = sum(section.status is Status.DETERMINED for section in sections)
        return f"{known} of {len(sections)} tests are determined"
    greatest: dict[str, str] = {}
    order = sorted(changes, key=lambda c: -abs(c.relative) if c.old.value else -math.inf)
    for each in sorted(order, key=lambda c: ".rigid_" in c.name):  # friction itself first
        if each.changed:
            share, side = abs(each.relative), "higher" if each.relative > 0.0 else "lower"
            by = f"{100.0 * share:.0f} % {side}" if share <= 1.0 else estimate(each.change)
            test = "friction" if ".rigid_" in each.name else each.name.partition(".")[0]
            greatest.setdefault(test, f"{plain(each.name)} {by}")
    if greatest:
        return f"against the baseline: {', '.join(greatest.values())}"
    if not changes:
        return "against the baseline: cannot tell, no figure is determined in both"
    compared = ", ".join(dict.fromkeys(plain(each.name.partition(".")[0]) for each in changes))
    return f"nothing has changed against the baseline ({len(changes)} figures of {compared})"


def _section_lines(found: FingerprintDocument) -> Iterator[str]:
    """A line a test: its chief figure, or why there is none; every figure of a servo tuning."""
    for name, section in found.sections.items():
        title = WORDING[name].title
        if section.status is not Status.DETERMINED:
            record = f"record `edge-service motion {section.motion}`"
            yield f"{title}: undetermined, {section.reason}; {record}"
        elif name == RESPONSE and found.stated is not None:
            for key, each in section.figures.items():
                said = estimate(each) if each.determined else f"undetermined, {each.note}"
                yield f"{title}: {plain(key)} {said}"
            for key, value in found.stated.items():
                yield f"{title}: the control states: {plain(key)} {value:.4g} kg m2"
            if found.modes:
                pairs = [f"{m.antiresonance_hz:.4g}/{m.resonance_hz:.4g}" for m in found.modes]
                yield f"{title}: notches and peaks, Hz: {', '.join(pairs)}"
        else:
            chief = headline(name, section) or section.figures
            key, figure = next(pair for pair in chief.items() if math.isfinite(pair[1].value))
            yield f"{title}: {plain(key)} {estimate(figure)}"
