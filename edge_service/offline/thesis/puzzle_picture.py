"""The waterfall from a linear model down to the noise floor."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import matplotlib as mpl
from matplotlib.figure import Figure

from ..report.pictures import ESTIMATE, MUTED, STYLE, TRUTH

CHANNELS = (("torque_nm", "N m", 1.0), ("transmission_m", "µm", 1e6))
_LABELS = {"torque_nm": "torque gap", "transmission_m": "gap of table against motor"}


@dataclass(frozen=True, slots=True)
class Step:
    """An effect that was put into the model, and the gap by channel that is left with it."""

    effect: str
    gap: dict[str, float]


def draw_puzzle(
    before: Mapping[str, float],
    fitted: Mapping[str, float],
    floor: Mapping[str, float],
    steps: Sequence[Step],
) -> Figure:
    """One panel per channel; a bar falls from what was left to what is left.

    The second bar is aside of that: the linear model with the parameters that fit best.
    """
    names = ["linear model", "(fitted)", *(f"+ {step.effect.replace('_', ' ')}" for step in steps)]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 0.9 + 0.33 * len(names)), layout="constrained")
        panels = figure.subplots(1, 2, sharey=True)
        for axes, (channel, unit, factor) in zip(panels, CHANNELS, strict=True):
            levels = [factor * before[channel], *(factor * each.gap[channel] for each in steps)]
            places = [0, *range(2, 2 + len(steps))]
            axes.barh(places, levels, color=ESTIMATE, height=0.6, zorder=2)
            axes.barh(1, factor * fitted[channel], color=MUTED, height=0.6, zorder=2)
            for place, (above, level) in zip(places[1:], itertools.pairwise(levels), strict=True):
                axes.barh(place, above - level, left=level, color=MUTED, alpha=0.35, height=0.6)
            shown = [*zip(places, levels, strict=True), (1, factor * fitted[channel])]
            for place, level in shown:
                axes.text(level, place, f" {level:.3g}", va="center", fontsize=8)
            axes.margins(x=0.12)
            axes.axvline(factor * floor[channel], color=TRUTH, linestyle=":")
            axes.set_xlabel(f"{_LABELS[channel]}, {unit} rms")
        panels[0].set_yticks(range(len(names)), names)
        panels[0].invert_yaxis()
    return figure
