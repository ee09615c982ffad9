"""Pictures of a diagnosis as inline SVG: the waterfall, and the gap before and after."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...diagnose.result import ChannelGap, Diagnosis, ReplayedSeries, Verdict, WaterfallStep
from ...diagnose.session.session import Session
from .page import ESTIMATE, MUTED, TRUTH, as_svg

SHOWN = {"torque_nm": ("torque gap, N m", 1.0), "transmission_m": ("position gap, µm", 1e6)}
LABELS = {
    "motor_speed_rad_s": "motor speed, rad/s",
    "motor_acceleration_rad_s2": "motor acceleration, rad/s²",
    "table_position_m": "table position, m",
    "direction": "direction of motion",
    "motor_angle_rad": "angle within a turn, rad",
    "time_s": "time, s",
    "temperature_c": "temperature, °C",
}
_POINTS = 4000
_DPI = 130
_WINDOW_S = 4.0
_PAUSE_S = 0.05
_LEAST_STEP = 0.005  # of the whole gap: no more than a line's width


def draw_waterfall(channel: str, gap: ChannelGap, steps: Sequence[WaterfallStep]) -> str:
    """SVG: from the model as it is down to the floor."""
    label, factor = SHOWN[channel]
    names, levels = ["model as it is"], [gap.before]
    for step in steps:
        if abs(step.rms - levels[-1]) > _LEAST_STEP * gap.before:
            names.append(step.effect.replace("_", " "))
            levels.append(step.rms)
    figure = Figure(figsize=(7.6, 0.7 + 0.34 * len(names)), layout="constrained")
    axes = figure.subplots()
    axes.barh(range(len(names)), [factor * level for level in levels], color=ESTIMATE, height=0.6)
    axes.axvline(factor * gap.floor, color=TRUTH, linestyle=":", label="floor")
    axes.set_yticks(range(len(names)), [names[0], *(f"with {name}" for name in names[1:])])
    axes.invert_yaxis()
    axes.set_xlabel(f"{label} (root mean square)")
    return _svg(figure, axes, "waterfall")


def draw_replay(channel: str, gap: ReplayedSeries) -> str:
    """SVG: the seconds with most of the gap, measured and simulated."""
    label, factor = SHOWN[channel]
    energy = np.concatenate(([0.0], np.cumsum(gap.before**2)))
    ends = np.searchsorted(gap.time_s, gap.time_s + _WINDOW_S)
    start = int(np.argmax(energy[ends] - energy[:-1]))
    window = slice(start, int(ends[start]))
    time_s = gap.time_s[window]
    pauses = np.flatnonzero(np.diff(time_s) > _PAUSE_S) + 1
    figure = Figure(figsize=(7.6, 2.3), layout="constrained")
    axes = figure.subplots()
    simulated = gap.before - gap.after, ESTIMATE, "simulated with the named effects"
    for series, color, name in ((gap.before, MUTED, "measured"), simulated):
        shown = np.insert(factor * series[window], pauses, np.nan)
        axes.plot(np.insert(time_s, pauses, np.nan), shown, color=color, label=name)
    axes.set_xlabel(LABELS["time_s"])
    axes.set_ylabel(label)
    return _svg(figure, axes, "replay")


def draw_gap(channel: str, session: Session, found: Diagnosis) -> str:
    """SVG: the gap before and after over time and over where it lives."""
    rows, left = session.channels[channel], found.series.left[channel]
    best = next((p.variable for p in found.where if p.channel == channel), "motor_speed_rad_s")
    best = "motor_speed_rad_s" if best in ("time_s", "direction") else best
    label, factor = SHOWN[channel]
    pick = np.unique(np.linspace(0, len(left) - 1, _POINTS).astype(int))
    figure = Figure(figsize=(7.6, 2.9), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, variable in zip(panels, ("time_s", best), strict=True):
        values = rows.variables[variable][pick]
        look: Any = {"markersize": 1.6, "rasterized": True, "linestyle": "", "marker": "."}
        axes.plot(values, factor * rows.gap[pick], color=MUTED, label="before", **look)
        if found.verdict is not Verdict.UNKNOWN and found.effects:
            axes.plot(values, factor * left[pick], color=ESTIMATE, label="after", **look)
        axes.set_xlabel(LABELS[variable])
        axes.xaxis.set_major_locator(MaxNLocator(6))
    panels[0].set_ylabel(label)
    return _svg(figure, panels[0], "gap")


def _svg(figure: Figure, axes: Axes, salt: str) -> str:
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, markerscale=5.0)
    return as_svg(figure, salt, _DPI)
