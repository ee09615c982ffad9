"""The rows of the estimator's bench as pictures: truth, estimate and interval over time."""

import math
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from edge_service.estimate.mixture.estimator import FusedPreloadEstimator
from edge_service.offline.report.pictures import ESTIMATE, MUTED, STYLE, TRUTH, write_png
from edge_service.offline.thesis.runs import ThesisCase, run_case

from ... import foreign_plant as plant
from ..table import Drawn
from .axis import OwnAxis, recorded
from .plants.foreign import ROW, commissioned_machine, scenarios
from .plants.foreign import recorded as foreign_recorded
from .plants.own import FULL_S, QUICK_S, long_case, losses
from .plants.thesis import SETTINGS, thesis_blocks, thesis_machine
from .scores import Recorded, Track, follow

OVERVIEW = "estimator.png"
COLUMNS = 3
MOST_PERCENT = 11.0
FOREIGN_AXIS = 3
SEEDS_SIMULATIONS = (1, 2, 3, 4)


def draw_estimator(
    folder: Path, quick: bool = False, progress: Callable[[str], None] | None = None
) -> list[Path]:
    """A picture of each row, and all of them in one; returns the files.

    Args:
        folder: made if it is not there.
        quick: shorter runs.
    """
    return draw_rows(folder, tracks(quick), OVERVIEW, progress)


def draw_rows(
    folder: Path,
    rows: Iterable[Drawn],
    overview: str,
    progress: Callable[[str], None] | None = None,
) -> list[Path]:
    """A picture of each row, and all of them in a file `overview`; returns the files."""
    say = progress or (lambda _: None)
    folder.mkdir(parents=True, exist_ok=True)
    drawn, files = [], []
    with mpl.rc_context(STYLE):
        for row in rows:
            say(f"picture: {row.title}")
            drawn.append(row)
            files.append(folder / f"{_file_name(row.title)}.png")
            write_png(_figure([row], 1, 6.4, 3.0), files[-1])
        files.append(folder / overview)
        write_png(_figure(drawn, COLUMNS, 3.4, 2.1), files[-1], dpi=110)
    return files


def tracks(quick: bool) -> Iterator[Drawn]:
    """Every row, one after the other."""
    yield from _seeds()
    yield from _own(quick)
    yield from _foreign(quick)


def _seeds() -> Iterator[Drawn]:
    for simulation in SEEDS_SIMULATIONS:
        run, _ = run_case(ThesisCase(simulation), seed=0)
        estimator = FusedPreloadEstimator(thesis_machine(), SETTINGS)
        case = Recorded(thesis_blocks(run), run.time_s, run.preload_percent)
        yield Drawn(f"thesis' simulation {simulation}", follow(estimator, case))


def _own(quick: bool) -> Iterator[Drawn]:
    axis = OwnAxis(1)
    estimator = FusedPreloadEstimator(axis.commissioned())
    row = "closed loop: full drop"
    percent, _ = losses(axis.fresh_percent, QUICK_S if quick else FULL_S)[row]
    case = recorded(axis.frames("production", percent, 6), axis.nominal(), percent)
    yield Drawn(row, follow(estimator, case))
    estimator.reset()
    long, _ = long_case(axis, quick)
    yield Drawn("40 min: warm-up, slow loss, step", follow(estimator, long, every=5))


def _foreign(quick: bool) -> Iterator[Drawn]:
    machine = commissioned_machine(FOREIGN_AXIS)
    for name, given in scenarios(plant, quick).items():
        kwargs = {key: value for key, value in given.items() if key != "loss"}
        case = plant.axis_case(seed=100 + FOREIGN_AXIS, axis_seed=FOREIGN_AXIS, **kwargs)
        track = follow(FusedPreloadEstimator(machine), foreign_recorded(case))
        yield Drawn(f"{ROW}{name}", track)


def _figure(rows: list[Drawn], columns: int, width: float, height: float) -> Figure:
    lines = math.ceil(len(rows) / columns)
    size = (columns * width, lines * height + 0.4)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(lines, columns, squeeze=False).ravel()
    for axes, row in zip(grid, rows, strict=False):
        _draw(axes, row)
    for axes in grid[len(rows) :]:
        axes.set_axis_off()
    handles, labels = grid[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


def _draw(axes: Axes, row: Drawn) -> None:
    """Gaps are moments without a number."""
    track, minutes = row.track, row.track.time_s[-1] > 300.0
    time = track.time_s / (60.0 if minutes else 1.0)
    axes.fill_between(
        time, track.low, track.high, color=ESTIMATE, alpha=0.25, lw=0, label="95 % interval"
    )
    axes.plot(time, track.percent, color=ESTIMATE, lw=1.0, label="estimate")
    axes.plot(time, track.truth, color=TRUTH, lw=1.0, ls="--", label="truth")
    axes.axhline(0.0, color=MUTED, lw=0.6)
    axes.set_title(row.title, fontsize=9, loc="left")
    axes.set(ylim=(-0.3, _top(track)), xlabel="min" if minutes else "s", ylabel="% preload")


def _top(track: Track) -> float:
    most = float(np.nanmax(np.append(track.truth, track.percent)))
    return min(most + 1.5, MOST_PERCENT)


def _file_name(title: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", title.lower().replace("'", "")).strip("_")
