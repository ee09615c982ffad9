"""`edge-service motion`: motions as files for a controller, and what they could tell apart."""

import difflib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..atomic import replaced_file
from ..command_answer import Answer, progress
from ..diagnose.experiment import (
    DECISIVE,
    Separation,
    healthy_session,
    least_strength,
    propose,
    rehearsed,
    separations,
)
from ..models.effects.effect import Parameter, Role
from ..models.effects.registry import effect_names, get_effect
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
from .diagnosis.gap import DiagnosisError, read_runs

COLUMNS = ("time_s", "position_setpoint_m", "speed_setpoint_m_s", "acceleration_setpoint_m_s2")
SETPOINTS, NC_PROGRAM = ".csv", ".mpf"
MOST_ROWS = 20_000_000
SAMPLES_PER_CYCLE = 2.5
"""At least, of the highest frequency in a motion."""
_CHUNK = 50_000
_FORMAT = ("%.6f", "%.10f", "%.9f", "%.7f")
LONGEST_S = 300.0
_SHOWN = 4
_NEVER = 1e3
"""Strength, in typical ones, from which an effect counts as never shown."""
_DOUBTED = 0.9
Values = Mapping[str, float]


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
    name: str, machine: Machine, out: Path, settings: MotionFileSettings = MotionFileSettings()
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
        waves = [each.wave for each in plan.segments if isinstance(each, Shaken)]
        shaken = [w.high_hz if isinstance(w, Chirp) else float(w.lines_hz[-1]) for w in waves]
        least_hz = SAMPLES_PER_CYCLE * max(shaken, default=0.0)
        if rate_hz < least_hz:
            raise MotionError(
                f"{name}: a rate of {rate_hz:g} Hz for frequencies up to {max(shaken):g} Hz; "
                f"expected at least {least_hz:g} Hz"
            )
        _check_rows(name, plan.duration_s * rate_hz)
    progress(f"writing {name}")
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
    size = "blocks" if rate_hz is None else f"setpoints at {rate_hz:g} Hz"
    line = f"{out}: {name}, {plan.duration_s:.1f} s, {rows} {size}"
    document = {"out": str(out), "motion": name, "duration_s": plan.duration_s, "rows": rows}
    document |= {"rate_hz": rate_hz, "left_out": list(plan.left_out)}
    return Answer("\n".join((line, *(f"left out: {each}" for each in plan.left_out))), document)


def _check_rows(name: str, rows: float) -> None:
    if not rows <= MOST_ROWS:
        raise MotionError(f"{name}: {rows:.3g} setpoints; expected at most {MOST_ROWS}")


def _header(name: str, machine: Machine, limits: MotionLimits, plan: Plan, seed: int) -> list[str]:
    assumed = ", ".join(assumed_limits(machine))
    return [
        f"motion {name}: {MOTIONS[name].purpose}",
        f"axis {machine.axis.name}, lead {1e3 * limits.lead_m:g} mm, "
        f"duration {plan.duration_s:.3f} s, seed {seed}",
        f"position {1e3 * limits.low_m:g} to {1e3 * limits.high_m:g} mm from the fixed-bearing "
        f"end; start and rest at {1e3 * limits.low_m:g} mm",
        f"speed {6e4 * limits.speed_m_s:g} mm/min, acceleration {limits.acceleration_m_s2:g} m/s2, "
        f"torque {limits.torque_nm:g} N m, jerk of moves {limits.jerk_m_s3:g} m/s3",
        *((f"assumed, as the machine file lacks them: {assumed}",) if assumed else ()),
        *(f"left out: {line}" for line in plan.left_out),
    ]


def tied_effects(diagnosis: Path) -> dict[str, Values]:
    """Effects between which a diagnosis could not decide, with the values that it found.

    Raises DiagnosisError: the file is no diagnosis, or it leaves no doubt.
    """
    try:
        named = json.loads(diagnosis.read_text("utf-8"))["effects"]
        tied: dict[str, Values] = {}
        for each in named:
            if len(each["class"]) > 1 or each["probability"] < _DOUBTED:
                tied |= {rival: tied.get(rival, {}) for rival in each["class"]}
                first = (each.get("entries") or [{}])[0]
                tied[each["name"]] = {key: float(value) for key, value in first.items()}
    except OSError as error:
        raise DiagnosisError(f"{diagnosis}: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise DiagnosisError(f"{diagnosis}: no diagnosis.json of edge-service diagnose") from error
    if len(tied) < 2:
        raise DiagnosisError(f"{diagnosis}: names no effects that are tied; give them by --effect")
    return dict(sorted(tied.items()))


def next_motion(
    machine: Machine, tied: Mapping[str, Values], out: Path | None, settings: MotionFileSettings
) -> Answer:
    """Propose the shortest motion that decides, write it to `out` if given, and say why.

    Raises DiagnosisError, MotionError.
    """
    for name, values in tied.items():
        try:
            get_effect(name).complete(values)
        except ValueError as error:
            raise DiagnosisError(str(error)) from error
    if len(tied) < 2:
        raise DiagnosisError("motion next: expected two effects or more that are tied")
    proposals = propose(machine, list(tied), tied, LONGEST_S, progress)
    if not proposals:
        raise DiagnosisError("motion next: the axis allows none of the known motions")
    best = proposals[0]
    worst = min(best.separations, key=lambda each: each.evidence)
    pair = [worst.effect, worst.rival or "a healthy axis"]
    shown, calls = [], []
    for each in proposals[: 1 if best.decides else _SHOWN]:
        proposed = {"motion": each.motion, "duration_s": each.duration_s}
        shown.append(proposed | {"given_s": each.given_s, "log_evidence": each.evidence})
        given = f" --duration {each.given_s:g}" if each.given_s else ""
        odds = f"{math.exp(min(each.evidence, math.log(1000.0))):.0f} to 1"
        calls.append(
            f"edge-service motion {each.motion}{given}, {each.duration_s:.0f} s, expected evidence "
            f"{each.evidence:.1f} (odds {'over ' if odds == '1000 to 1' else ''}{odds})"
        )
    undecided = f"none of {LONGEST_S:g} s or less decides between {' and '.join(pair)}; best"
    head = "the shortest that decides" if best.decides else undecided
    lines = [f"{head}: {calls[0]}", *(f"  or {each}" for each in calls[1:])]
    document = {"decides": best.decides, "hardest_pair": pair, "proposals": shown, "file": None}
    if out is not None:
        chosen = replace(settings, duration_s=settings.duration_s or best.given_s)
        written = write_motion(best.motion, machine, out, chosen)
        document |= {"file": written.document}
        lines.append(written.words)
    return Answer("\n".join(lines), document)


def isolability(machine: Machine, subject: str) -> Answer:
    """A table: each effect, the strength from which it shows, and what it may be taken for.

    The motion is a named one, or that of a recording; what was measured there is not looked at.

    Raises DiagnosisError, MotionError.
    """
    if subject in MOTIONS:
        session = rehearsed(machine, subject)
    elif Path(subject).exists():
        session = healthy_session(machine, read_runs(machine, (Path(subject),)))
        subject = Path(subject).name
    else:
        raise DiagnosisError(f"no motion or recording {subject!r}; there are {', '.join(MOTIONS)}")
    progress("what each effect would leave to each other one")
    found = separations(session, machine, effect_names())
    rows, effects = [("effect", "shows from", "a typical fault could be taken for")], []
    for alone in found:
        if alone.rival is not None:
            continue
        name, least = alone.effect, least_strength(alone)
        rivals = [e.rival for e in found if e.effect == name and e.evidence < DECISIVE and e.rival]
        looks_healthy, shows, shows_from = alone.evidence < DECISIVE, "never", None
        if least < _NEVER:
            leading, typical = _leading(name)
            amount = abs(typical) * least
            shows = f"{leading.name} {amount:.2g} {leading.unit}"
            shows_from = {"parameter": leading.name, "value": amount, "unit": leading.unit}
        effect = {"effect": name, "shows_from": shows_from}
        effects.append(effect | {"looks_healthy": looks_healthy, "rivals": rivals})
        tied = ", ".join(rivals) or "nothing else"
        rows.append((name, shows, "a healthy axis" if looks_healthy else tied))
    classes, channels = _classes(found), list(session.channels)
    widths = [max(len(row[k]) for row in rows) for k in (0, 1)]
    lines = [f"{subject}: {', '.join(channels)}"]
    lines += [f"  {a:<{widths[0]}}  {b:<{widths[1]}}  {c}" for a, b, c in rows]
    lines += [f"one class: {', '.join(each)}" for each in classes]
    document = {"subject": subject, "channels": channels, "effects": effects, "classes": classes}
    return Answer("\n".join(lines), document)


def _leading(name: str) -> tuple[Parameter, float]:
    """The parameter that scales an effect, with its typical value."""
    effect = get_effect(name)
    amounts = [p for p in effect.parameters if p.role is Role.AMOUNT] or list(effect.parameters)
    values = effect.complete({})
    leading = next((p for p in amounts if values[p.name] != 0.0), amounts[0])
    return leading, values[leading.name]


def _classes(found: Sequence[Separation]) -> list[list[str]]:
    """Effects that show, yet are mutually taken for one another."""
    shows = {each.effect for each in found if each.rival is None and each.evidence >= DECISIVE}
    tied = {(p.effect, p.rival) for p in found if p.rival and p.evidence < DECISIVE}
    classes: list[set[str]] = []
    for a, b in sorted((a, b) for a, b in tied if b and {a, b} <= shows and (b, a) in tied):
        joined = [each for each in classes if {a, b} & each]
        classes = [each for each in classes if each not in joined] + [{a, b}.union(*joined)]
    return [sorted(each) for each in classes]
