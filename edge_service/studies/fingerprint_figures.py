"""The curves of a fingerprint as inline SVG, over those of its baseline."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import replace

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..fingerprint.axis_fingerprint import AxisFingerprint
from ..fingerprint.section import Curve
from .figures import ESTIMATE, MUTED, STYLE, TRUTH

RUN_COLOURS = ("#7b2d8b", "#2f62c9", "#12857a", "#c9820b", "#c0392b")
_POINTS = ("forward", "backward")
_SHOWN = {
    "stiffness, N/m": ("stiffness, N/µm", 1e-6),
    "lost motion, m": ("lost motion, µm", 1e6),
}
"""Labels of SI curves -> label and factor of the plot."""


def draw_sections(now: AxisFingerprint, before: AxisFingerprint | None) -> dict[str, str]:
    """Section name -> SVG, of the sections that have curves of more than one point."""
    drawn = {}
    for name, section in now.sections.items():
        curves = _drawable(section.curves)
        if curves:
            known = before.sections[name].curves if before and name in before.sections else ()
            old = _drawable(known)
            drawn[name] = _panel(name, curves, old)
    return drawn


def _drawable(curves: Sequence[Curve]) -> list[Curve]:
    """Curves of more than one known point: what is undetermined is not drawn."""
    return [curve for curve in curves if np.isfinite(curve.y).sum() > 1]


def draw_friction_runs(curves: Mapping[str, Curve]) -> str:
    """Friction points of several runs of one axis, by the name of the run (Figure 5.11)."""
    with mpl.rc_context({**STYLE, "svg.hashsalt": "runs"}):
        figure, axes = _axes(next(iter(curves.values())))
        axes.set(xscale="log", ylabel="magnitude of the friction torque, N m")
        for (name, curve), colour in zip(curves.items(), RUN_COLOURS, strict=False):
            for side, line in ((curve.x > 0.0, "o-"), (curve.x < 0.0, "o:")):
                label = f"{name}, {'forward' if line == 'o-' else 'backward'}"
                x, y = np.abs(curve.x[side]), np.abs(curve.y[side])
                axes.plot(x, y, line, ms=3, lw=1.0, color=colour, label=label)
        return _svg(figure, axes)


def _panel(name: str, curves: Sequence[Curve], old: Sequence[Curve]) -> str:
    with mpl.rc_context({**STYLE, "svg.hashsalt": name}):
        figure, axes = _axes(curves[0])
        if name == "frequency_response":
            axes.set(xscale="log", yscale="log")
        if name == "friction":  # the Stribeck part lives in the lowest hundredth of the speeds
            axes.set(xscale="log", ylabel="magnitude of the friction torque, N m")
            curves, old = _magnitudes(curves), _magnitudes(old)
        for curve in old:
            if curve.name not in _POINTS:
                _draw(axes, curve, MUTED, f"baseline, {curve.name}", "--")
        colours = (TRUTH, ESTIMATE, "#c9820b")
        for curve, colour in zip(curves, colours, strict=False):
            _draw(axes, curve, colour, curve.name, "-")
        if name in ("equability", "signature"):
            axes.set_ylim(bottom=0.0)
        return _svg(figure, axes)


def _draw(axes: Axes, curve: Curve, colour: str, label: str, line: str) -> None:
    _, factor = _SHOWN.get(curve.y_label, (curve.y_label, 1.0))
    if curve.name in _POINTS:
        axes.plot(curve.x, curve.y, "o", ms=4, color=colour, label=label)
        return
    marker = "o" if len(curve.x) < 30 else ""
    axes.plot(
        curve.x, factor * curve.y, line, marker=marker, ms=4, lw=1.3, color=colour, label=label
    )


def _magnitudes(curves: Sequence[Curve]) -> list[Curve]:
    """Both directions folded onto positive speeds, with a gap between them."""
    folded = []
    for curve in curves:
        turn = np.flatnonzero((curve.x[:-1] < 0.0) & (curve.x[1:] > 0.0)) + 1
        x, y = (np.abs(np.insert(values, turn, np.nan)) for values in (curve.x, curve.y))
        folded.append(replace(curve, x=x, y=y))
    return folded


def _axes(curve: Curve) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(7.6, 3.1), layout="constrained")
    axes = figure.subplots()
    axes.set(xlabel=curve.x_label, ylabel=_SHOWN.get(curve.y_label, (curve.y_label,))[0])
    return figure, axes


def _svg(figure: Figure, axes: Axes) -> str:
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=5, borderaxespad=0.2)
    stream = io.StringIO()
    figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    text = stream.getvalue()
    return text[text.index("<svg") :]
