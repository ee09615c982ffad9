"""`edge-service response`: modes and inertia from a frequency response that a control measured."""

import json
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..atomic import replaced_file
from ..command_answer import Answer
from ..fingerprint.compare import compare_fingerprints
from ..fingerprint.document import FingerprintError, read_fingerprint, to_document
from ..fingerprint.fingerprint import AxisFingerprint
from ..fingerprint.response.control_response import (
    LOWEST_HZ,
    Mode,
    measure_control_response,
    modes_of,
    relative_error,
)
from ..fingerprint.response.frequency_response import FrequencyResponse
from ..fingerprint.result import Section, Status, examined
from ..recordings.columns import TraceError
from ..recordings.forms.registry import head_of, name_of
from ..recordings.sinumerik.tuning import MeasuredResponse, is_tuning, read_tuning
from ..regression.interval_estimate import IntervalEstimate, undetermined
from .fingerprint import render
from .report.documents import ResponseDocument
from .report.fingerprint_figures import draw_sections
from .report.fingerprint_wording import plain
from .report.pictures import write_png
from .report.quantities import estimate

SECTION = "frequency_response"
MOTION = "multisine"
_INERTIA = "response_inertia_kg_m2"
_MECHANICS = {
    *(_INERTIA, "motor_inertia_kg_m2", "load_inertia_kg_m2"),
    *("stiffness_nm_per_rad", "damping_nm_s_per_rad"),
}
_ALIKE = math.log(2.0)


def response(
    source: Path,
    out_dir: Path,
    baseline_file: Path | None = None,
    *,
    name: str = "response.json",
) -> Answer:
    """Write the document, `report.html` and a picture into `out_dir`; returns a summary.

    Args:
        source: XML of a SINUMERIK's auto servo tuning, or of a frequency response measured with it.
        baseline_file: an older `response.json` of the axis, to compare with.
        name: of the document.

    Raises:
        TraceError: the file cannot be read as such.
        FingerprintError: the baseline is none, or of another axis.
    """
    measured = _read(source)
    axis = measured.axis or source.stem
    baseline = None if baseline_file is None else read_fingerprint(baseline_file)
    if baseline is not None and baseline.machine != axis:
        raise FingerprintError(f"{baseline_file}: of axis {baseline.machine}, expected axis {axis}")
    whole = _frequency_response(measured)
    section = examined(
        MOTION, lambda: measure_control_response(whole, speed_over_torque=bool(measured.unit))
    )
    section = _with_stated(section, measured.stated)
    found = AxisFingerprint(axis, (source.name,), {SECTION: section})
    changes = () if baseline is None else compare_fingerprints(found, baseline)
    modes = modes_of(whole.within(LOWEST_HZ, math.inf))
    document = _document(found, measured, modes)
    figures = draw_sections(found, baseline)
    with replaced_file(out_dir / name) as file:
        file.write(json.dumps(document, indent=2, allow_nan=False) + "\n")
    with replaced_file(out_dir / "report.html") as file:
        file.write(render(found, baseline, changes, figures))
    for drawn, figure in figures.items():
        write_png(figure, out_dir / f"{drawn}.png")
    lines = [f"axis {axis}, {source.name}", *_lines(section, measured.stated, modes)]
    if baseline is not None:
        compared = ", ".join(plain(each.name) for each in changes)
        named = ", ".join(plain(each.name) for each in changes if each.changed)
        lines.append(f"changed against the baseline: {named or 'nothing'}, of {compared or 'none'}")
    words = "\n".join([*lines, f"report: {out_dir / 'report.html'}"])
    return Answer(words, ResponseDocument.model_validate(document))


def is_servo_tuning(source: Path) -> bool:
    """Tell whether a file holds a response instead of samples; False if it cannot be read."""
    try:
        return is_tuning(head_of(source))
    except OSError:
        return False


def _read(source: Path) -> MeasuredResponse:
    """The response in a file. Raises TraceError, also for what is none, by its name."""
    try:
        head = head_of(source)
    except OSError as error:
        raise TraceError(f"{source}: cannot be read ({error.strerror or error})") from None
    if not is_tuning(head):
        raise TraceError(
            f"{source}: no servo tuning or frequency response of a SINUMERIK but "
            f"{name_of(head, source)}"
        )
    return read_tuning(source)


def _frequency_response(measured: MeasuredResponse) -> FrequencyResponse:
    """The response as a fit takes it: continuous, and without a window, as nobody knows of one."""
    return FrequencyResponse(
        frequency_hz=measured.frequency_hz,
        response=measured.response,
        relative_error=relative_error(measured.coherence, measured.averages),
        coherence=measured.coherence,
        averages=measured.averages,
        unit=measured.unit,
        period_s=0.0,
        hold=False,
        resolution_hz=0.0,
    )


def _with_stated(section: Section, stated: Mapping[str, float]) -> Section:
    """The section with what the control states as a note to what was found.

    Inertias far from each other are in other units, or of other parts: then none is told.
    """
    figures = dict(section.figures)
    total = stated.get("total_inertia_kg_m2")
    if total and _INERTIA in figures and not _alike(figures[_INERTIA].value, total):
        note = (
            f"{figures[_INERTIA].value:.3g} kg m2, where the control states {total:.3g}: in doubt"
        )
        for name in _MECHANICS & figures.keys():
            figures[name] = undetermined(figures[name].unit, note)
        return replace(section, figures=figures)
    for name, key in ((_INERTIA, "total_inertia_kg_m2"), ("motor_inertia_kg_m2",) * 2):
        if key in stated and name in figures:
            figures[name] = _noted(figures[name], f"the control states {stated[key]:.4g} kg m2")
    return replace(section, figures=figures)


def _alike(found: float, stated: float) -> bool:
    return math.isfinite(found) and found > 0.0 and abs(math.log(found / stated)) < _ALIKE


def _noted(figure: IntervalEstimate, note: str) -> IntervalEstimate:
    return replace(figure, note=note)


def _document(
    found: AxisFingerprint, measured: MeasuredResponse, modes: list[Mode]
) -> dict[str, Any]:
    return {
        **to_document(found),
        "stated": measured.stated,
        "modes": [
            {
                "antiresonance_hz": mode.antiresonance_hz,
                "resonance_hz": mode.resonance_hz,
                "height": mode.height,
            }
            for mode in modes
        ],
    }


def _told(figure: IntervalEstimate) -> str:
    """The figure, or why there is none."""
    return estimate(figure) if figure.determined else f"undetermined, {figure.note}"


def _lines(section: Section, stated: Mapping[str, float], modes: list[Mode]) -> list[str]:
    if section.status is Status.UNDETERMINED:
        return [f"modes and inertia: undetermined, {section.reason}"]
    lines = [f"{plain(name)}: {_told(figure)}" for name, figure in section.figures.items()]
    lines += [
        f"the control states: {plain(name)} {each:.4g} kg m2" for name, each in stated.items()
    ]
    if modes:
        peaks = ", ".join(f"{mode.antiresonance_hz:.4g}/{mode.resonance_hz:.4g}" for mode in modes)
        lines.append(f"notches and peaks of the response, Hz: {peaks}")
    return lines
