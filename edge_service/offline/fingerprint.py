"""`edge-service fingerprint`: the tests of an axis as one JSON file and one page."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from ..atomic import replaced_file
from ..command_answer import Answer
from ..config import load_machine
from ..fingerprint.compare import (
    FigureChange,
    appeared_figures,
    compare_fingerprints,
)
from ..fingerprint.document import (
    FingerprintError,
    read_fingerprint,
    to_document,
)
from ..fingerprint.fingerprint import AxisFingerprint, fingerprint_axis
from ..fingerprint.result import Status
from ..messages.arrays import finite_or_none
from ..messages.samples import SampleFrame
from ..models.machine import Machine
from .examination import require_sound
from .recordings import Progress, read_recording, silent
from .report.documents import FingerprintDocument
from .report.fingerprint_figures import draw_sections
from .report.fingerprint_wording import WORDING, headline, plain
from .report.page import rendered
from .report.pictures import as_svg, write_png
from .report.quantities import brief, estimate


def fingerprint(
    machine_file: Path,
    traces: Sequence[Path],
    out_dir: Path,
    baseline_file: Path | None = None,
    pictures_dir: Path | None = None,
    axis_number: int | None = None,
    progress: Progress = silent,
) -> Answer:
    """Write `fingerprint.json` and `report.html` into `out_dir`; returns a summary.

    Args:
        pictures_dir: each picture of the page is also written there, as SECTION.png.

    Raises:
        ConfigError: the machine file is wrong.
        TraceError: a recording cannot be read.
        FingerprintError: no recording, two of one name, a baseline that is none or of another axis.
        ExaminationError: a unit, a sign or a column is wrong.
    """
    machine = load_machine(machine_file, axis_number)
    baseline = None if baseline_file is None else read_fingerprint(baseline_file)
    if baseline is not None and baseline.machine != machine.axis.name:
        raise FingerprintError(
            f"{baseline_file}: of axis {baseline.machine}, expected axis {machine.axis.name}"
        )
    recordings = _recordings(machine, traces)
    require_sound(machine, traces, progress=progress)
    progress("friction, stiffness, backlash, modes")
    found = fingerprint_axis(machine, recordings, baseline)
    changes = () if baseline is None else compare_fingerprints(found, baseline)
    document = to_document(found)
    if baseline is not None:
        document["changes"] = [_change_document(change) for change in changes]
        document["appeared"] = list(appeared_figures(found, baseline))
    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    progress("pictures")
    figures = draw_sections(found, baseline)
    page = render(found, baseline, changes, figures)
    with replaced_file(out_dir / "fingerprint.json") as file:
        file.write(text)
    with replaced_file(out_dir / "report.html") as file:
        file.write(page)
    if pictures_dir is not None:
        for name, figure in figures.items():
            write_png(figure, pictures_dir / f"{name}.png")
    summary = _summary(found, baseline, changes, out_dir)
    return Answer(summary, FingerprintDocument.model_validate(document))


def render(
    found: AxisFingerprint,
    baseline: AxisFingerprint | None,
    changes: Sequence[FigureChange],
    figures: Mapping[str, Figure],
) -> str:
    """The page as HTML; nothing in it is loaded from elsewhere."""
    return rendered(
        "fingerprint.html",
        {"shown": estimate, "brief": brief, "plain": plain},
        found=found,
        baseline=baseline,
        appeared=() if baseline is None else appeared_figures(found, baseline),
        changes=sorted(changes, key=lambda change: (not change.changed, -abs(change.sigmas))),
        wording=WORDING,
        headlines={name: headline(name, section) for name, section in found.sections.items()},
        pictures={name: as_svg(figure, name) for name, figure in figures.items()},
        determined=Status.DETERMINED,
    )


def _recordings(machine: Machine, traces: Sequence[Path]) -> dict[str, SampleFrame]:
    if not traces:
        raise FingerprintError("no recording given; expected one trace or more")
    names = [path.name for path in traces]
    for name in names:
        if names.count(name) > 1:
            raise FingerprintError(f"two recordings are called {name}; expected each once")
    return {path.name: read_recording(machine, path) for path in traces}


def _change_document(change: FigureChange) -> dict[str, str | float | bool | None]:
    return {
        "figure": change.name,
        "old": change.old.value,
        "new": change.new.value,
        "change": change.change.value,
        "low": change.change.low,
        "high": change.change.high,
        "unit": change.change.unit,
        "relative": finite_or_none(change.relative),
        "sigmas": change.sigmas,
        "significant": change.significant,
        "material": change.material,
    }


def _summary(
    found: AxisFingerprint,
    baseline: AxisFingerprint | None,
    changes: Sequence[FigureChange],
    out_dir: Path,
) -> str:
    lines = []
    for name, section in found.sections.items():
        if section.status is Status.DETERMINED:
            chief = headline(name, section) or section.figures
            key, figure = next(
                (pair for pair in chief.items() if math.isfinite(pair[1].value)),
            )
            lines.append(f"{WORDING[name].title}: {plain(key)} {estimate(figure)}")
        else:
            lines.append(
                f"{WORDING[name].title}: undetermined, {section.reason}; "
                f"record `edge-service motion {section.motion}`"
            )
    if baseline is not None:
        lines.append(_against_baseline(changes))
        new = ", ".join(plain(name) for name in appeared_figures(found, baseline))
        lines += [f"seen only now: {new}"] if new else []
    lines.append(f"report: {out_dir / 'report.html'}")
    return "\n".join(lines)


def _against_baseline(changes: Sequence[FigureChange]) -> str:
    """Names of what changed, or of what was compared where nothing did; the rest is not known."""
    named = ", ".join(plain(change.name) for change in changes if change.changed)
    if named:
        return f"changed against the baseline: {named}"
    if not changes:
        return "changed against the baseline: cannot tell, no figure is determined in both"
    compared = ", ".join(plain(change.name) for change in changes)
    return f"changed against the baseline: nothing of {len(changes)} figures: {compared}"
