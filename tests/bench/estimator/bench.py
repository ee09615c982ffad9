"""The bench of the estimator: every part measured beside its aims.

Truth comes from the library's plant and from others written differently; every axis is
commissioned on a recording of its own before it is judged.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from ..life.bench import QUICK_SHAPES, life_table, live
from ..life.cases import SHAPES
from ..table import Progress, Table, in_processes
from .dates import LAWS, ask_healthy, ask_of_a_law, dates_table
from .healthy.false_conditions import healthy_table, shifts
from .healthy.production_cases import PLANTS, SHIFT_S
from .losses import losses_table, lost
from .lying import lied
from .notch import notch_table, tested
from .parts import FIRST_SEED, TABLE
from .plants.foreign import foreign, foreign_one_encoder
from .plants.own import closed_loop, warm_up
from .plants.thesis import thesis_runs
from .rows import table_of

PROCESSES = 2
LIE_S = 120.0
_TABLES: Mapping[str, Callable[[Any], Table]] = {
    "table": table_of,
    "life": life_table,
    "healthy": healthy_table,
    "losses": losses_table,
    "lying": losses_table,
    "notch": notch_table,
    "dates": dates_table,
}


@dataclass(frozen=True, slots=True)
class Task:
    part: str
    name: str
    run: Callable[[], Iterable[object]]

    def __call__(self) -> list[object]:
        return list(self.run())


def tasks_of(quick: bool, axes: range) -> Iterator[Task]:
    """All cases, the longest of the table first.

    Args:
        quick: fewer and shorter cases, for a look.
        axes: seeds of the axes; those of the table are counted from the first.
    """
    few, more = (range(axes.start, axes.start + n) for n in ((1, 1) if quick else (2, 3)))
    for axis in few:
        yield Task("own", f"warm-up, axis {axis}", partial(warm_up, axis, quick))
    for axis in more:
        yield Task("foreign", f"foreign axis {axis}", partial(foreign, axis, quick))
        blind = partial(foreign_one_encoder, axis, quick)
        yield Task("foreign", f"foreign, one encoder {axis}", blind)
    for axis in few:
        yield Task("own", f"closed loop, axis {axis}", partial(closed_loop, axis, quick))
    runs = 1 if quick else 2
    for first in range(0, 1 if quick else 8, runs):
        yield Task("thesis", f"thesis' simulations {first}", partial(thesis_runs, first, runs))
    yield from _dates(quick, axes)
    shift_s = 60.0 if quick else SHIFT_S
    for axis in axes:
        yield Task("notch", f"tested by shaking {axis}", partial(tested, axis, quick))
        for plant in ("foreign", "own"):
            for shape in QUICK_SHAPES if quick else SHAPES:
                name = f"life {plant} {axis}: {shape}"
                yield Task("life", name, partial(live, plant, shape, axis, quick))
        for plant in PLANTS:
            yield Task("healthy", f"healthy {plant} {axis}", partial(shifts, plant, axis, shift_s))
            yield Task("losses", f"losses {plant} {axis}", partial(lost, plant, axis, shift_s))
        for plant in ("foreign", "own"):
            told = partial(lied, plant, axis, 10.0 if quick else LIE_S)
            yield Task("lying", f"lying channels {plant} {axis}", told)


def _dates(quick: bool, axes: range) -> Iterator[Task]:
    lives = [1000 * axis + each for axis in axes for each in range(3 if quick else 20)]
    for readings in (False, True):
        for law in LAWS:
            asked = partial(ask_of_a_law, law, lives, readings=readings)
            yield Task("dates", f"dates, {law}", asked)
    yield Task("dates", "dates, healthy", partial(ask_healthy, lives))


def run_estimator_bench(
    parts: Collection[str], quick: bool, say: Progress, seed: int = FIRST_SEED, seeds: int = 1
) -> list[Table]:
    """Run some of `PARTS`, the same numbers in every run. Raises BenchError."""
    tasks = [task for task in tasks_of(quick, range(seed, seed + seeds)) if task.part in parts]
    done: dict[int, list[Any]] = {}
    for number, result in in_processes(tasks, PROCESSES):
        done[number] = result
        say(f"{len(done)} of {len(tasks)}: {tasks[number].name}")
    found: dict[str, list[Any]] = {}
    for number, task in enumerate(tasks):
        found.setdefault("table" if task.part in TABLE else task.part, []).extend(done[number])
    return [_TABLES[name](found[name]) for name in _TABLES if name in found]
