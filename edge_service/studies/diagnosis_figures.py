"""Pictures of a diagnosis as inline SVG: the waterfall, and the gap before and after."""

import io
from collections.abc import Mapping, Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..diagnose.diagnosis import ChannelGap, Diagnosis
from ..diagnose.session import Session
from .figures import ESTIMATE, MUTED, STYLE, TRUTH

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


def draw_waterfalls(found: Diagnosis) -> dict[str, str]:
    """Channel -> SVG: from the model as it is down to the healthy floor."""
    with mpl.rc_context({**STYLE, "svg.hashsalt": "waterfall"}):
        return {
            name: _waterfall(name, gap, found.waterfall.get(name, ()))
            for name, gap in found.gap.items()
        }


def _waterfall(channel: str, gap: ChannelGap, steps: Sequence[tuple[str, float]]) -> str:
    label, factor = SHOWN[channel]
    names = ["model as it is", *(name.replace("_", " ") for name, _ in steps)]
    levels = [gap.before, *(rms for _, rms in steps)]
    figure = Figure(figsize=(7.6, 0.7 + 0.34 * len(names)), layout="constrained")
    axes = figure.subplots()
    axes.barh(range(len(names)), [factor * level for level in levels], color=ESTIMATE, height=0.6)
    axes.axvline(factor * gap.noise_floor, color=TRUTH, linestyle=":", label="healthy axis")
    axes.set_yticks(range(len(names)), [names[0], *(f"with {name}" for name in names[1:])])
    axes.invert_yaxis()
    axes.set_xlabel(f"{label} (root mean square)")
    return _svg(figure, axes)


def draw_gaps(session: Session, found: Diagnosis) -> dict[str, str]:
    """Channel -> SVG: the gap before and after over time and over where it lives."""
    with mpl.rc_context({**STYLE, "svg.hashsalt": "gap"}):
        return {name: _gap(name, session, found) for name in session.channels}


def _gap(channel: str, session: Session, found: Diagnosis) -> str:
    rows, left = session.channels[channel], found.left[channel]
    best = next((p.variable for p in found.where if p.channel == channel), "motor_speed_rad_s")
    best = "motor_speed_rad_s" if best in ("time_s", "direction") else best
    label, factor = SHOWN[channel]
    pick = np.unique(np.linspace(0, len(left) - 1, _POINTS).astype(int))
    figure = Figure(figsize=(7.6, 2.9), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, variable in zip(panels, ("time_s", best), strict=True):
        values = rows.variables[variable][pick]
        before, after = {"color": MUTED, "label": "before"}, {"color": ESTIMATE, "label": "after"}
        for series, look in ((rows.gap, before), (left, after)):
            axes.plot(values, factor * series[pick], ".", markersize=1.6, rasterized=True, **look)
        axes.set_xlabel(LABELS[variable])
    panels[0].set_ylabel(label)
    return _svg(figure, panels[0])


def _svg(figure: Figure, axes: Axes) -> str:
    handles, _ = axes.get_legend_handles_labels()
    if handles:
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, markerscale=5.0)
    stream = io.StringIO()
    figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None}, dpi=130)
    text = stream.getvalue()
    return text[text.index("<svg") :]


def healthy_note(gap: Mapping[str, ChannelGap]) -> str:
    """How the gap compares with a healthy axis, in words."""
    worst = max((each.before / each.noise_floor for each in gap.values()), default=1.0)
    return f"{worst:.1f} times that of a healthy axis"
