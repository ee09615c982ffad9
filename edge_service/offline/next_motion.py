"""`edge-service motion next` and `isolability`: what motions could tell apart, before a run."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

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
from ..models.motions.registry import MOTIONS
from .diagnosis.gap import DiagnosisError, read_runs
from .motion_file import MotionFileSettings, write_motion

LONGEST_S = 300.0
_SHOWN = 4
_NEVER = 1e3
"""Strength, in typical ones, from which an effect counts as never shown."""
_DOUBTED = 0.9
Values = Mapping[str, float]


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
