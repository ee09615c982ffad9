"""Test whether the motion that a tied diagnosis proposes settles the tie, on the foreign plant."""

import json
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from edge_service.diagnose.experiment.proposal import CandidateMotion, propose
from edge_service.diagnose.pipeline import Diagnosis
from edge_service.messages.samples import Floats
from edge_service.models.machine import Machine
from edge_service.models.motions.registry import MOTIONS, Setpoints, motion_limits

from ... import foreign_plant
from .cases import BenchCase, baseline_machine, diagnosed, recorded, session_of_frames

LONGEST_S = 60.0
POOR_MOTIONS = ("one_speed", "one_place")
"""Motions that leave most in doubt: no other speed, or no other place and no speed to speak of."""
PAUSE_S = 30.0


@dataclass(frozen=True, slots=True)
class TieRow:
    """Outcome of a case.

    Attributes:
        tied: effects that the first recording cannot tell apart; empty without a tie.
        motion, duration_s: that was proposed; empty without a tie.
        after: effect -> its class, with the proposed motion beside the first recording.
        resolved: whether the cause then stands alone, and none of its former rivals is named.
    """

    case: BenchCase
    tied: list[str]
    motion: str
    duration_s: float
    after: dict[str, list[str]]
    resolved: bool


def run_tie(case: BenchCase) -> TieRow:
    """Diagnose a poor recording; if it is tied, ask for a motion, run it and diagnose both."""
    machine = baseline_machine()
    frame = recorded(case, case.motion, case.seed)
    found = diagnosed(machine, session_of_frames(machine, [frame]))
    tied = sorted({name for each in found.effects if len(each.tied) > 1 for name in each.tied})
    if not tied:
        return TieRow(case, [], "", 0.0, {}, resolved=False)
    values = {each.name: each.entries[0] for each in found.effects if each.entries}
    candidate = propose(machine, tied, values, LONGEST_S)[0].candidate
    elapsed_s = float(np.ptp(frame.time_s)) + PAUSE_S
    second = recorded(case, positions_m(machine, candidate), case.seed + 700_000, elapsed_s)
    both = diagnosed(machine, session_of_frames(machine, [frame, second]))
    return TieRow(
        case,
        tied,
        candidate.motion,
        candidate.duration_s,
        {each.name: list(each.tied) for each in both.effects},
        is_resolved(case, tied, both),
    )


def is_resolved(case: BenchCase, tied: Iterable[str], both: Diagnosis) -> bool:
    """Tell whether the causes are named, each alone in its class, and no other that was tied."""
    classes = {each.name: each.tied for each in both.effects if each.probability > 0.5}
    alone = all(classes.get(cause) == (cause,) for cause in case.causes)
    return alone and not (set(tied) - set(case.causes)) & classes.keys()


def positions_m(machine: Machine, candidate: CandidateMotion) -> Floats:
    """Setpoints of a proposed motion, every millisecond, (n,)."""
    limits = motion_limits(machine)
    segments = iter(MOTIONS[candidate.motion](limits, np.random.default_rng(1)))
    source = Setpoints(segments, limits.low_m, 1000.0)
    rows: Floats = source.take(round(1000.0 * candidate.duration_s))[:, 0]
    return rows


def plan_ties(count: int, seed: int = 0) -> list[BenchCase]:
    """Single causes on poor motions."""
    causes = sorted(set(foreign_plant.FAULTS) - {"external_force"})
    return [
        BenchCase(
            (causes[k // len(POOR_MOTIONS) % len(causes)],),
            1.0,
            POOR_MOTIONS[k % len(POOR_MOTIONS)],
            seed * 10_000 + 5_000 + k,
        )
        for k in range(count)
    ]


def run_ties(
    count: int,
    out: Path | None = None,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _line: None,
) -> str:
    """Run some cases and say how many ties one motion resolved; a JSON line each goes to `out`."""
    rows = []
    for number, case in enumerate(plan_ties(count, seed), start=1):
        rows.append(run_tie(case))
        progress(f"{number} of {count}: {case.label}: {rows[-1].tied} {rows[-1].motion}")
        if out is not None:
            with out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(rows[-1])) + "\n")
    return ties_as_text(rows)


def ties_as_text(rows: list[TieRow]) -> str:
    """The figure, and each tie on a line."""
    ties = [row for row in rows if row.tied]
    resolved = sum(row.resolved for row in ties)
    lines = [
        f"ties resolved by one proposed motion of {LONGEST_S:g} s or less: {resolved} of "
        f"{len(ties)} (aim 95 %); {len(rows) - len(ties)} of {len(rows)} cases had no tie"
    ]
    for row in ties:
        outcome = "resolved" if row.resolved else f"not resolved: {row.after}"
        motion = f"{row.motion}, {row.duration_s:.0f} s"
        lines.append(f"  {row.case.label}: {' = '.join(row.tied)}; {motion}; {outcome}")
    return "\n".join(lines)
