"""Picture of a wear test: the readings, and every date that was stated beside what came."""

import math
from collections.abc import Mapping, Sequence

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..report.pictures import ESTIMATE, MUTED, STYLE, TRUTH
from .outcome import Crossing, Stage
from .stages import WearTest
from .statements import Dates

_MARGIN = 1.6
"""Dates are shown up to so many times the length of the test."""


def draw_wear(test: WearTest, asked: Sequence[Stage], came: Mapping[float, Crossing]) -> Figure:
    """Drag with its limits, and a panel for each limit: date stated against when it was stated."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 5.4), layout="constrained")
        grid = figure.add_gridspec(2, len(came), height_ratios=(1.0, 1.3))
        _draw_drag(figure.add_subplot(grid[0, :]), test, came)
        shared: Axes | None = None
        for column, (limit, each) in enumerate(came.items()):
            shared = axes = figure.add_subplot(grid[1, column], sharey=shared)
            _draw_dates(axes, test, asked, limit, each)
            axes.set(title=f"crossing of {limit:g} %", xlabel="stated at, h")
            if column == 0:
                axes.set_ylabel("date, h from new")
        figure.axes[1].legend(loc="upper left", fontsize=7.5)
    return figure


def _draw_drag(axes: Axes, test: WearTest, came: Mapping[float, Crossing]) -> None:
    axes.plot(test.time_h, test.percent, "o-", color=TRUTH, ms=3.5, lw=1.0)
    for limit in came:
        axes.axhline(limit, color=MUTED, linestyle=":", lw=1.0)
    axes.set(xlabel="h from new", ylabel="drag, % of fresh")
    axes.margins(x=0.01)


def _draw_dates(
    axes: Axes, test: WearTest, asked: Sequence[Stage], limit: float, came: Crossing
) -> None:
    top_h = _MARGIN * float(test.time_h[-1])
    _draw_bands(axes, {s.time_h: s.line for s in asked}, limit, top_h, MUTED, "straight line", 6.0)
    _draw_bands(axes, {s.time_h: s.trend for s in asked}, limit, top_h, ESTIMATE, "trend", -6.0)
    if math.isfinite(came.first_h):
        last_h = min(came.last_h, top_h)
        axes.axhspan(came.first_h, last_h, color=TRUTH, alpha=0.15, lw=0.0)
        axes.axhline(came.first_h, color=TRUTH, lw=1.2, label="what came, first to last")
    axes.set(xlim=(0.0, float(test.time_h[-1])), ylim=(0.0, top_h))


def _draw_bands(
    axes: Axes,
    said: Mapping[float, Dates],
    limit: float,
    top_h: float,
    colour: str,
    label: str,
    aside_h: float,
) -> None:
    dates = {at_h: each[limit] for at_h, each in said.items() if limit in each}
    times = [at_h + aside_h for at_h in dates]
    highs = [min(each.latest_h, 2.0 * top_h) for each in dates.values()]
    axes.vlines(times, [d.earliest_h for d in dates.values()], highs, color=colour, lw=2.0)
    likely = [each.likely_h for each in dates.values()]
    axes.plot(times, likely, "o", color=colour, ms=3.5, label=label)
