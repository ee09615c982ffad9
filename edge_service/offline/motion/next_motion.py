"""`edge-service motion next`: the motion that tells tied explanations apart, and how well."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from ...command_answer import Answer
from ...diagnose.experiment import Proposal, propose
from ...models.effects.registry import get_effect
from ...models.machine import Machine
from ..diagnosis.sessions import DiagnosisError
from ..document import Document
from .motion_file import MotionFile, MotionFileSettings, write_motion

LONGEST_S = 300.0
_SHOWN = 4
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
                tied[each["name"]] = _values(each)
    except OSError as error:
        raise DiagnosisError(f"{diagnosis}: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise DiagnosisError(f"{diagnosis}: no diagnosis.json of edge-service diagnose") from error
    if len(tied) < 2:
        raise DiagnosisError(f"{diagnosis}: names no effects that are tied; give them by --effect")
    return dict(sorted(tied.items()))


def _values(effect: Mapping[str, object]) -> Values:
    """Values of the first entry of a named effect, as far as they are numbers."""
    entries = effect.get("entries")
    first = entries[0] if isinstance(entries, list) and entries else {}
    return {name: float(value) for name, value in first.items()}


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
        proposals=[_proposed(each) for each in shown],
        file=written,
    )
    return Answer(found.as_text(), found)


def _proposed(each: Proposal) -> ProposedMotion:
    return ProposedMotion(
        motion=each.candidate.motion,
        duration_s=each.candidate.duration_s,
        given_s=each.candidate.given_s,
        log_evidence=each.evidence,
    )


def _odds(evidence: float) -> str:
    return "over 1000 to 1" if evidence > math.log(1000.0) else f"{math.exp(evidence):.0f} to 1"


def typical(effects: Sequence[str]) -> dict[str, Values]:
    """Tied effects of which only the names are known."""
    return {name: {} for name in effects}
