"""`edge-service bench diagnose`: the diagnosis against a plant that shares no code with it.

The truth generator lives beside the tests, in `foreign_plant`; a case is a set of causes, their
strength, a motion and a seed. What is withheld is either in the library and unknown to the baseline
(it must be named), or taken out of the library too (it must be unknown).
"""

import concurrent.futures
import importlib
import json
import multiprocessing
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..config import load_machine
from ..diagnose.diagnosis import diagnose_session
from ..diagnose.recorded import runs_of
from ..diagnose.session import Session
from ..diagnose.twin import healthy_gap, healthy_session, rigid_baseline
from ..messages.samples import SampleFrame
from ..models.effects.registry import effects
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
    """What came of a case."""

    case: BenchCase
    verdict: str
    named: dict[str, float]
    classes: dict[str, list[str]]
    ratio: float
    unexplained: float
    shrink: dict[str, float]
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
    plant = foreign_plant()
    recording = plant.simulate(
        plant.case(
            tuple((name, case.strength) for name in case.causes), case.motion, seed=case.seed
        )
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "machine.toml"
        path.write_text(plant.nominal_machine_toml(plant.DIAGNOSIS), "utf-8")
        machine = load_machine(path)
    columns = dict(recording.columns)
    frame = SampleFrame(columns.pop("time_s"), columns)
    start = time.process_time()
    row = _diagnosed(case, machine, frame)
    return BenchRow(**{**row, "seconds": time.process_time() - start})


def _diagnosed(case: BenchCase, machine: Machine, frame: SampleFrame) -> dict[str, Any]:
    baseline = rigid_baseline(machine)
    runs = list(runs_of([frame], baseline))
    session = Session.of_runs(runs, baseline)
    healthy = healthy_gap(
        [healthy_session(machine, runs, number) for number in range(HEALTHY_RUNS)], machine
    )
    library = [each for each in effects().values() if each.name not in case.withheld]
    found = diagnose_session(session, machine, healthy, library)
    return {
        "case": case,
        "verdict": found.verdict.value,
        "named": {each.name: each.probability for each in found.effects},
        "classes": {each.name: list(each.tied) for each in found.effects},
        "ratio": max(each.before / each.noise_floor for each in found.gap.values()),
        "unexplained": found.unexplained,
        "shrink": {each.name: each.shrink.estimate for each in found.effects},
        "gap": {n: (g.before, g.after, g.noise_floor) for n, g in found.gap.items()},
        "where": [f"{place.channel}:{place.variable}" for place in found.where[:3]],
    }


def run_cases(
    cases: Sequence[BenchCase], workers: int = 2, progress: Callable[[str], None] = lambda _l: None
) -> list[BenchRow]:
    """All cases over some processes, in their order."""
    rows = []
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(workers, mp_context=context) as pool:
        for number, row in enumerate(pool.map(run_case, cases), start=1):
            progress(f"{number} of {len(cases)}: {row.case.label}: {row.verdict} {row.named}")
            rows.append(row)
    return rows


def write_rows(rows: Iterable[BenchRow], out: Path) -> None:
    """One JSON object per line."""
    with out.open("w", encoding="utf-8") as file:
        for row in rows:
            file.write(json.dumps(asdict(row)) + "\n")


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
    """Run a mixture of `count` cases and return the table; rows go to `out`, a JSON line each.

    Raises:
        BenchError: no truth generator is at hand.
    """
    from .diagnose_table import as_text

    rows = run_cases(plan_cases(count, seed), workers, progress)
    if out is not None:
        write_rows(rows, out)
    return as_text(rows)
