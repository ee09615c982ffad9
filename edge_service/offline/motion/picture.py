"""Motions drawn over time: commanded position of the table."""

import math
import textwrap
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...models.machine import Machine
from ...models.motions.registry import MOTIONS, MotionError, MotionLimits, Setpoints, motion_limits
from ...models.motions.segments import samples_of
from ..report.pictures import ESTIMATE, STYLE, write_png

ENDLESS_SHOWN_S = 30.0
"""Of a motion without end."""
_COLUMNS = 2
_RATE_HZ = 100.0
_DPI = 90


def write_motions_picture(machine: Machine, out: Path) -> str:
    """All motions as one PNG file; for those that the axis refuses the reason stands in it.

    Raises:
        MotionError: one line; `out` is no .png, or cannot be written.
    """
    if out.suffix != ".png":
        raise MotionError(f"{out}: expected a name that ends in .png, for a picture of all motions")
    limits = motion_limits(machine)
    rows = math.ceil(len(MOTIONS) / _COLUMNS)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.6, 0.5 + 1.1 * rows), layout="constrained")
        panels = figure.subplots(rows, _COLUMNS, squeeze=False).flatten()
        for axes, name in zip(panels, MOTIONS, strict=True):
            try:
                _draw(axes, name, limits)
            except MotionError as error:
                _refuse(axes, name, str(error))
        figure.supxlabel("time, s", fontsize=9)
        figure.supylabel("position, mm", fontsize=9)
    try:
        write_png(figure, out, _DPI)
    except OSError as error:
        raise MotionError(f"{out}: cannot be written ({error.strerror})") from None
    return f"{out}: {len(MOTIONS)} motions"


def _draw(axes: Axes, name: str, limits: MotionLimits) -> None:
    """One motion from home on.

    Raises:
        MotionError: the axis does not allow it.
    """
    motion = MOTIONS[name]
    endless = motion.duration_s(limits) is None
    duration_s = ENDLESS_SHOWN_S if endless else None
    segments = motion.plan(limits, np.random.default_rng((1, 1)), duration_s=duration_s).segments
    count = sum(samples_of(segment, _RATE_HZ) for segment in segments)
    position = Setpoints(iter(segments), limits.low_m, _RATE_HZ).take(count)[:, 0]
    axes.plot(np.arange(count) / _RATE_HZ, 1e3 * position, color=ESTIMATE, lw=1.0)
    axes.set_ylim(0.0, 1e3 * (limits.low_m + limits.high_m))
    axes.margins(x=0.01)
    shown = "the first " if endless else ""
    length_s = sum(segment.duration_s for segment in segments)
    axes.set_title(f"{name}, {shown}{length_s:.0f} s", loc="left", fontsize=9)


def _refuse(axes: Axes, name: str, reason: str) -> None:
    axes.set_title(f"{name}, refused", loc="left", fontsize=9)
    axes.text(0.0, 0.9, textwrap.fill(reason, 60), transform=axes.transAxes, fontsize=8, va="top")
    axes.set_axis_off()
