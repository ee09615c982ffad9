"""Picture of the channels of a recording as they were understood."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from ...messages.channels import CHANNELS
from ...messages.samples import SampleFrame
from ..report.pictures import ESTIMATE, STYLE, write_png

_DPI = 90
_POINTS = 20_000


def write_channels_picture(frame: SampleFrame, title: str, out: Path) -> None:
    """Every channel over time, in SI units, as a PNG file. Raises OSError."""
    step = len(frame) // _POINTS + 1
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.6, 0.8 + 1.3 * len(frame.channels)), layout="constrained")
        panels = figure.subplots(len(frame.channels), 1, squeeze=False, sharex=True).flatten()
        elapsed = _run_on(frame)
        for axes, (name, values) in zip(panels, frame.channels.items(), strict=True):
            axes.plot(elapsed[::step], values[::step], color=ESTIMATE, lw=0.8)
            described = CHANNELS[name].description if name in CHANNELS else name
            unit = CHANNELS[name].unit if name in CHANNELS else ""
            axes.set_title(f"{name}: {described}", loc="left", fontsize=9)
            axes.set_ylabel(unit)
        panels[-1].set_xlabel("time, s")
        figure.suptitle(title, fontsize=10)
    write_png(figure, out, _DPI)


def _run_on(frame: SampleFrame) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Time that runs on where the clock starts anew, s, shape (n,)."""
    steps = np.diff(frame.time_s, prepend=frame.time_s[:1])
    usual = float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else 1.0
    elapsed: np.ndarray[tuple[int], np.dtype[np.float64]] = np.cumsum(
        np.where(steps < 0.0, usual, steps)
    )
    return elapsed
