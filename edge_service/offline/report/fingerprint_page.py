"""Words and figures of a fingerprint for a maintenance engineer.

Curves lie over those of the baseline; moves are shown from day to day.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from scipy import signal

from ...fingerprint.compare import Drift
from ...fingerprint.result import AxisFingerprint, Curve, Section
from ...regression.interval_estimate import IntervalEstimate
from ..drift import DriftReport, short
from .page import ESTIMATE, MUTED, STYLE, TRUTH
from .quantities import SHOWN_UNITS

PANEL_INCHES = (7.6, 3.1)
_POINTS = {"forward": (">", ESTIMATE), "backward": ("<", "#c9820b")}
_PARTS = {"Coulomb": "#12857a", "viscous": "#7b2d8b", "Stribeck": "#c0392b"}
_ONLY_NOW = {*_POINTS, *_PARTS, "measured"}
"""Curves of a baseline that are not drawn beneath those of now."""
_COLD_TO_WARM, _WARMEST = mpl.colormaps["plasma"], 0.85
_RPM = ("screw speed, r/min", 60.0 / (2.0 * math.pi))
_SHOWN = {
    "stiffness, N/m": ("stiffness, N/µm", 1e-6),
    "lost motion, m": ("lost motion, µm", 1e6),
    "table position, m": ("table position, mm", 1e3),
    "motor speed, rad/s": _RPM,
}
"""Labels of SI curves -> label and factor of the plot."""
_LEAST_SHOWN = {"backlash": 1.0}
"""Section -> least height of its plot, in its unit: below it there is noise only."""
_FROM_ZERO = ("friction", "stiffness", "backlash", "equability", "signature")
_HEADROOM = 1.05
_NAMED_ORDERS = 4
_OUT_OF_NOISE = 5.0


class Wording(NamedTuple):
    """Title and meaning of a section; what the names of its `most` chief figures begin with."""

    title: str
    meaning: str
    headline: tuple[str, ...]
    most: int = 3


WORDING: Mapping[str, Wording] = {
    "friction": Wording(
        "Friction",
        "The torque needed to move at constant speed. Its level follows preload and lubrication; a "
        "rise at low speed points to thin lubrication, and the slope depends on the grease.",
        ("coulomb_nm", "viscous_nm_s_per_rad", "stribeck_excess_nm"),
    ),
    "friction_runs": Wording(
        "Friction from test to test",
        "The friction tests of the session from first to last. A fall at low speed means that the "
        "lubricant warms up; the change is from the first test to the last.",
        ("change_at_",),
        most=1,
    ),
    "stiffness": Wording(
        "Stiffness along the stroke",
        "How hard it is to push the table away from where the motor holds it; the locked resonance "
        "is the frequency at which the table then swings. A softer axis at all places points to "
        "the nut or the bearing.",
        ("stiffness_", "locked_resonance_"),
    ),
    "backlash": Wording(
        "Backlash and lost motion",
        "How far the table lags behind when the motor reverses: wind-up by friction, and play.",
        ("lost_motion_",),
    ),
    "equability": Wording(
        "Evenness",
        "How much the torque varies at constant speed. A rise means rough running.",
        ("ripple_",),
    ),
    "signature": Wording(
        "Signature",
        "Where in each turn of the screw the torque varies: once per turn points to a bent or "
        "misaligned screw, higher orders to the balls and their return.",
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
        ("antiresonance_hz", "resonance_hz", "response_inertia_kg_m2"),
    ),
    "inertia": Wording(
        "Inertia", "The inertia of the whole axis, as the motor sees it.", ("inertia_kg_m2",)
    ),
    "preload": Wording(
        "Preload of the nut",
        "From the drag, which guides and bearings also affect, and from the stiffness compared "
        "with that of the fresh axis.",
        ("preload_from_drag_n", "preload_from_stiffness_n"),
    ),
}
_NAMES = ("Coulomb", "Stribeck")
_UNITS = ("nm_s_per_rad", "nm_per_rad", "n_per_m", "rad_s", "kg_m2", "nm", "hz", "n", "m", "s")


def headline(name: str, section: Section) -> dict[str, IntervalEstimate]:
    """The chief figures of a section, as far as they have a number, the most telling first."""
    wording = WORDING[name]
    chief = [
        (key, figure)
        for start in wording.headline
        for key, figure in section.figures.items()
        if key.startswith(start) and math.isfinite(figure.value)
    ]
    return dict(chief[: wording.most])


def plain(name: str) -> str:
    """A figure's name in words, its unit left out.

    >>> plain("friction.level_15_rpm_nm")
    'friction: level 15 rpm'
    >>> plain("backlash.backlash_at_400_mm_m")
    'backlash at 400 mm'
    """
    section, _, key = name.rpartition(".")
    ending = next((f"_{each}" for each in _UNITS if key.endswith(f"_{each}")), "")
    key = key.removesuffix(ending)
    words = key.replace("_", " ")
    for proper in _NAMES:
        words = words.replace(proper.lower(), proper)
    place = section.replace("_", " ")
    return words if not section or words.startswith(place) else f"{place}: {words}"


def draw_sections(now: AxisFingerprint, before: AxisFingerprint | None) -> dict[str, Figure]:
    """Section name -> figure, of the sections that have curves of more than one point."""
    figures = {}
    for name, section in now.sections.items():
        curves = _drawable(section.curves)
        if not curves:
            continue
        known = before.sections[name].curves if before and name in before.sections else ()
        with mpl.rc_context(STYLE):
            if name == "friction_runs":
                figures[name] = _friction_runs(curves)
            else:
                figures[name] = _panel(name, curves, _drawable(known), section.figures)
    return figures


def _drawable(curves: Sequence[Curve]) -> list[Curve]:
    """Curves of more than one known point, in the units shown."""
    drawable = []
    for curve in curves:
        if np.isfinite(curve.y).sum() > 1:
            x_label, x_factor = _SHOWN.get(curve.x_label, (curve.x_label, 1.0))
            y_label, y_factor = _SHOWN.get(curve.y_label, (curve.y_label, 1.0))
            x, y = x_factor * curve.x, y_factor * curve.y
            drawable.append(Curve(curve.name, x, y, x_label, y_label))
    return drawable


def _friction_runs(curves: Sequence[Curve]) -> Figure:
    """Tests of one axis from the first to the last, and what each changed (Figure 5.11)."""
    figure = Figure(figsize=(PANEL_INCHES[0], 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.set(xlabel=curves[0].x_label, ylabel=curves[0].y_label)
    right.set(xlabel=curves[0].x_label, ylabel=f"change since {_stem(curves[0])}, N m")
    for k, curve in enumerate(curves):
        style: Any = {"ms": 3, "lw": 1.0, "color": _COLD_TO_WARM(_WARMEST * k / (len(curves) - 1))}
        left.plot(curve.x, curve.y, "o-", label=_stem(curve), **style)
        right.plot(curve.x, curve.y - curves[0].y, "o-", **style)
    for axes in (left, right):
        _logarithmic(axes)
    figure.legend(loc="outside upper left", ncols=5)
    return figure


def _stem(curve: Curve) -> str:
    return curve.name.rpartition(".")[0] or curve.name


def _panel(
    name: str, curves: Sequence[Curve], old: Sequence[Curve], known: Mapping[str, IntervalEstimate]
) -> Figure:
    figure = Figure(figsize=PANEL_INCHES, layout="constrained")
    axes = figure.subplots()
    if name == "friction":
        curves, old = _magnitudes(curves), _magnitudes(old)
    axes.set(xlabel=curves[0].x_label, ylabel=curves[0].y_label)
    for curve in old:
        if curve.name not in _ONLY_NOW:
            _draw(axes, curve, MUTED, f"baseline, {curve.name}", "--")
    plain = iter((TRUTH, ESTIMATE, "#c9820b", *_PARTS.values()))
    for curve in curves:
        colour = _PARTS[curve.name] if curve.name in _PARTS else next(plain)
        _draw(axes, curve, colour, curve.name, ":" if curve.name in _PARTS else "-")
    if name in ("friction", "equability", "frequency_response"):
        _logarithmic(axes)
    if name == "frequency_response":
        axes.set_yscale("log")
        for key, height in (("antiresonance_hz", 0.97), ("resonance_hz", 0.85)):
            mode = known.get(key)
            if mode is not None and math.isfinite(mode.value):
                axes.axvline(mode.value, color=MUTED, lw=0.8, ls="--")
                text = f"{key.removesuffix('_hz')} {mode.value:.0f} Hz  "
                place = (mode.value, height)
                label = axes.annotate(text, place, xycoords=("data", "axes fraction"))
                label.set(ha="right", va="top", bbox={"fc": "white", "ec": "none", "pad": 1.0})
    if name in _FROM_ZERO:
        least = _LEAST_SHOWN.get(name, 0.0)
        drawn = axes.dataLim
        low, high = min(drawn.y0, 0.0), max(drawn.y1, 0.0)
        low = -least if -least < low < 0.0 else low
        axes.set_ylim(_HEADROOM * low, _HEADROOM * max(high, least))
    if name == "signature":
        _name_orders(axes, curves[0])
    figure.legend(loc="outside upper left", ncols=7, fontsize=8, columnspacing=1.2)
    return figure


def _draw(axes: Axes, curve: Curve, colour: str, label: str, line: str) -> None:
    if curve.name in _POINTS:
        marker, colour = _POINTS[curve.name]
        axes.plot(curve.x, curve.y, marker, ms=4, mfc="none", color=colour, label=label)
        return
    marker = "o" if len(curve.x) < 30 else ""
    axes.plot(curve.x, curve.y, line, marker=marker, ms=4, lw=1.3, color=colour, label=label)


def _logarithmic(axes: Axes) -> None:
    """A logarithmic axis of x with plain numbers at 1, 2 and 5."""
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _name_orders(axes: Axes, curve: Curve) -> None:
    """The order at the greatest peaks, as far as they stand out."""
    peaks, _ = signal.find_peaks(curve.y, height=_OUT_OF_NOISE * float(np.median(curve.y)))
    for k in sorted(peaks.tolist(), key=lambda k: -curve.y[k])[:_NAMED_ORDERS]:
        place, text = (float(curve.x[k]), float(curve.y[k])), f"{curve.x[k]:g} per turn"
        axes.annotate(text, place, (4, -2), textcoords="offset points", va="top")


def _magnitudes(curves: Sequence[Curve]) -> list[Curve]:
    """Both directions folded onto positive speeds, with a gap between them."""
    folded = []
    for curve in curves:
        turn = np.flatnonzero((curve.x[:-1] < 0.0) & (curve.x[1:] > 0.0)) + 1
        x, y = (np.abs(np.insert(values, turn, np.nan)) for values in (curve.x, curve.y))
        folded.append(replace(curve, x=x, y=y, y_label=f"magnitude of the {curve.y_label}"))
    return folded


def draw_drift(report: DriftReport) -> Figure:
    """Change against the first recording with its interval; what is beyond the scatter is blue."""
    sections = report.sections
    across = max(len(each.drifts) for each in sections)
    names = [name if len(name) <= 12 else f"{name[:5]}…{name[-6:]}" for name in report.recordings]
    with mpl.rc_context(STYLE):
        size = (1.75 * across, 0.2 + 2.3 * len(sections))
        figure = Figure(figsize=size, layout="constrained")
        panels = figure.subplots(len(sections), across, squeeze=False)
        for row, each in zip(panels, sections, strict=True):
            for axes in row[len(each.drifts) :]:
                axes.set_axis_off()
            title = report.place(each).replace(" at ", "\nat ").replace(", ", "\n")
            row[0].set_ylabel(title, fontsize=7)
            for axes, drift in zip(row, each.drifts, strict=False):
                _draw_changes(axes, drift)
                axes.set_xticks(range(len(names)), names, fontsize=6, rotation=30, ha="right")
    return figure


def _draw_changes(axes: Axes, drift: Drift) -> None:
    unit, factor = SHOWN_UNITS.get(drift.changes[0].unit, (drift.changes[0].unit, 1.0))
    axes.axhline(0.0, color=MUTED, lw=1.0)
    axes.plot(0, 0.0, "o", color=TRUTH, ms=4)
    for number, (change, changed) in enumerate(zip(drift.changes, drift.changed, strict=True), 1):
        colour = ESTIMATE if changed else MUTED
        axes.vlines(number, factor * change.low, factor * change.high, color=colour, lw=2.0)
        axes.plot(number, factor * change.value, "o", color=colour, ms=4)
    axes.set_title(f"{short(drift.name)}, {unit}", fontsize=8)
    axes.tick_params(axis="y", labelsize=7)
    axes.margins(x=0.25)
