"""A named motion as a file for a controller: setpoints as CSV, or an NC program."""

import difflib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..atomic import replaced_file
from ..command_answer import Answer, progress
from ..models.machine import Machine
from ..models.motions.excitation import Chirp, Shaken
from ..models.motions.limits import assumed_limits
from ..models.motions.nc_program import nc_blocks
from ..models.motions.registry import (
    MOTIONS,
    MotionError,
    MotionLimits,
    Plan,
    Setpoints,
    motion_limits,
)
from ..models.motions.route import samples_of

COLUMNS = ("time_s", "position_setpoint_m", "speed_setpoint_m_s", "acceleration_setpoint_m_s2")
SETPOINTS, NC_PROGRAM = ".csv", ".mpf"
MOST_ROWS = 20_000_000
SAMPLES_PER_CYCLE = 2.5
"""At least, of the highest frequency in a motion."""
_CHUNK = 50_000
_FORMAT = ("%.6f", "%.10f", "%.9f", "%.7f")


@dataclass(frozen=True, slots=True)
class MotionFileSettings:
    duration_s: float | None = None  # of the whole; the motion's own unless given
    rate_hz: float = 1000.0  # of the setpoints; an NC program has none
    seed: int = 1  # of what is left to chance
    clip: bool = False  # leave out, and name, what the axis does not allow


def list_motions(machine: Machine) -> Answer:
    """Every motion with its duration on this axis."""
    limits = motion_limits(machine)
    listed, lines = [], []
    for name, motion in MOTIONS.items():
        duration_s, refused, said = None, None, motion.purpose
        try:
            duration_s = motion.duration_s(limits)
            length = "endless" if duration_s is None else f"{duration_s:.0f} s"
        except MotionError as error:
            refused, length = str(error), "refused"
            said = f"{said} [{refused}]"
        row = {"name": name, "duration_s": duration_s, "refused_because": refused}
        listed.append(row | {"purpose": motion.purpose})
        lines.append(f"{name:<13}{length:>8}  {said}")
    return Answer("\n".join(lines), {"motions": listed})


def write_motion(
    name: str,
    machine: Machine,
    out: Path,
    settings: MotionFileSettings = MotionFileSettings(),
) -> Answer:
    """Write a motion as `out` says, .csv or .mpf; it appears whole or not at all.

    Raises MotionError: one line; the name, a setting, the axis or the file does not allow it.
    """
    if name not in MOTIONS:
        near = difflib.get_close_matches(name, MOTIONS, 1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise MotionError(f"no motion {name!r}{hint}; there are {', '.join(MOTIONS)}")
    if out.suffix not in (SETPOINTS, NC_PROGRAM):
        raise MotionError(f"{out}: expected a name that ends in {SETPOINTS} or {NC_PROGRAM}")
    if machine.axis.stroke_m is None:
        raise MotionError(
            "axis.stroke_m: the machine file lacks it; a file that moves an axis needs it"
        )
    _check_rows(name, (settings.duration_s or 0.0) * settings.rate_hz)
    limits = motion_limits(machine)
    random = np.random.default_rng((settings.seed, 1))
    plan = MOTIONS[name].plan(limits, random, duration_s=settings.duration_s, clip=settings.clip)
    header = _header(name, machine, limits, plan, settings.seed)
    rate_hz = settings.rate_hz if out.suffix == SETPOINTS else None
    blocks: list[str] = []
    if rate_hz is None:
        blocks = list(nc_blocks(name, machine.axis.name, plan.segments, limits))
    else:
        _check_rate(name, plan, rate_hz)
    progress(f"writing {name}")
    try:
        with replaced_file(out) as file:
            if rate_hz is None:
                acc = f"ACC 100 % is taken as {limits.acceleration_m_s2:g} m/s2"
                header += [f"{acc}; set it in the machine data"]
                file.writelines(f"; {line}\n" for line in header)
                file.writelines(f"{block}\n" for block in blocks)
                rows = len(blocks)
            else:
                rows = 1 + sum(samples_of(segment, rate_hz) for segment in plan.segments)
                header += [f"rate {rate_hz:g} Hz, {rows} rows"]
                file.writelines(f"# {line}\n" for line in header)
                file.write(",".join(COLUMNS) + "\n")
                source = Setpoints(iter(plan.segments), limits.low_m, rate_hz)
                for first in range(0, rows, _CHUNK):
                    index = np.arange(first, min(first + _CHUNK, rows))
                    table = np.column_stack((index / rate_hz, source.take(len(index))))
                    np.savetxt(file, table, fmt=_FORMAT, delimiter=",")
    except OSError as error:
        raise MotionError(f"{out}: cannot be written ({error.strerror})") from None
    size = "blocks" if rate_hz is None else f"setpoints at {rate_hz:g} Hz"
    line = f"{out}: {name}, {plan.duration_s:.1f} s, {rows} {size}"
    document = {"out": str(out), "motion": name, "duration_s": plan.duration_s, "rows": rows}
    document |= {"rate_hz": rate_hz, "left_out": list(plan.left_out)}
    return Answer("\n".join((line, *(f"left out: {each}" for each in plan.left_out))), document)


def _check_rows(name: str, rows: float) -> None:
    if not rows <= MOST_ROWS:
        raise MotionError(f"{name}: {rows:.3g} setpoints; expected at most {MOST_ROWS}")


def _check_rate(name: str, plan: Plan, rate_hz: float) -> None:
    waves = [each.wave for each in plan.segments if isinstance(each, Shaken)]
    shaken = [w.high_hz if isinstance(w, Chirp) else float(w.lines_hz[-1]) for w in waves]
    least_hz = SAMPLES_PER_CYCLE * max(shaken, default=0.0)
    if rate_hz < least_hz:
        raise MotionError(
            f"{name}: a rate of {rate_hz:g} Hz for frequencies up to {max(shaken):g} Hz; expected "
            f"at least {least_hz:g} Hz"
        )
    _check_rows(name, plan.duration_s * rate_hz)


def _header(name: str, machine: Machine, limits: MotionLimits, plan: Plan, seed: int) -> list[str]:
    assumed = ", ".join(assumed_limits(machine))
    return [
        f"motion {name}: {MOTIONS[name].purpose}",
        f"axis {machine.axis.name}, lead {limits.lead_m:g} m, duration {plan.duration_s:.3f} s, "
        f"seed {seed}",
        f"position {limits.low_m:g} to {limits.high_m:g} m from the fixed-bearing end; start and "
        f"rest at {limits.low_m:g} m",
        f"speed {limits.speed_m_s:g} m/s, acceleration {limits.acceleration_m_s2:g} m/s2, "
        f"torque {limits.torque_nm:g} N m, jerk of moves {limits.jerk_m_s3:g} m/s3",
        *((f"assumed, as the machine file lacks them: {assumed}",) if assumed else ()),
        *(f"left out: {line}" for line in plan.left_out),
    ]
