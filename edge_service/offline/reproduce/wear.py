"""`edge-service reproduce wear`: dates that the service's trend states of a real screw.

The drag torque of a screw that wore out goes to the trend reading by reading; each date that it
states for a limit stands beside the time at which the limit was crossed.
"""

import contextlib
import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...command_answer import Answer
from ...health.inputs import NS_PER_S
from ...health.wear.trend import preload_trend
from ...messages.samples import Floats
from ...recordings.columns import TraceError
from ..report.page import ESTIMATE, MUTED, STYLE, TRUTH, write_study

LEAD_M = 0.008
LIMITS = (90.0, 85.0, 80.0)
COLUMNS = ("time_h", "speed_rpm", "drag_torque_nm")
LEVEL = 0.9
_S_PER_H = 3600.0
_STAGE_H, _SPEED_STEP_H = 35.0, 140.0
_SPEED_RPM, _SPEED_STEP_RPM = 300.0, 200.0
"""Test of Xi'an Jiaotong University: a reading every 35 h, 200 r/min more every 140 h."""


@dataclass(frozen=True, slots=True)
class Date:
    """Time at which a limit is crossed, h from new, with its band; no end within sight is inf."""

    earliest_h: float
    likely_h: float
    latest_h: float

    def holds(self, time_h: float) -> bool:
        """Containment of a time in the band."""
        return self.earliest_h <= time_h <= self.latest_h


@dataclass(frozen=True, slots=True)
class Stage:
    """A reading, percent of fresh, and the date stated after it for each limit that has one."""

    time_h: float
    percent: float
    dates: Mapping[float, Date]


@dataclass(frozen=True, slots=True)
class WearStudy:
    """All that was stated of one screw, and what came, by limit in percent of fresh."""

    stages: tuple[Stage, ...]
    crossings_h: Mapping[float, float]  # when a reading first lay below, h from new; inf if never
    # stated, held: dates stated before the crossing, and bands that held it
    stated: int
    held: int


def reproduce_wear(path: Path, out: Path) -> Answer:
    """Write `report.html` and `wear.png` into `out`. Raises TraceError: no wear test."""
    found = study(*read_wear_test(path))
    lines = [f"{'h':>6} {'drag %':>7}  " + "".join(f"{limit:<26g}" for limit in LIMITS).rstrip()]
    lines += [_line(stage, found.crossings_h) for stage in found.stages]
    for limit, came_h in found.crossings_h.items():
        said = f"first reading below at {came_h:.0f} h" if math.isfinite(came_h) else "not reached"
        lines.append(f"{limit:g} % of fresh: {said}")
    verdict = f"{found.held} of {found.stated} {LEVEL:.0%} bands held what came."
    text, title = "\n".join(lines), "Dates of a screw that wore out"
    write_study(out, "wear", title, verdict, text, draw_wear(found))
    return Answer(f"{text}\n{verdict}\nreport: {out / 'report.html'}", found)


def read_wear_test(path: Path) -> tuple[Floats, Floats, Floats]:
    """Times in h, way run until each in m and drag torque in N m, each (n,). Raises TraceError.

    Of a table `time_h,speed_rpm,drag_torque_nm`, the speed of a row being that since the row
    before, or of one drag torque a line, as in a test of Xi'an Jiaotong University.
    """
    try:
        lines = path.read_text("utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise TraceError(f"{path}: {error}") from None
    rows = [(number, row) for number, row in enumerate(csv.reader(lines), 1) if any(row)]
    header = [each.strip() for each in rows[0][1]] if rows else []
    named = not set(COLUMNS).isdisjoint(header)
    if named and not set(COLUMNS) <= set(header):
        raise TraceError(f"{path}: line {rows[0][0]}: expected the columns {', '.join(COLUMNS)}")
    columns = {name: header.index(name) for name in COLUMNS} if named else {COLUMNS[-1]: 0}
    table: dict[str, list[float]] = {name: [] for name in columns}
    for number, row in rows[named:]:
        for name, place in columns.items():
            value, text = math.nan, row[place] if place < len(row) else ""
            with contextlib.suppress(ValueError):
                value = float(text)
            if not (0.0 < value < math.inf or (name == "time_h" and value == 0.0)):
                raise TraceError(f"{path}: line {number}: {text[:40]!r} is no {name} above 0")
            table[name].append(value)
    drag_nm = np.array(table[COLUMNS[-1]])
    if drag_nm.size < 2:
        raise TraceError(f"{path}: expected a drag torque in N m on each of at least 2 lines")
    time_h = _STAGE_H * np.arange(drag_nm.size, dtype=np.float64)
    steps = np.maximum(np.ceil(time_h / _SPEED_STEP_H) - 1.0, 0.0)
    speed_rpm = _SPEED_RPM + steps * _SPEED_STEP_RPM
    if named:
        time_h, speed_rpm = np.array(table["time_h"]), np.array(table["speed_rpm"])
    if np.any(np.diff(time_h) <= 0.0):
        raise TraceError(f"{path}: time_h: expected times that rise")
    way_m = 60.0 * LEAD_M * np.diff(time_h, prepend=time_h[0]) * speed_rpm
    return time_h, np.cumsum(way_m), drag_nm


def study(time_h: Floats, distance_m: Floats, drag_nm: Floats) -> WearStudy:
    """Ask the trend after every reading, (n,) each, with the readings until then."""
    percent = 100.0 * drag_nm / drag_nm[0]
    came_h = {limit: first_crossing_h(time_h, percent, limit) for limit in LIMITS}
    stages, judged = [], []
    for end in range(1, time_h.size + 1):
        stage = Stage(
            float(time_h[end - 1]),
            float(percent[end - 1]),
            stated_dates(time_h[:end], distance_m[:end], percent[:end]),
        )
        stages.append(stage)
        for limit, date in stage.dates.items():
            if stage.time_h < came_h[limit] < math.inf:
                judged.append(date.holds(came_h[limit]))
    return WearStudy(tuple(stages), came_h, len(judged), sum(judged))


def stated_dates(time_h: Floats, distance_m: Floats, percent: Floats) -> dict[float, Date]:
    """Dates that the service would state of a screw of which it has seen so much.

    The readings come without an interval; their scatter tells it.
    """
    limits = {f"{limit:g}": limit for limit in LIMITS}
    trend = preload_trend(time_h * _S_PER_H, percent, np.zeros_like(percent), distance_m, limits)
    dates = {}
    for each in trend.crossings:
        if each.likely_ns is not None:
            times = (each.earliest_ns, each.likely_ns, each.latest_ns)
            hours = (math.inf if t is None else t / (NS_PER_S * _S_PER_H) for t in times)
            dates[each.limit_percent] = Date(*hours)
    return dates


def first_crossing_h(time_h: Floats, percent: Floats, limit: float) -> float:
    """Time at which the drag first fell below a limit, straight between readings; inf if never."""
    below = percent < limit
    if not below.any():
        return math.inf
    first = int(np.argmax(below))
    between = slice(max(first - 1, 0), first + 1)
    return float(np.interp(-limit, -percent[between], time_h[between]))


def _line(stage: Stage, crossings_h: Mapping[float, float]) -> str:
    cells = []
    for limit, came_h in crossings_h.items():
        date = stage.dates.get(limit)
        if date is None or stage.time_h >= came_h:
            cells.append("passed" if stage.time_h >= came_h else "no date yet")
            continue
        latest = f"{date.latest_h:.0f}" if math.isfinite(date.latest_h) else "open"
        verdict = "held" if date.holds(came_h) else "missed"
        verdict = verdict if math.isfinite(came_h) else "?"
        cells.append(f"{date.likely_h:.0f} ({date.earliest_h:.0f} to {latest}) {verdict}")
    row = "".join(f"{each:<26}" for each in cells)
    return f"{stage.time_h:6.0f} {stage.percent:7.1f}  {row}".rstrip()


def draw_wear(found: WearStudy) -> Figure:
    """Drag with its limits, and a panel for each limit: date stated against when it was stated."""
    time_h = [each.time_h for each in found.stages]
    top_h = 1.6 * time_h[-1]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 5.4), layout="constrained")
        grid = figure.add_gridspec(2, len(LIMITS), height_ratios=(1.0, 1.3))
        drag = figure.add_subplot(grid[0, :])
        percent = [each.percent for each in found.stages]
        drag.plot(time_h, percent, "o-", color=TRUTH, ms=3.5, lw=1.0)
        drag.set(xlabel="h from new", ylabel="drag, % of fresh")
        shared: Axes | None = None
        for column, (limit, came_h) in enumerate(found.crossings_h.items()):
            drag.axhline(limit, color=MUTED, linestyle=":", lw=1.0)
            shared = axes = figure.add_subplot(grid[1, column], sharey=shared)
            for stage in found.stages:
                if date := stage.dates.get(limit):
                    latest_h = min(date.latest_h, 2.0 * top_h)
                    axes.vlines(stage.time_h, date.earliest_h, latest_h, color=ESTIMATE, lw=2.0)
                    axes.plot(stage.time_h, date.likely_h, "o", color=ESTIMATE, ms=3.5)
            if math.isfinite(came_h):
                axes.axhline(came_h, color=TRUTH, lw=1.2)
            axes.set(title=f"crossing of {limit:g} %", xlabel="stated at, h")
            axes.set(xlim=(0.0, time_h[-1]), ylim=(0.0, top_h))
        figure.axes[1].set_ylabel("date, h from new")
    return figure
