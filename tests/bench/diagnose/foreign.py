"""The diagnosis against a plant that shares no code with it.

The truth generator lives beside the tests, in `foreign_plant`; a case is a set of causes, their
strength, a motion and a seed. What is withheld is either in the library and unknown to the baseline
(it must be named), or taken out of the library too (it must be unknown). What is diagnosed is the
recording alone: the causes are written beside the answer after it is given. A second recording of
the same axis shows how far the gap really shrinks.
"""

import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from edge_service.config import load_machine
from edge_service.diagnose.pipeline import diagnose_session
from edge_service.diagnose.result import Diagnosis
from edge_service.diagnose.session.recordings import runs_of
from edge_service.diagnose.session.session import Session, rigid_baseline
from edge_service.messages.samples import SampleFrame
from edge_service.models.effects.registry import active_effect, effects
from edge_service.models.machine import Machine

from ... import foreign_plant as plant
from ..table import Progress, in_processes
from .overlap import overlap

LARGE = 10.0
"""Gap over that of a healthy axis from which on intervals are held against the truth."""
INTERVALS: dict[str, frozenset[str]] = {
    "position_friction": frozenset({"table_position_m"}),
    "external_force": frozenset({"time_s"}),
    "stribeck": frozenset({"motor_speed_rad_s"}),
    "viscous_error": frozenset({"motor_speed_rad_s"}),
    "quadratic_friction": frozenset({"motor_speed_rad_s"}),
    "timestamp_skew": frozenset({"motor_speed_rad_s"}),
    "warmup": frozenset({"time_s", "temperature_c"}),
    "thermal_growth": frozenset({"time_s", "temperature_c", "table_position_m"}),
    "inertia_error": frozenset({"motor_acceleration_rad_s2"}),
}
"""Causes whose gap is a function of something that has intervals, and of what."""


@dataclass(frozen=True, slots=True)
class BenchCase:
    """One sealed recording to diagnose."""

    causes: tuple[str, ...]
    strength: float
    motion: str
    seed: int
    withheld: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """Short name of the case."""
        return f"{'+'.join(self.causes) or 'healthy'} x{self.strength:g} {self.motion} {self.seed}"


@dataclass(frozen=True, slots=True)
class BenchRow:
    """Outcome of a case."""

    case: BenchCase
    verdict: str
    named: dict[str, float]  # effect -> probability
    classes: dict[str, list[str]]
    ratio: float
    unexplained: float
    shrink: dict[str, tuple[float, float, float]]  # effect -> estimate, low, high
    # effect -> how far it shrinks the gap of another recording of the same axis
    realised: dict[str, float]
    gap: dict[str, tuple[float, float, float]]  # channel -> before, after, of a healthy axis
    where: list[str]  # channel and variable, the best first
    seconds: float
    # overlap of named and true intervals; None where there is nothing to compare
    covered: float | None = None
    # channel -> gap of that other recording before, and with all named effects
    again: dict[str, tuple[float, float]] = field(default_factory=dict)


def baseline_machine() -> Machine:
    """Content of the machine file of the foreign axis."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "machine.toml"
        path.write_text(plant.nominal_machine_toml(plant.DIAGNOSIS), "utf-8")
        return load_machine(path)


def recorded(case: BenchCase, motion: str, seed: int) -> SampleFrame:
    """A recording of the axis of a case; a motion by its name, or positions at 1 kHz."""
    effects_there = tuple((name, case.strength) for name in case.causes)
    recording = plant.simulate(plant.case(effects_there, motion, seed=seed, axis_seed=case.seed))
    columns = dict(recording.columns)
    return SampleFrame(columns.pop("time_s"), columns)


def session_of_frames(machine: Machine, frames: Sequence[SampleFrame]) -> Session:
    """The session of some recordings of one axis."""
    baseline = rigid_baseline(machine)
    return Session.of_runs(runs_of(frames, baseline), baseline)


def diagnosed(machine: Machine, session: Session, withheld: Sequence[str] = ()) -> Diagnosis:
    """The answer to a session; without a word on what is there, or how strong."""
    library = [each for each in effects().values() if each.name not in withheld]
    return diagnose_session(session, machine, library)


def run_case(case: BenchCase) -> BenchRow:
    """Simulate and diagnose one case."""
    machine = baseline_machine()
    session = session_of_frames(machine, [recorded(case, case.motion, case.seed)])
    start = time.process_time()
    found = diagnosed(machine, session, case.withheld)
    seconds = time.process_time() - start
    again = session_of_frames(machine, [recorded(case, "production", case.seed + 500_000)])
    row = _row(case, found, again, seconds)
    covered = _covered(row, found, machine, session)
    return row if covered is None else replace(row, covered=covered)


def _covered(row: BenchRow, found: Diagnosis, machine: Machine, session: Session) -> float | None:
    """Overlap of named and true intervals, where there is one cause with a large gap."""
    case = row.case
    right = INTERVALS.get(case.causes[0], frozenset()) if len(case.causes) == 1 else frozenset()
    if not right or row.ratio < LARGE:
        return None
    healthy = replace(case, causes=())
    without = session_of_frames(machine, [recorded(healthy, case.motion, case.seed)])
    return overlap(found.where, session, without, right)


def _realised(found: Diagnosis, again: Session) -> dict[str, float]:
    """Shrink of another recording's gap by each named effect beside the others, in its channel."""
    shrinks = {}
    for each in found.effects:
        others = [
            active_effect(other.name, values)
            for other in found.effects
            if other is not each
            for values in other.entries
        ]
        mine = [active_effect(each.name, values) for values in each.entries]
        before, after = (
            Session.of_runs(again.runs, again.baseline, active).channels[each.channel].rms
            for active in (others, [*others, *mine])
        )
        shrinks[each.name] = 1.0 - after / before
    return shrinks


def _with_all(found: Diagnosis, again: Session) -> dict[str, tuple[float, float]]:
    """Another recording's gap in each channel that an effect is named in, before and after."""
    active = [active_effect(each.name, values) for each in found.effects for values in each.entries]
    after = Session.of_runs(again.runs, again.baseline, active)
    claimed = sorted({each.channel for each in found.effects})
    return {name: (again.channels[name].rms, after.channels[name].rms) for name in claimed}


def _row(case: BenchCase, found: Diagnosis, again: Session, seconds: float) -> BenchRow:
    return BenchRow(
        case=case,
        verdict=found.verdict.value,
        named={each.name: each.probability for each in found.effects},
        classes={each.name: list(each.tied) for each in found.effects},
        ratio=max(each.before / each.floor for each in found.gap.values()),
        unexplained=found.unexplained.share or 0.0,
        shrink={e.name: (e.shrink.estimate, e.shrink.low, e.shrink.high) for e in found.effects},
        realised=_realised(found, again),
        gap={name: (g.before, g.after, g.floor) for name, g in found.gap.items()},
        where=[f"{place.channel}:{place.variable}" for place in found.where],
        seconds=seconds,
        again=_with_all(found, again),
    )


def run_cases(
    cases: Sequence[BenchCase], progress: Progress = lambda _line: None
) -> Iterator[BenchRow]:
    """All cases over some processes, as they are done."""
    jobs = [partial(run_case, case) for case in cases]
    for count, (_, row) in enumerate(in_processes(jobs), start=1):
        progress(f"{count} of {len(cases)}: {row.case.label}: {row.verdict} {row.named}")
        yield row


def plan_cases(count: int, seed: int = 0) -> list[BenchCase]:
    """A mixture of cases: healthy, singles, pairs, triples, oddities and leave-one-out."""
    known, odd = sorted(plant.FAULTS), sorted(plant.ODDITIES)
    random = np.random.default_rng(seed)
    cases: list[BenchCase] = []
    while len(cases) < count:
        k = len(cases)
        motion = ("full", "production", "staircase")[k % 3]
        kind = ("healthy", "single", "single", "single", "pair", "odd", "out", "triple")[k % 8]
        strength = float(random.choice([0.5, 1.0, 2.0]))
        number = seed * 10_000 + k
        name = known[(k // 2) % len(known)]
        if kind == "healthy":
            cases.append(BenchCase((), 1.0, motion, number))
        elif kind == "odd":
            cases.append(BenchCase((str(random.choice(odd)),), strength, motion, number))
        elif kind == "out":
            cases.append(BenchCase((name,), max(strength, 1.0), motion, number, (name,)))
        else:
            size = {"single": 1, "pair": 2, "triple": 3}[kind]
            others = [each for each in random.permutation(known) if each != name][: size - 1]
            cases.append(BenchCase((name, *map(str, others)), strength, motion, number))
    return cases
