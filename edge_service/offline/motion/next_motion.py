"""`edge-service motion next`: the motion that tells tied explanations apart, and how well."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from ...diagnose.experiment.proposal import Proposal, propose
from ...models.effects.registry import get_effect
from ...models.machine import Machine
from ..diagnosis.sessions import DiagnosisError
from .motion_file import MotionFileSettings, write_motion

LONGEST_S = 300.0
_SHOWN = 4
_DOUBTED = 0.9
Values = Mapping[str, float]


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
) -> str:
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
    lines = [_described(best)]
    if not best.decides:
        lines += [f"  or {_shown(each)}" for each in proposals[1:_SHOWN]]
    if out is not None:
        chosen = replace(settings, duration_s=settings.duration_s or best.candidate.given_s)
        lines.append(write_motion(best.candidate.motion, machine, out, chosen, progress))
    return "\n".join(lines)


def _described(best: Proposal) -> str:
    worst = min(best.separations, key=lambda each: each.evidence)
    if best.decides:
        return f"the shortest that decides: {_shown(best)}"
    return (
        f"none of {LONGEST_S:g} s or less decides between {worst.effect} and {worst.rival}; best: "
        f"{_shown(best)}"
    )


def _shown(each: Proposal) -> str:
    given = f" --duration {each.candidate.given_s:g}" if each.candidate.given_s else ""
    return (
        f"edge-service motion {each.candidate.motion}{given}, {each.candidate.duration_s:.0f} s, "
        f"expected evidence {each.evidence:.1f} (odds {_odds(each.evidence)})"
    )


def _odds(evidence: float) -> str:
    return "over 1000 to 1" if evidence > math.log(1000.0) else f"{math.exp(evidence):.0f} to 1"


def typical(effects: Sequence[str]) -> dict[str, Values]:
    """Tied effects of which only the names are known."""
    return {name: {} for name in effects}
