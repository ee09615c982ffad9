"""`edge-service motion next`: the motion that tells tied explanations apart, and how well."""

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path

from ..diagnose.isolability import DECISIVE, propose, rehearsed, separations
from ..models.effects.registry import effect_names, get_effect
from ..models.machine import Machine
from .machine_gap import DiagnosisError
from .motion_file import MotionFileSettings, write_motion

_SHOWN = 4


def tied_effects(diagnosis: Path) -> list[str]:
    """Effects between which a diagnosis could not decide.

    Raises:
        DiagnosisError: the file is no diagnosis, or it leaves no doubt.
    """
    try:
        document = json.loads(diagnosis.read_text("utf-8"))
        named = document["effects"]
        tied = {name for each in named for name in each["class"] if len(each["class"]) > 1}
        tied |= {each["name"] for each in named if each["probability"] < 0.9}
    except OSError as error:
        raise DiagnosisError(f"{diagnosis}: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise DiagnosisError(f"{diagnosis}: no diagnosis.json of edge-service diagnose") from error
    if len(tied) < 2:
        raise DiagnosisError(f"{diagnosis}: names no effects that are tied; give them by --effect")
    return sorted(tied)


def next_motion(
    machine: Machine,
    effects: Sequence[str],
    out: Path | None,
    settings: MotionFileSettings,
    progress: Callable[[str], None] = lambda _line: None,
) -> str:
    """Propose the shortest motion that decides, write it to `out` if given, and say why.

    Raises:
        DiagnosisError: an unknown effect, or fewer than two.
        MotionError: the axis allows no motion at all.
    """
    for name in effects:
        try:
            get_effect(name)
        except ValueError as error:
            raise DiagnosisError(str(error)) from error
    if len(set(effects)) < 2:
        raise DiagnosisError("motion next: expected two effects or more that are tied")
    progress("rehearsing every motion on the twin")
    proposals = propose(machine, effects)
    if not proposals:
        raise DiagnosisError("motion next: the axis allows none of the known motions")
    best = proposals[0]
    lines = [
        f"{'decides' if best.evidence >= DECISIVE else 'decides best'}: {best.motion}, "
        f"{best.duration_s:.0f} s, expected evidence {best.evidence:.1f} "
        f"(odds {_odds(best.evidence)})"
    ]
    lines += [
        f"  or {each.motion}: {each.duration_s:.0f} s, {each.evidence:.1f}"
        for each in proposals[1:_SHOWN]
    ]
    if out is not None:
        lines.append(write_motion(best.motion, machine, out, settings, progress))
    return "\n".join(lines)


def isolability(machine: Machine, motion: str) -> str:
    """Which effects a motion tells apart, as lines: effect, and what it may be taken for."""
    session = rehearsed(machine, motion)
    pairs = separations(session, machine, effect_names())
    lines = [f"{motion}: what a typical fault could be taken for"]
    for name in effect_names():
        tied = [p.rival for p in pairs if p.effect == name and p.evidence < DECISIVE]
        if len(tied) == len(effect_names()) - 1:
            lines.append(f"  {name}: does not show")
        else:
            lines.append(f"  {name}: {', '.join(tied) or 'nothing else'}")
    return "\n".join(lines)


def _odds(evidence: float) -> str:
    return "over 1000 to 1" if evidence > 6.9 else f"{math.exp(evidence):.0f} to 1"
