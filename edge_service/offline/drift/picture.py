"""Picture of a comparison: each quantity of each section over the recordings."""

from collections.abc import Sequence

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...fingerprint.drift.changes import Drift, SectionDrift
from ..report.pictures import ESTIMATE, MUTED, STYLE, TRUTH
from ..report.quantities import SHOWN_UNITS
from .wording import place


def draw_drift(
    sections: Sequence[SectionDrift], recordings: Sequence[str], by: Sequence[str]
) -> Figure:
    """Change against the first recording with its interval; what is beyond the scatter is blue."""
    across = max(len(each.drifts) for each in sections)
    with mpl.rc_context(STYLE):
        size = (1.75 * across, 0.2 + 2.3 * len(sections))
        figure = Figure(figsize=size, layout="constrained")
        panels = figure.subplots(len(sections), across, squeeze=False)
        for row, each in zip(panels, sections, strict=True):
            for axes in row[len(each.drifts) :]:
                axes.set_axis_off()
            row[0].set_ylabel(
                place(each, by).replace(" at ", "\nat ").replace(", ", "\n"), fontsize=7
            )
            for axes, drift in zip(row, each.drifts, strict=False):
                _draw(axes, drift, recordings)
    return figure


def _draw(axes: Axes, drift: Drift, recordings: Sequence[str]) -> None:
    unit, factor = SHOWN_UNITS.get(drift.changes[0].unit, (drift.changes[0].unit, 1.0))
    axes.axhline(0.0, color=MUTED, lw=1.0)
    for number, (change, changed) in enumerate(zip(drift.changes, drift.changed, strict=True), 1):
        colour = ESTIMATE if changed else MUTED
        axes.vlines(number, factor * change.low, factor * change.high, color=colour, lw=2.0)
        axes.plot(number, factor * change.value, "o", color=colour, ms=4)
    axes.plot(0, 0.0, "o", color=TRUTH, ms=4)
    names = [_shortened(name) for name in recordings]
    axes.set_xticks(range(len(recordings)), names, fontsize=6, rotation=30, ha="right")
    axes.set_title(f"{drift.name.rpartition('_')[0].replace('_', ' ')}, {unit}", fontsize=8)
    axes.tick_params(axis="y", labelsize=7)
    axes.margins(x=0.25)


def _shortened(name: str) -> str:
    return name if len(name) <= 12 else f"{name[:5]}…{name[-6:]}"
