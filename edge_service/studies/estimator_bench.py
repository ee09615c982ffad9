"""The bench of the fused estimator: every row measured, beside the seed's, and what was aimed at.

Truth comes from the library's plant and from a second one written differently; every axis is
commissioned on a recording of its own before it is judged.
"""

import json
import multiprocessing
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path

from .bench_figures import PipelineBench
from .estimator_foreign import (
    CHECKOUT_TESTS,
    foreign,
    foreign_errors,
    foreign_one_encoder,
    has_foreign_plant,
)
from .estimator_hostile import hostile
from .estimator_own import (
    ERRORS,
    Part,
    calibration,
    closed_loop,
    intervals,
    loads,
    long_run,
    warm_up,
)
from .estimator_rows import BenchTable, table_of
from .estimator_seed import seed_runs
from .false_alarms import count_false_alarms
from .fused_speed import speed_bench

Progress = Callable[[str], None]
PROCESSES = 2
QUICK_RUNS, FULL_RUNS = 20, 1200
"""Of 1000 steps each, for false alarms."""
_FOREIGN_ERRORS = (
    ("no", 0.0),
    *(("torque_gain", share) for share in (-0.02, 0.02)),
    *(("inertia", share) for share in (-0.05, 0.05)),
    *(("skew_s", skew_s) for skew_s in (-1e-6, 1e-6)),
    *(("series", share) for share in (-0.1, 0.1)),
)


@dataclass(frozen=True, slots=True)
class Task:
    """Cases that one process runs: a function of this package and its arguments."""

    name: str
    run: Callable[..., Iterable[Part]]
    arguments: tuple[object, ...]

    def __call__(self) -> list[Part]:
        """All its parts."""
        return list(self.run(*self.arguments))


@dataclass(frozen=True, slots=True)
class EstimatorBench:
    """How right the estimator is, and how fast."""

    table: BenchTable
    speed: PipelineBench

    def as_text(self) -> str:
        """Both tables, for a terminal."""
        return f"{self.table.as_text()}\n\n{self.speed.as_text()}"

    def as_json(self) -> str:
        """For a program; what is not a number is null."""
        both = json.loads(self.table.as_json()) | {"speed": self.speed.as_dict()["figures"]}
        return json.dumps(both, indent=2, allow_nan=False)


def tasks_of(quick: bool, tests: Path) -> list[Task]:
    """All cases, the longest first."""
    axes = (1,) if quick else (1, 2)
    tasks = [Task("40 minutes", long_run, (1, quick))]
    tasks += [Task(f"warm-up, axis {axis}", warm_up, (axis, quick)) for axis in axes]
    if has_foreign_plant(tests):
        for axis in (3,) if quick else (3, 4, 5):
            tasks.append(Task(f"foreign axis {axis}", foreign, (tests, axis, quick)))
            tasks.append(
                Task(f"foreign, one encoder {axis}", foreign_one_encoder, (tests, axis, quick))
            )
        if not quick:
            tasks += [
                Task(f"foreign {error} {share:g}", foreign_errors, (tests, error, share, quick))
                for error, share in _FOREIGN_ERRORS
            ]
    tasks += [Task("intervals", intervals, (1, quick))]
    tasks += [Task(f"closed loop, axis {axis}", closed_loop, (axis, quick)) for axis in axes]
    tasks += [Task("spoiled recordings", hostile, (quick,))]
    tasks += [Task(f"loads, axis {axis}", loads, (axis, quick)) for axis in axes]
    errors = range(0 if quick else len(ERRORS))
    tasks += [Task(ERRORS[which][0], calibration, (which, quick)) for which in errors]
    runs = 1 if quick else 2
    return tasks + [
        Task(f"seed's simulations {first}", seed_runs, (first, runs))
        for first in range(0, 1 if quick else 8, runs)
    ]


def run_estimator_bench(
    quick: bool = False,
    progress: Progress | None = None,
    tests: Path = CHECKOUT_TESTS,
    processes: int = PROCESSES,
) -> EstimatorBench:
    """Run all cases, the same numbers in every run; then the speeds of this machine.

    Args:
        quick: fewer and shorter cases, for a look.
        progress: told what is done.
        tests: where the second plant lives; its rows cannot be measured without it.
    """
    say = progress or (lambda _: None)
    tasks = tasks_of(quick, tests)
    parts: dict[int, list[Part]] = {}
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, context) as pool:
        running: dict[Future[list[Part]], int] = {
            pool.submit(task): number for number, task in enumerate(tasks)
        }
        for done in as_completed(running):
            number = running[done]
            parts[number] = done.result()
            say(f"{len(parts)} of {len(tasks)}: {tasks[number].name}")
    ordered: Sequence[Part] = [part for number in sorted(parts) for part in parts[number]]
    say("speed")
    speed = speed_bench(quick)
    say("false alarms")
    figures = count_false_alarms(QUICK_RUNS if quick else FULL_RUNS).figures()
    return EstimatorBench(table_of(ordered), replace(speed, figures=(*speed.figures, *figures)))
