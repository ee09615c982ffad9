"""`edge-service motion next` and `isolability`: what motions could tell apart, before a run."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from ..command_answer import Answer
from ..diagnose.experiment import (
    DECISIVE,
    Separation,
    least_strength,
    propose,
    rehearsed,
    separations,
)
from ..diagnose.session.twin import healthy_session
from ..models.effects.effect import Role
from ..models.effects.registry import effect_names, get_effect
from ..models.machine import Machine
from ..models.motions.registry import MOTIONS
from .diagnosis.sessions import DiagnosisError, read_runs
from .document import Document
from .motion_file import MotionFile, MotionFileSettings, write_motion

LONGEST_S = 300.0
_SHOWN = 4
_NEVER = 1e3
"""Strength, in typical ones, from which an effect counts as never shown."""
_DOUBTED = 0.9
Values = Mapping[str, float]


class ProposedMotion(Document):
    """A motion with the evidence to expect of the pair that it separates least.

    `given_s` is the duration to ask for; null where the motion has its own.
    """

    motion: str
    duration_s: float
    given_s: float | None
    log_evidence: float

    def as_text(self) -> str:
        """The command that writes it, and how sure its answer would be."""
        given = f" --duration {self.given_s:g}" if self.given_s else ""
        return (
            f"edge-service motion {self.motion}{given}, {self.duration_s:.0f} s, "
            f"expected evidence {self.log_evidence:.1f} (odds {_odds(self.log_evidence)})"
        )


class NextMotion(Document):
    """Motions to record next, the best first; only one where it decides."""

    decides: bool
    hardest_pair: list[str]
    proposals: list[ProposedMotion]
    file: MotionFile | None

    def as_text(self) -> str:
        """A line on each, and what was written."""
        best, *others = self.proposals
        undecided = (
            f"none of {LONGEST_S:g} s or less decides between {' and '.join(self.hardest_pair)}"
        )
        head = "the shortest that decides" if self.decides else f"{undecided}; best"
        lines = [f"{head}: {best.as_text()}", *(f"  or {each.as_text()}" for each in others)]
        return "\n".join(lines if self.file is None else [*lines, self.file.as_text()])


def tied_effects(diagnosis: Path) -> dict[str, Values]:
    """Effects between which a diagnosis could not decide, with the values that it found.

    Raises:
        DiagnosisError: the file is no diagnosis, or it leaves no doubt.
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
    machine: Machine,
    tied: Mapping[str, Values],
    out: Path | None,
    settings: MotionFileSettings,
    progress: Callable[[str], None] = lambda _line: None,
) -> Answer:
    """Propose the shortest motion that decides, write it to `out` if given, and say why.

    Raises:
        DiagnosisError: an unknown effect or value, or fewer than two effects.
        MotionError: the axis allows no motion at all.
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
    shown = proposals[: 1 if best.decides else _SHOWN]
    written = None
    if out is not None:
        chosen = replace(settings, duration_s=settings.duration_s or best.candidate.given_s)
        written = write_motion(best.candidate.motion, machine, out, chosen, progress)
    worst = min(best.separations, key=lambda each: each.evidence)
    found = NextMotion(
        decides=best.decides,
        hardest_pair=[worst.effect, worst.rival or "a healthy axis"],
        proposals=[
            ProposedMotion(
                motion=each.candidate.motion,
                duration_s=each.candidate.duration_s,
                given_s=each.candidate.given_s,
                log_evidence=each.evidence,
            )
            for each in shown
        ],
        file=written,
    )
    return Answer(found.as_text(), found)


def _odds(evidence: float) -> str:
    return "over 1000 to 1" if evidence > math.log(1000.0) else f"{math.exp(evidence):.0f} to 1"


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
    subject: str,
    progress: Callable[[str], None] = lambda _line: None,
) -> Answer:
    """A table: each effect, the strength from which it shows, and what it may be taken for.

    The motion is a named one, or that of a recording; what was measured there is not looked at.

    Raises:
        DiagnosisError: no such motion.
        MotionError: the axis does not allow the motion. TraceError: a recording cannot be read.
    """
    if subject in MOTIONS:
        session = rehearsed(machine, subject)
    elif Path(subject).exists():
        session = healthy_session(machine, read_runs(machine, (Path(subject),)), 1)
        subject = Path(subject).name
    else:
        raise DiagnosisError(f"no motion or recording {subject!r}; there are {', '.join(MOTIONS)}")
    progress("what each effect would leave to each other one")
    found = separations(session, machine, effect_names())
    shown = Isolability(
        subject=subject,
        channels=list(session.channels),
        effects=_effects(found),
        classes=_classes(found),
    )
    return Answer("\n".join(_lines(shown)), shown)


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
