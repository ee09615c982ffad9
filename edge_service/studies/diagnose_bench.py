"""`edge-service bench diagnose`: the diagnosis against a plant that shares no code with it.

The truth generator lives beside the tests, in `foreign_plant`; a case is a set of causes, their
strength, a motion and a seed. What is withheld is either in the library and unknown to the baseline
(it must be named), or taken out of the library too (it must be unknown). What is diagnosed is the
recording alone: the causes are written beside the answer after it is given. A second recording of
the same axis shows how far the gap really shrinks.
"""

import concurrent.futures
import importlib
import json
import multiprocessing
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..config import load_machine
from ..diagnose.diagnosis import Diagnosis, diagnose_session
from ..diagnose.recorded import runs_of
from ..diagnose.session import Session
from ..diagnose.twin import healthy_gap, healthy_session, rigid_baseline
from ..messages.samples import SampleFrame
from ..models.effects.registry import active_effect, effects
from ..models.machine import Machine

HEALTHY_RUNS = 4
"""Fewer than a diagnosis takes: only their median is used."""


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
    """What came of a case.

    Attributes:
        named: effect -> probability.
        shrink: effect -> estimate, low, high.
        realised: effect -> how far it shrinks the gap of another recording of the same axis.
        gap: channel -> before, after, of a healthy axis.
        where: channel and variable, the best first.
    """

    case: BenchCase
    verdict: str
    named: dict[str, float]
    classes: dict[str, list[str]]
    ratio: float
    unexplained: float
    shrink: dict[str, tuple[float, float, float]]
    realised: dict[str, float]
    gap: dict[str, tuple[float, float, float]]
    where: list[str]
    seconds: float


class BenchError(Exception):
    """The bench cannot be run; the text is one line."""


def foreign_plant(root: Path | None = None) -> Any:
    """The truth generator beside the tests of a checkout."""
    tests = (root or Path(__file__).parents[2]) / "tests"
    if not (tests / "foreign_plant").is_dir():
        raise BenchError(f"no foreign_plant in {tests}: the bench runs from a checkout")
    if str(tests) not in sys.path:
        sys.path.insert(0, str(tests))
    return importlib.import_module("foreign_plant")


def run_case(case: BenchCase) -> BenchRow:
    """Simulate and diagnose one case."""
    with tempfile.TemporaryDirectory() as folder:
        plant = foreign_plant()
        path = Path(folder) / "machine.toml"
        path.write_text(plant.nominal_machine_toml(plant.DIAGNOSIS), "utf-8")
        machine = load_machine(path)
    session = _session(machine, _recorded(case, case.motion, case.seed))
    start = time.process_time()
    found = _diagnosed(machine, session, case.withheld)
    seconds = time.process_time() - start
    again = _session(machine, _recorded(case, "production", case.seed + 500_000))
    return _row(case, found, _realised(found, again), seconds)


def _recorded(case: BenchCase, motion: str, seed: int) -> SampleFrame:
    """A recording of the axis of a case."""
    plant = foreign_plant()
    effects_there = tuple((name, case.strength) for name in case.causes)
    recording = plant.simulate(plant.case(effects_there, motion, seed=seed, axis_seed=case.seed))
    columns = dict(recording.columns)
    return SampleFrame(columns.pop("time_s"), columns)


def _session(machine: Machine, frame: SampleFrame) -> Session:
    baseline = rigid_baseline(machine)
    return Session.of_runs(runs_of([frame], baseline), baseline)


def _diagnosed(machine: Machine, session: Session, withheld: Sequence[str]) -> Diagnosis:
    """The answer to a recording; what is there, and how strong, is not told."""
    twins = [healthy_session(machine, session.runs, number) for number in range(HEALTHY_RUNS)]
    library = [each for each in effects().values() if each.name not in withheld]
    return diagnose_session(session, machine, healthy_gap(twins, machine), library)


def _realised(found: Diagnosis, again: Session) -> dict[str, float]:
    """Shrink of another recording's gap by each named effect alone, in its channel."""
    shrinks = {}
    for each in found.effects:
        active = [active_effect(each.name, values) for values in each.entries]
        after = Session.of_runs(again.runs, again.baseline, active).channels[each.channel].rms
        shrinks[each.name] = 1.0 - after / again.channels[each.channel].rms
    return shrinks


def _row(case: BenchCase, found: Diagnosis, realised: dict[str, float], seconds: float) -> BenchRow:
    return BenchRow(
        case=case,
        verdict=found.verdict.value,
        named={each.name: each.probability for each in found.effects},
        classes={each.name: list(each.tied) for each in found.effects},
        ratio=max(each.before / each.noise_floor for each in found.gap.values()),
        unexplained=found.unexplained,
        shrink={e.name: (e.shrink.estimate, e.shrink.low, e.shrink.high) for e in found.effects},
        realised=realised,
        gap={name: (g.before, g.after, g.noise_floor) for name, g in found.gap.items()},
        where=[f"{place.channel}:{place.variable}" for place in found.where],
        seconds=seconds,
    )


def run_cases(
    cases: Sequence[BenchCase], workers: int = 2, progress: Callable[[str], None] = lambda _l: None
) -> Iterator[BenchRow]:
    """All cases over some processes, as they are done."""
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(workers, mp_context=context) as pool:
        started = [pool.submit(run_case, case) for case in cases]
        for number, done in enumerate(concurrent.futures.as_completed(started), start=1):
            row = done.result()
            progress(f"{number} of {len(cases)}: {row.case.label}: {row.verdict} {row.named}")
            yield row


def read_rows(path: Path) -> list[BenchRow]:
    """Rows of an earlier run; none where there is no file. A line cut short ends them."""
    rows: list[BenchRow] = []
    for line in path.read_text("utf-8").splitlines() if path.exists() else ():
        try:
            known = json.loads(line)
        except ValueError:
            break
        case = known.pop("case")
        for key in ("causes", "withheld"):
            case[key] = tuple(case[key])
        known["shrink"] = {name: tuple(values) for name, values in known["shrink"].items()}
        known["gap"] = {name: tuple(values) for name, values in known["gap"].items()}
        rows.append(BenchRow(case=BenchCase(**case), **known))
    return rows


def plan_cases(count: int, seed: int = 0) -> list[BenchCase]:
    """A mixture of cases: healthy, singles, pairs, triples, oddities and leave-one-out."""
    plant = foreign_plant()
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


def run_diagnose_bench(
    count: int,
    out: Path | None = None,
    workers: int = 2,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _line: None,
) -> str:
    """Run a mixture of `count` cases and return the table.

    Rows go to `out`, a JSON line each, as they are done; cases that it holds already are not run
    again.

    Raises:
        BenchError: no truth generator is at hand.
    """
    from .diagnose_table import as_text

    planned = plan_cases(count, seed)
    known = {row.case: row for row in (read_rows(out) if out else ())}
    if out is not None and known:
        write_rows(known.values(), out, "w")
    for row in run_cases([case for case in planned if case not in known], workers, progress):
        known[row.case] = row
        if out is not None:
            write_rows([row], out, "a")
    return as_text([known[case] for case in planned])


def write_rows(rows: Iterable[BenchRow], out: Path, mode: str) -> None:
    """One JSON object per line."""
    with out.open(mode, encoding="utf-8") as file:
        for row in rows:
            file.write(json.dumps(asdict(row)) + "\n")
