"""Proposal of the shortest motion that separates tied effects, by rehearsal on the twin."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from ...models.machine import Machine
from ...models.motions.registry import MOTIONS, MotionError, motion_limits
from .isolability import DECISIVE, LONGEST_S, Separation, rehearsed, separations

ENDLESS_S = (10.0, 20.0, 40.0, 60.0, 150.0, 300.0)
"""Durations at which motions without end are tried."""


@dataclass(frozen=True, slots=True)
class CandidateMotion:
    """Motion that the axis allows.

    Attributes:
        given_s: duration to ask for; None where the motion has its own.
    """

    motion: str
    duration_s: float
    given_s: float | None


@dataclass(frozen=True, slots=True)
class Proposal:
    """Motion and how well it separates what is tied.

    Attributes:
        evidence: of the pair that it separates least.
    """

    candidate: CandidateMotion
    evidence: float
    separations: tuple[Separation, ...]

    @property
    def decides(self) -> bool:
        """True if every pair is told apart."""
        return self.evidence >= DECISIVE


def candidates(machine: Machine, longest_s: float = LONGEST_S) -> list[CandidateMotion]:
    """Motions within the axis' limits, the shortest first."""
    limits = motion_limits(machine)
    found = []
    for name, motion in MOTIONS.items():
        try:
            own_s = motion.duration_s(limits)
        except MotionError:
            continue
        if own_s is None:
            found += [CandidateMotion(name, each, each) for each in ENDLESS_S if each <= longest_s]
        elif own_s <= longest_s:
            found.append(CandidateMotion(name, own_s, None))
    return sorted(found, key=lambda each: each.duration_s)


def propose(
    machine: Machine,
    tied: Collection[str],
    values: Mapping[str, Mapping[str, float]] | None = None,
    longest_s: float = LONGEST_S,
    progress: Callable[[str], None] = lambda _line: None,
) -> list[Proposal]:
    """Motions that were rehearsed, the best first: the shortest that decides leads.

    Rehearsal ends with the first motion that decides; without any the order is by evidence.

    Args:
        tied: names of effects.
        values: of the effects, as far as known; a typical fault's otherwise.

    Raises:
        MotionError: the machine file allows no motion at all.
    """
    names = sorted(set(tied))
    found: list[Proposal] = []
    for candidate in candidates(machine, longest_s):
        progress(f"rehearsing {candidate.motion}, {candidate.duration_s:.0f} s")
        try:
            session = rehearsed(machine, candidate.motion, candidate.duration_s)
        except MotionError:
            continue
        pairs = [p for p in separations(session, machine, names, values) if p.rival is not None]
        least = min((pair.evidence for pair in pairs), default=0.0)
        found.append(Proposal(candidate, least, tuple(pairs)))
        if found[-1].decides:
            break
    return sorted(found, key=_rank)


def _rank(proposal: Proposal) -> tuple[bool, float, float]:
    """Rank, the best first: by the pair that is told apart least, then by all of them."""
    return (
        not proposal.decides,
        -round(proposal.evidence),
        -sum(pair.evidence for pair in proposal.separations),
    )
