"""`edge-service fingerprint`: the tests of an axis as one JSON file and one page."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, StrictUndefined

from ..atomic import replaced_file
from ..config import load_machine
from ..fingerprint.axis_fingerprint import AxisFingerprint, fingerprint_axis
from ..fingerprint.baseline_comparison import (
    FigureChange,
    appeared_figures,
    compare_fingerprints,
)
from ..fingerprint.fingerprint_document import (
    FingerprintError,
    read_fingerprint,
    to_document,
)
from ..fingerprint.identified import Identified
from ..fingerprint.section import Section, Status
from ..messages.samples import SampleFrame
from ..models.machine import Machine
from ..nodes.columns import column_maps
from ..nodes.convert import controller_axis
from ..trace.reader import read_trace
from .fingerprint_figures import draw_sections


@dataclass(frozen=True, slots=True)
class Wording:
    """How a section is told to a maintenance engineer."""

    title: str
    meaning: str
    headline: tuple[str, ...]


WORDING: Mapping[str, Wording] = {
    "friction": Wording(
        "Friction",
        "Torque that moving at constant speed takes. Its level follows preload and lubrication, a "
        "rise at low speed thin lubrication, the slope the grease.",
        ("coulomb_nm", "viscous_nm_s_per_rad", "stribeck_excess_nm"),
    ),
    "stiffness": Wording(
        "Stiffness along the stroke",
        "How hard it is to push the table away from where the motor holds it. A softer axis at all "
        "places points to the nut or the bearing.",
        ("stiffness_", "locked_resonance_"),
    ),
    "backlash": Wording(
        "Backlash and lost motion",
        "What the table stays behind when the motor turns back: wind-up by friction, and play.",
        ("lost_motion_",),
    ),
    "equability": Wording(
        "Evenness",
        "How much the torque varies at constant speed. A rise means rough running.",
        ("ripple_",),
    ),
    "signature": Wording(
        "Signature",
        "Where in each turn of the screw the torque varies: once per turn is a bent or misaligned "
        "screw, higher orders are the balls and their return.",
        ("once_per_rev_", "balls_"),
    ),
    "reversal_error": Wording(
        "Reversal error",
        "What a slow change of direction leaves on the workpiece, as on the quadrants of a circle.",
        ("following_peak_m", "encoder_step_m"),
    ),
    "frequency_response": Wording(
        "Frequency response",
        "How the motor answers a torque at each frequency. Falling modes mean a softer drive.",
        ("antiresonance_hz", "resonance_hz"),
    ),
    "inertia": Wording("Inertia", "What accelerating the whole axis takes.", ("inertia_kg_m2",)),
    "preload": Wording(
        "Preload of the nut",
        "From the drag, which guides and bearings disturb, and from the stiffness against that of "
        "the fresh axis.",
        ("preload_from_drag_n", "preload_from_stiffness_n"),
    ),
}
_SHOWN_UNITS = {"m": ("µm", 1e6), "N/m": ("N/µm", 1e-6), "s": ("ms", 1e3), "1": ("", 1.0)}


def fingerprint(
    machine_file: Path, traces: Sequence[Path], out_dir: Path, baseline_file: Path | None = None
) -> str:
    """Write `fingerprint.json` and `report.html` into `out_dir`; returns lines of summary.

    Raises:
        ConfigError: the machine file is wrong.
        TraceError: a recording cannot be read.
        FingerprintError: no recording, two of one name, a baseline that is none or of another axis.
    """
    machine = load_machine(machine_file)
    baseline = None if baseline_file is None else read_fingerprint(baseline_file)
    if baseline is not None and baseline.machine != machine.axis.name:
        raise FingerprintError(
            f"{baseline_file}: of axis {baseline.machine}, expected axis {machine.axis.name}"
        )
    found = fingerprint_axis(machine, _recordings(machine, traces), baseline)
    changes = () if baseline is None else compare_fingerprints(found, baseline)
    document = to_document(found)
    if baseline is not None:
        document["changes"] = [_change_document(change) for change in changes]
        document["appeared"] = list(appeared_figures(found, baseline))
    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    page = render(found, baseline, changes)
    with replaced_file(out_dir / "fingerprint.json") as file:
        file.write(text)
    with replaced_file(out_dir / "report.html") as file:
        file.write(page)
    return _summary(found, baseline, changes, out_dir)


def render(
    found: AxisFingerprint, baseline: AxisFingerprint | None, changes: Sequence[FigureChange]
) -> str:
    """The page as HTML; nothing in it is loaded from elsewhere."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    environment.filters.update(shown=shown, brief=brief, plain=plain)
    source = files(__package__).joinpath("templates/fingerprint.html").read_text("utf-8")
    return environment.from_string(source).render(
        found=found,
        baseline=baseline,
        appeared=() if baseline is None else appeared_figures(found, baseline),
        changes=sorted(changes, key=lambda change: (not change.changed, -abs(change.sigmas))),
        wording=WORDING,
        headlines={name: headline(name, section) for name, section in found.sections.items()},
        pictures=draw_sections(found, baseline),
        determined=Status.DETERMINED,
    )


def headline(name: str, section: Section) -> dict[str, Identified]:
    """The figures of a section that its summary names, as far as they have a number."""
    return {
        key: figure
        for key, figure in section.figures.items()
        if key.startswith(WORDING[name].headline) and math.isfinite(figure.value)
    }


def shown(figure: Identified) -> str:
    """Value and interval with the digits that the interval allows.

    >>> shown(Identified(8.0e-6, 7.6e-6, 8.4e-6, "m", 9.0))
    '8.00 µm (7.60 to 8.40)'
    """
    unit, factor = _SHOWN_UNITS.get(figure.unit, (figure.unit, 1.0))
    if not math.isfinite(figure.value):
        return "undetermined"
    half = 0.5 * (figure.high - figure.low) * factor
    value = figure.value * factor
    spread = half if math.isfinite(half) and half > 0.0 else abs(value) or 1.0
    decimals = 1 - math.floor(math.log10(spread))
    small = decimals > 5
    digits = max(decimals + 1 + math.floor(math.log10(abs(value) or spread)), 2)

    def number(bound: float) -> str:
        return (
            f"{bound * factor:#.{digits}g}" if small else f"{bound * factor:.{max(decimals, 0)}f}"
        )

    bounds = f"{number(figure.low)} to {number(figure.high)}"
    return f"{number(figure.value)} {unit} ({bounds})".replace("  ", " ")


def brief(figure: Identified) -> str:
    """The value alone, with the digits that its interval allows."""
    return shown(figure).partition(" (")[0]


def plain(name: str) -> str:
    """A figure's name in words, its unit left out.

    >>> plain("friction.level_15_rpm_nm")
    'friction: level 15 rpm'
    """
    section, _, key = name.rpartition(".")
    for ending in ("_nm_s_per_rad", "_n_per_m", "_rad_s", "_kg_m2", "_nm", "_hz", "_n", "_m", "_s"):
        if key.endswith(ending):
            key = key.removesuffix(ending)
            break
    words = key.replace("_", " ")
    return f"{section.replace('_', ' ')}: {words}" if section else words


def _recordings(machine: Machine, traces: Sequence[Path]) -> dict[str, SampleFrame]:
    if not traces:
        raise FingerprintError("no recording given; expected one trace or more")
    names = [path.name for path in traces]
    for name in names:
        if names.count(name) > 1:
            raise FingerprintError(f"two recordings are called {name}; expected each once")
    maps, axis = column_maps(machine), controller_axis(machine)
    return {path.name: read_trace(path, maps, axis=axis) for path in traces}


def _change_document(change: FigureChange) -> dict[str, str | float | bool | None]:
    relative = change.relative
    return {
        "figure": change.name,
        "old": change.old.value,
        "new": change.new.value,
        "change": change.change.value,
        "low": change.change.low,
        "high": change.change.high,
        "unit": change.change.unit,
        "relative": relative if math.isfinite(relative) else None,
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
            told = headline(name, section) or section.figures
            key, figure = next(
                (pair for pair in told.items() if math.isfinite(pair[1].value)),
            )
            lines.append(f"{WORDING[name].title}: {plain(key)} {shown(figure)}")
        else:
            lines.append(
                f"{WORDING[name].title}: undetermined, {section.reason}; "
                f"record `edge-service motion {section.motion}`"
            )
    if baseline is not None:
        named = ", ".join(plain(change.name) for change in changes if change.changed)
        lines.append(f"changed against the baseline: {named or 'nothing'}")
        new = ", ".join(plain(name) for name in appeared_figures(found, baseline))
        lines += [f"seen only now: {new}"] if new else []
    lines.append(f"report: {out_dir / 'report.html'}")
    return "\n".join(lines)
