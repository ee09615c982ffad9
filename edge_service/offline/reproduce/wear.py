"""`edge-service reproduce wear`: dates that the service's trend states of a real screw.

The drag torque of a screw that wore out goes to the trend reading by reading; each date that it
states for a limit stands beside the time at which the limit was crossed.
"""

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...command_answer import Answer
from ...health.trend import NS_PER_S, preload_trend
from ...messages.samples import Floats
from ...recordings.columns import TraceError
from ..report.page import write_study
from ..report.pictures import ESTIMATE, MUTED, STYLE, TRUTH

LEAD_M = 0.008
LIMITS = (90.0, 85.0, 80.0)
COLUMNS = ("time_h", "speed_rpm", "drag_torque_nm")
LEVEL = 0.9
_S_PER_H = 3600.0
_STAGE_H, _SPEED_STEP_H = 35.0, 140.0
_SPEED_RPM, _SPEED_STEP_RPM = 300.0, 200.0
"""Test of Xi'an Jiaotong University: a reading every 35 h, 200 r/min more every 140 h."""


@dataclass(frozen=True, slots=True, eq=False)
class WearTest:
    """Readings of one screw; the first is that of the fresh screw.

    Attributes:
        time_h, distance_m: time and way run until each reading, (n,).
        drag_nm: mean drag torque, N m, (n,).
    """

    time_h: Floats
    distance_m: Floats
    drag_nm: Floats

    @property
    def percent(self) -> Floats:
        """Drag in percent of the fresh screw's, (n,)."""
        return np.asarray(100.0 * self.drag_nm / self.drag_nm[0])


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
class Crossing:
    """Time at which a limit was crossed, h from new, straight between readings; inf if never.

    Attributes:
        first_h: when a reading first lay below.
        last_h: when the last reading above it was left for good.
    """

    first_h: float
    last_h: float


@dataclass(frozen=True, slots=True)
class WearStudy:
    """All that was stated of one screw, and what came, by limit in percent of fresh.

    Attributes:
        stated, held: dates stated before the first crossing, and bands that held it.
    """

    stages: tuple[Stage, ...]
    crossings: Mapping[float, Crossing]
    stated: int
    held: int


def reproduce_wear(path: Path, out: Path) -> Answer:
    """Write `report.html` and `wear.png` into `out`. Raises TraceError: no wear test."""
    test = read_wear_test(path)
    found = study(test)
    lines = [f"{'h':>6} {'drag %':>7}  " + "".join(f"{limit:<26g}" for limit in LIMITS).rstrip()]
    lines += [_line(stage, found.crossings) for stage in found.stages]
    for limit, came in found.crossings.items():
        last = f"for good at {came.last_h:.0f} h" if math.isfinite(came.last_h) else "not for good"
        first = f"first reading below at {came.first_h:.0f} h, {last}"
        said = first if math.isfinite(came.first_h) else "not reached"
        lines.append(f"{limit:g} % of fresh: {said}")
    verdict = f"{found.held} of {found.stated} {LEVEL:.0%} bands held what came."
    write_study(
        out,
        "wear",
        "Dates of a screw that wore out",
        verdict,
        "\n".join(lines),
        draw_wear(test, found),
    )
    words = "\n".join([*lines, verdict, f"report: {out / 'report.html'}"])
    return Answer(words, found)


def read_wear_test(path: Path) -> WearTest:
    """Read `time_h,speed_rpm,drag_torque_nm`, or one drag torque a line, N m. Raises TraceError.

    The speed of a row is that since the row before. Drag torques alone are a test of Xi'an
    Jiaotong University.
    """
    try:
        lines = path.read_text("utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise TraceError(f"{path}: {error}") from None
    rows = [(number, line) for number, line in enumerate(csv.reader(lines), 1) if any(line)]
    named = rows and any(name in COLUMNS for name in rows[0][1])
    header = [each.strip() for each in rows[0][1]] if named else ["drag_torque_nm"]
    if named and not set(COLUMNS) <= set(header):
        raise TraceError(f"{path}: line {rows[0][0]}: expected the columns {', '.join(COLUMNS)}")
    content = rows[1:] if named else rows
    drag_nm = np.array([_number(path, *row, header, "drag_torque_nm") for row in content])
    if drag_nm.size < 2:
        raise TraceError(f"{path}: expected a drag torque in N m on each of at least 2 lines")
    if named:
        time_h = np.array([_number(path, *row, header, "time_h") for row in content])
        speed_rpm = np.array([_number(path, *row, header, "speed_rpm") for row in content])
        if np.any(np.diff(time_h) <= 0.0):
            raise TraceError(f"{path}: time_h: expected times that rise")
    else:
        time_h = _STAGE_H * np.arange(drag_nm.size, dtype=np.float64)
        steps = np.maximum(np.ceil(time_h / _SPEED_STEP_H) - 1.0, 0.0)
        speed_rpm = _SPEED_RPM + steps * _SPEED_STEP_RPM
    way_m = 60.0 * LEAD_M * np.diff(time_h, prepend=time_h[0]) * speed_rpm
    return WearTest(time_h, np.cumsum(way_m), drag_nm)


def _number(path: Path, number: int, row: list[str], header: list[str], column: str) -> float:
    """Value of a row; only times may be 0. Raises TraceError."""
    text = row[header.index(column)] if len(row) > header.index(column) else ""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (0.0 < value < math.inf or (column == "time_h" and value == 0.0)):
        raise TraceError(f"{path}: line {number}: {text[:40]!r} is no {column} above 0")
    return value


def study(test: WearTest, limits: Sequence[float] = LIMITS) -> WearStudy:
    """Ask the trend after every reading, each time with the readings until then."""
    came = {limit: crossing(test, limit) for limit in limits}
    stages = []
    for count in range(1, test.time_h.size + 1):
        seen = WearTest(test.time_h[:count], test.distance_m[:count], test.drag_nm[:count])
        dates = trend_dates(seen, limits)
        stages.append(Stage(float(seen.time_h[-1]), float(seen.percent[-1]), dates))
    judged = [
        date.holds(came[limit].first_h)
        for stage in stages
        for limit, date in stage.dates.items()
        if stage.time_h < came[limit].first_h < math.inf
    ]
    return WearStudy(tuple(stages), came, len(judged), sum(judged))


def trend_dates(seen: WearTest, limits: Sequence[float]) -> dict[float, Date]:
    """Dates that the service would state of a screw of which it has seen so much.

    The readings come without an interval; their scatter tells it.
    """
    trend = preload_trend(
        seen.time_h * _S_PER_H,
        seen.percent,
        np.zeros_like(seen.percent),
        seen.distance_m,
        {f"{limit:g}": limit for limit in limits},
    )
    dates = {}
    for each in trend.crossings:
        if each.likely_ns is not None:
            times = (each.earliest_ns, each.likely_ns, each.latest_ns)
            hours = (math.inf if t is None else t / (NS_PER_S * _S_PER_H) for t in times)
            dates[each.limit_percent] = Date(*hours)
    return dates


def crossing(test: WearTest, limit: float) -> Crossing:
    """Times at which the drag fell below a limit, percent of fresh; perhaps two, by scatter."""
    below = test.percent < limit
    first = int(np.argmax(below)) if below.any() else below.size
    last = below.size if not below[-1] else below.size - int(np.argmin(below[::-1]))
    times = [math.inf, math.inf]
    for place, after in enumerate((first, last)):
        if after < below.size:
            between = slice(max(after - 1, 0), after + 1)
            falling = -test.percent[between]
            times[place] = float(np.interp(-limit, falling, test.time_h[between]))
    return Crossing(*times)


def _line(stage: Stage, crossings: Mapping[float, Crossing]) -> str:
    """Row of the table: dates with bands, and whether they held what came."""
    cells = []
    for limit, came in crossings.items():
        date = stage.dates.get(limit)
        if date is None:
            cells.append("passed" if stage.time_h >= came.first_h else "no date yet")
            continue
        latest = f"{date.latest_h:.0f}" if math.isfinite(date.latest_h) else "open"
        verdict = "held" if date.holds(came.first_h) else "missed"
        verdict = verdict if math.isfinite(came.first_h) else "?"
        cells.append(f"{date.likely_h:.0f} ({date.earliest_h:.0f} to {latest}) {verdict}")
    row = "".join(f"{each:<26}" for each in cells)
    return f"{stage.time_h:6.0f} {stage.percent:7.1f}  {row}".rstrip()


def draw_wear(test: WearTest, found: WearStudy) -> Figure:
    """Drag with its limits, and a panel for each limit: date stated against when it was stated."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 5.4), layout="constrained")
        grid = figure.add_gridspec(2, len(found.crossings), height_ratios=(1.0, 1.3))
        drag = figure.add_subplot(grid[0, :])
        drag.plot(test.time_h, test.percent, "o-", color=TRUTH, ms=3.5, lw=1.0)
        drag.set(xlabel="h from new", ylabel="drag, % of fresh")
        top_h = 1.6 * float(test.time_h[-1])
        shared: Axes | None = None
        for column, (limit, came) in enumerate(found.crossings.items()):
            drag.axhline(limit, color=MUTED, linestyle=":", lw=1.0)
            shared = axes = figure.add_subplot(grid[1, column], sharey=shared)
            stated = [(e.time_h, e.dates[limit]) for e in found.stages if limit in e.dates]
            for at_h, date in stated:
                latest_h = min(date.latest_h, 2.0 * top_h)
                axes.vlines(at_h, date.earliest_h, latest_h, color=ESTIMATE, lw=2.0)
                axes.plot(at_h, date.likely_h, "o", color=ESTIMATE, ms=3.5)
            if math.isfinite(came.first_h):
                last_h = min(came.last_h, top_h)
                axes.axhspan(came.first_h, last_h, color=TRUTH, alpha=0.15, lw=0.0)
                axes.axhline(came.first_h, color=TRUTH, lw=1.2)
            axes.set(title=f"crossing of {limit:g} %", xlabel="stated at, h")
            axes.set(xlim=(0.0, float(test.time_h[-1])), ylim=(0.0, top_h))
        figure.axes[1].set_ylabel("date, h from new")
    return figure
