"""`edge-service motion isolability`: what a motion could show, before anything is measured."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from ...diagnose.experiment.isolability import (
    DECISIVE,
    Separation,
    least_strength,
    rehearsed,
    separations,
)
from ...diagnose.session.session import Session
from ...diagnose.session.twin import healthy_session
from ...models.effects.effect import Effect, Role
from ...models.effects.registry import effect_names, get_effect
from ...models.machine import Machine
from ...models.motions.registry import MOTIONS
from ..diagnosis.sessions import DiagnosisError, read_runs

_NEVER = 1e3


def isolability(
    machine: Machine,
    motion: str | None,
    traces: Sequence[Path],
    progress: Callable[[str], None] = lambda _line: None,
) -> str:
    """A table: each effect, the strength from which it shows, and what it may be taken for.

    The motion is a named one, or that of recordings; what was measured there is not looked at.

    Raises:
        DiagnosisError: neither or both, or no such motion.
        MotionError: the axis does not allow the motion. TraceError: a recording cannot be read.
    """
    if (motion is None) == (not traces):
        raise DiagnosisError("motion isolability: expected either --motion NAME or a trace")
    session = _session(machine, motion, traces)
    progress("what each effect would leave to each other one")
    found = separations(session, machine, effect_names())
    subject = motion or ", ".join(path.name for path in traces)
    return "\n".join([f"{subject}: {', '.join(session.channels)}", *_table(found)])


def _session(machine: Machine, motion: str | None, traces: Sequence[Path]) -> Session:
    if motion is None:
        return healthy_session(machine, read_runs(machine, traces), 1)
    if motion not in MOTIONS:
        raise DiagnosisError(f"no motion {motion!r}; there are {', '.join(MOTIONS)}")
    return rehearsed(machine, motion)


def _table(found: Sequence[Separation]) -> list[str]:
    alone = {each.effect: each for each in found if each.rival is None}
    rows = [("effect", "shows from", "a typical fault could be taken for")]
    for name, each in alone.items():
        rivals = [p.rival for p in found if p.effect == name and p.evidence < DECISIVE and p.rival]
        shows = least_strength(each) < _NEVER
        tied = ", ".join(rivals) or "nothing else"
        if each.evidence < DECISIVE:
            tied = "a healthy axis"
        rows.append((name, _strength(get_effect(name), each) if shows else "never", tied))
    widths = [max(len(row[k]) for row in rows) for k in (0, 1)]
    table = [f"  {a:<{widths[0]}}  {b:<{widths[1]}}  {c}" for a, b, c in rows]
    return [*table, *(f"one class: {', '.join(each)}" for each in _classes(found))]


def _strength(effect: Effect, alone: Separation) -> str:
    """The strength that shows, in the parameter that scales the effect."""
    amounts = [p for p in effect.parameters if p.role is Role.AMOUNT] or list(effect.parameters)
    values: Mapping[str, float] = effect.complete({})
    leading = next((p for p in amounts if values[p.name] != 0.0), amounts[0])
    return f"{leading.name} {abs(values[leading.name]) * least_strength(alone):.2g} {leading.unit}"


def _classes(found: Sequence[Separation]) -> list[list[str]]:
    """Effects that show, yet are mutually taken for one another."""
    shows = {each.effect for each in found if each.rival is None and each.evidence >= DECISIVE}
    tied = {(p.effect, p.rival) for p in found if p.rival and p.evidence < DECISIVE}
    classes: list[set[str]] = []
    for a, b in sorted((a, b) for a, b in tied if b and {a, b} <= shows and (b, a) in tied):
        joined = [each for each in classes if {a, b} & each]
        classes = [each for each in classes if each not in joined] + [{a, b}.union(*joined)]
    return [sorted(each) for each in classes]
