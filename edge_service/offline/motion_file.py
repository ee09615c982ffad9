"""A named motion as a file for a controller: setpoints as CSV, or an NC program."""

import difflib
import math
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..atomic import replaced_file
from ..command_answer import Answer
from ..models.machine import Machine
from ..models.motions.excitation import Shaken
from ..models.motions.limits import assumed_limits
from ..models.motions.nc_program import nc_blocks
from ..models.motions.registry import (
    MOTIONS,
    Motion,
    MotionError,
    MotionLimits,
    Plan,
    Setpoints,
    motion_limits,
)
from ..models.motions.segments import samples_of
from .document import Document
from .report.page import ESTIMATE, STYLE, write_png

COLUMNS = ("time_s", "position_setpoint_m", "speed_setpoint_m_s", "acceleration_setpoint_m_s2")
SETPOINTS, NC_PROGRAM = ".csv", ".mpf"
MOST_ROWS = 20_000_000
SAMPLES_PER_CYCLE = 2.5
"""At least, of the highest frequency in a motion."""

_CHUNK = 50_000
ENDLESS_SHOWN_S = 30.0
"""Of a motion without end, in a picture."""
_COLUMNS, _RATE_HZ, _DPI = 2, 100.0, 90
_FORMAT = ("%.6f", "%.10f", "%.9f", "%.7f")
Progress = Callable[[str], None]


class ListedMotion(Document):
    """A motion on this axis; without a duration it is endless, or refused."""

    name: str
    duration_s: float | None
    refused_because: str | None
    purpose: str


class ListedMotions(Document):
    """Every motion, and the picture of them where one was asked for."""

    motions: list[ListedMotion]
    picture: str | None


class MotionFile(Document):
    """File of a motion: setpoints at `rate_hz`, or blocks of a program, which has no rate."""

    out: str
    motion: str
    duration_s: float
    rows: int
    rate_hz: float | None
    left_out: list[str]

    def as_text(self) -> str:
        """One line, and one on each part that was left out."""
        size = "blocks" if self.rate_hz is None else f"setpoints at {self.rate_hz:g} Hz"
        line = f"{self.out}: {self.motion}, {self.duration_s:.1f} s, {self.rows} {size}"
        return "\n".join((line, *(f"left out: {each}" for each in self.left_out)))


@dataclass(frozen=True, slots=True)
class MotionFileSettings:
    """Settings for writing a motion.

    Attributes:
        duration_s: of the whole; the motion's own unless given.
        rate_hz: of the setpoints; an NC program has none.
        seed: of what is left to chance.
        clip: leave out, and name, what the axis does not allow.
    """

    duration_s: float | None = None
    rate_hz: float = 1000.0
    seed: int = 1
    clip: bool = False


def list_motions(machine: Machine, out: Path | None = None) -> Answer:
    """Every motion with its duration on this axis; drawn to `out`, a .png. Raises MotionError."""
    limits = motion_limits(machine)
    listed, lines = [], []
    for name, motion in MOTIONS.items():
        duration_s, refused, purpose = None, None, motion.purpose
        try:
            duration_s = motion.duration_s(limits)
        except MotionError as error:
            refused = str(error)
        listed.append(
            ListedMotion(name=name, duration_s=duration_s, refused_because=refused, purpose=purpose)
        )
        length = "endless" if duration_s is None else f"{duration_s:.0f} s"
        if refused is not None:
            length, purpose = "refused", f"{purpose} [{refused}]"
        lines.append(f"{name:<13}{length:>8}  {purpose}")
    if out is not None:
        _draw_motions(limits, out)
        lines.append(f"{out}: {len(MOTIONS)} motions")
    document = ListedMotions(motions=listed, picture=out and str(out))
    return Answer("\n".join(lines), document)


def _draw_motions(limits: MotionLimits, out: Path) -> None:
    """All motions as one PNG file; for those that the axis refuses the reason stands in it."""
    if out.suffix != ".png":
        raise MotionError(f"{out}: expected a name that ends in .png, for a picture of all motions")
    rows = math.ceil(len(MOTIONS) / _COLUMNS)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.6, 0.5 + 1.1 * rows), layout="constrained")
        panels = figure.subplots(rows, _COLUMNS, squeeze=False).flatten()
        for axes, name in zip(panels, MOTIONS, strict=True):
            try:
                _draw(axes, name, limits)
            except MotionError as error:
                axes.set_title(f"{name}, refused", loc="left", fontsize=9)
                reason = textwrap.fill(str(error), 60)
                axes.text(0.0, 0.9, reason, transform=axes.transAxes, fontsize=8, va="top")
                axes.set_axis_off()
        figure.supxlabel("time, s", fontsize=9)
        figure.supylabel("position, mm", fontsize=9)
    try:
        write_png(figure, out, _DPI)
    except OSError as error:
        raise MotionError(f"{out}: cannot be written ({error.strerror})") from None


def write_motion(
    name: str,
    machine: Machine,
    out: Path,
    settings: MotionFileSettings | None = None,
    progress: Progress | None = None,
) -> MotionFile:
    """Write a motion as `out` says, .csv or .mpf; it appears whole or not at all.

    Raises:
        MotionError: one line; the name, a setting, the axis or the file does not allow it.
    """
    settings = settings or MotionFileSettings()
    if name not in MOTIONS:
        near = difflib.get_close_matches(name, MOTIONS, 1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise MotionError(f"no motion {name!r}{hint}; there are {', '.join(MOTIONS)}")
    motion = MOTIONS[name]
    if out.suffix not in (SETPOINTS, NC_PROGRAM):
        raise MotionError(f"{out}: expected a name that ends in {SETPOINTS} or {NC_PROGRAM}")
    if machine.axis.stroke_m is None:
        raise MotionError(
            "axis.stroke_m: the machine file lacks it; a file that moves an axis needs it"
        )
    limits = motion_limits(machine)
    _check_settings(name, settings)
    random = np.random.default_rng((settings.seed, 1))
    plan = motion.plan(limits, random, duration_s=settings.duration_s, clip=settings.clip)
    header = _header(name, motion, machine, limits, plan, settings)
    if out.suffix == NC_PROGRAM:
        rows, rate_hz = _write_program(out, name, machine, plan, limits, header), None
    else:
        rate_hz = settings.rate_hz
        rows = _write_setpoints(out, name, plan, limits, rate_hz, header, progress)
    return MotionFile(
        out=str(out),
        motion=name,
        duration_s=plan.duration_s,
        rows=rows,
        rate_hz=rate_hz,
        left_out=list(plan.left_out),
    )


def _check_settings(name: str, settings: MotionFileSettings) -> None:
    duration, rate = settings.duration_s, settings.rate_hz
    if duration is not None and not (math.isfinite(duration) and duration > 0.0):
        raise MotionError(f"{name}: a duration of {duration:g} s; expected more than 0")
    if not (math.isfinite(rate) and rate > 0.0):
        raise MotionError(f"{name}: a rate of {rate:g} Hz; expected more than 0")
    _check_rows(name, (duration or 0.0) * rate)


def _check_rows(name: str, rows: float) -> None:
    if rows > MOST_ROWS:
        raise MotionError(f"{name}: {rows:.3g} setpoints; expected at most {MOST_ROWS}")


def _header(
    name: str,
    motion: Motion,
    machine: Machine,
    limits: MotionLimits,
    plan: Plan,
    settings: MotionFileSettings,
) -> tuple[str, ...]:
    assumed = ", ".join(assumed_limits(machine))
    return (
        f"motion {name}: {motion.purpose}",
        f"axis {machine.axis.name}, lead {limits.lead_m:g} m, duration {plan.duration_s:.3f} s, "
        f"seed {settings.seed}",
        f"position {limits.low_m:g} to {limits.high_m:g} m from the fixed-bearing end; start and "
        f"rest at {limits.low_m:g} m",
        f"speed {limits.speed_m_s:g} m/s, acceleration {limits.acceleration_m_s2:g} m/s2, "
        f"torque {limits.torque_nm:g} N m, jerk of moves {limits.jerk_m_s3:g} m/s3",
        *((f"assumed, as the machine file lacks them: {assumed}",) if assumed else ()),
        *(f"left out: {line}" for line in plan.left_out),
    )


def _write_program(
    out: Path,
    name: str,
    machine: Machine,
    plan: Plan,
    limits: MotionLimits,
    header: tuple[str, ...],
) -> int:
    blocks = list(nc_blocks(name, machine.axis.name, plan.segments, limits))
    allowed = f"ACC 100 % is taken as {limits.acceleration_m_s2:g} m/s2; set it in the machine data"
    with _opened(out) as file:
        file.writelines(f"; {line}\n" for line in (*header, allowed))
        file.writelines(f"{block}\n" for block in blocks)
    return len(blocks)


def _write_setpoints(
    out: Path,
    name: str,
    plan: Plan,
    limits: MotionLimits,
    rate_hz: float,
    header: tuple[str, ...],
    progress: Progress | None,
) -> int:
    fastest = max(
        (each.wave.highest_hz for each in plan.segments if isinstance(each, Shaken)), default=0.0
    )
    if rate_hz < SAMPLES_PER_CYCLE * fastest:
        raise MotionError(
            f"{name}: a rate of {rate_hz:g} Hz for frequencies up to {fastest:g} Hz; expected at "
            f"least {SAMPLES_PER_CYCLE * fastest:g} Hz"
        )
    _check_rows(name, plan.duration_s * rate_hz)
    count = 1 + sum(samples_of(segment, rate_hz) for segment in plan.segments)
    with _opened(out) as file:
        file.writelines(f"# {line}\n" for line in (*header, f"rate {rate_hz:g} Hz, {count} rows"))
        file.write(",".join(COLUMNS) + "\n")
        source = Setpoints(iter(plan.segments), limits.low_m, rate_hz)
        for first in range(0, count, _CHUNK):
            index = np.arange(first, min(first + _CHUNK, count))
            rows = np.column_stack((index / rate_hz, source.take(len(index))))
            np.savetxt(file, rows, fmt=_FORMAT, delimiter=",")
            if progress is not None:
                progress(f"{name}: {100 * (first + len(rows)) // count} %")
    return count


@contextmanager
def _opened(out: Path) -> Iterator[TextIO]:
    try:
        with replaced_file(out) as file:
            yield file
    except OSError as error:
        raise MotionError(f"{out}: cannot be written ({error.strerror})") from None


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
