"""`edge-service motion isolability`: what a motion could show, before anything is measured."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from ...command_answer import Answer
from ...diagnose.experiment import (
    DECISIVE,
    Separation,
    least_strength,
    rehearsed,
    separations,
)
from ...diagnose.session.session import Session
from ...diagnose.session.twin import healthy_session
from ...models.effects.effect import Role
from ...models.effects.registry import effect_names, get_effect
from ...models.machine import Machine
from ...models.motions.registry import MOTIONS
from ..diagnosis.sessions import DiagnosisError, read_runs
from ..document import Document

_NEVER = 1e3


class Strength(Document):
    """Amount of an effect, in `unit`."""

    parameter: str
    value: float
    unit: str

    def as_text(self) -> str:
        """Parameter, amount and unit."""
        return f"{self.parameter} {self.value:.2g} {self.unit}"


class IsolableEffect(Document):
    """An effect, the strength from which it shows (null: never), and what it is taken for."""

    effect: str
    shows_from: Strength | None
    looks_healthy: bool
    rivals: list[str]


class Isolability(Document):
    """Effects that a motion can tell apart; the effects of one class are taken for one another."""

    subject: str
    channels: list[str]
    effects: list[IsolableEffect]
    classes: list[list[str]]


def isolability(
    machine: Machine,
    motion: str | None,
    traces: Sequence[Path],
    progress: Callable[[str], None] = lambda _line: None,
) -> Answer:
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
    shown = Isolability(
        subject=subject,
        channels=list(session.channels),
        effects=_effects(found),
        classes=_classes(found),
    )
    return Answer("\n".join(_lines(shown)), shown)


def _session(machine: Machine, motion: str | None, traces: Sequence[Path]) -> Session:
    if motion is None:
        return healthy_session(machine, read_runs(machine, traces), 1)
    if motion not in MOTIONS:
        raise DiagnosisError(f"no motion {motion!r}; there are {', '.join(MOTIONS)}")
    return rehearsed(machine, motion)


def _lines(found: Isolability) -> list[str]:
    rows = [("effect", "shows from", "a typical fault could be taken for")]
    for each in found.effects:
        tied = ", ".join(each.rivals) or "nothing else"
        shows = "never" if each.shows_from is None else each.shows_from.as_text()
        rows.append((each.effect, shows, "a healthy axis" if each.looks_healthy else tied))
    widths = [max(len(row[k]) for row in rows) for k in (0, 1)]
    table = [f"  {a:<{widths[0]}}  {b:<{widths[1]}}  {c}" for a, b, c in rows]
    head = f"{found.subject}: {', '.join(found.channels)}"
    return [head, *table, *(f"one class: {', '.join(each)}" for each in found.classes)]


def _effects(found: Sequence[Separation]) -> list[IsolableEffect]:
    return [
        IsolableEffect(
            effect=alone.effect,
            shows_from=_strength(alone) if least_strength(alone) < _NEVER else None,
            looks_healthy=alone.evidence < DECISIVE,
            rivals=[
                each.rival
                for each in found
                if each.effect == alone.effect and each.evidence < DECISIVE and each.rival
            ],
        )
        for alone in found
        if alone.rival is None
    ]


def _strength(alone: Separation) -> Strength:
    """The strength that shows, in the parameter that scales the effect."""
    effect = get_effect(alone.effect)
    amounts = [p for p in effect.parameters if p.role is Role.AMOUNT] or list(effect.parameters)
    values: Mapping[str, float] = effect.complete({})
    leading = next((p for p in amounts if values[p.name] != 0.0), amounts[0])
    amount = abs(values[leading.name]) * least_strength(alone)
    return Strength(parameter=leading.name, value=amount, unit=leading.unit)


def _classes(found: Sequence[Separation]) -> list[list[str]]:
    """Effects that show, yet are mutually taken for one another."""
    shows = {each.effect for each in found if each.rival is None and each.evidence >= DECISIVE}
    tied = {(p.effect, p.rival) for p in found if p.rival and p.evidence < DECISIVE}
    classes: list[set[str]] = []
    for a, b in sorted((a, b) for a, b in tied if b and {a, b} <= shows and (b, a) in tied):
        joined = [each for each in classes if {a, b} & each]
        classes = [each for each in classes if each not in joined] + [{a, b}.union(*joined)]
    return [sorted(each) for each in classes]
