"""Parts of the estimator's bench and their cases, cut into tasks of one process each."""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from ..life.bench import live, shapes
from .healthy.false_conditions import MINUTES, QUICK_MINUTES, shifts
from .healthy.production_cases import SHIFT_S
from .parts import FIRST_SEED, PARTS, PROCESSES
from .plants.foreign import foreign, foreign_errors, foreign_one_encoder
from .plants.own import ERRORS, calibration, closed_loop, intervals, loads, long_run, warm_up
from .plants.second_plant import BESIDE
from .plants.spoiled import hostile
from .plants.thesis import thesis_runs
from .wear.wear_rates import rate_session

SHIFTS_AT_ONCE = 3
PLANTS = ("foreign", "own")
_FOREIGN_ERRORS = (
    ("no", 0.0),
    *(("torque_gain", share) for share in (-0.02, 0.02)),
    *(("inertia", share) for share in (-0.05, 0.05)),
    *(("skew_s", skew_s) for skew_s in (-1e-6, 1e-6)),
    *(("series", share) for share in (-0.1, 0.1)),
)


@dataclass(frozen=True, slots=True)
class BenchSettings:
    """Settings of the estimator's bench: what is measured.

    Attributes:
        quick: fewer and shorter cases, for a look.
        parts: of `PARTS`.
        seed, seeds: first axis of lives, rates and shifts, also first seed of the second plant;
            how many of them (of shifts as many as fill the minutes).
        healthy_minutes: of production; None: as `quick` asks for.
        second_plant: folder of its commands.
    """

    quick: bool = False
    parts: tuple[str, ...] = PARTS
    seed: int = FIRST_SEED
    seeds: int = 1
    healthy_minutes: float | None = None
    second_plant: Path = BESIDE
    processes: int = PROCESSES


@dataclass(frozen=True, slots=True)
class Task:
    """Cases that one process runs: a function of this package and its arguments."""

    part: str
    name: str
    run: Callable[..., Iterable[object]]
    arguments: tuple[object, ...]

    def __call__(self) -> list[object]:
        """All its results."""
        return list(self.run(*self.arguments))


def tasks_of(settings: BenchSettings) -> list[Task]:
    """All cases of the parts that are asked for, the longest of the table first."""
    every = (*_table_tasks(settings), *_life_tasks(settings))
    every = (*every, *_rate_tasks(settings), *_healthy_tasks(settings))
    return [task for task in every if task.part in settings.parts]


def _table_tasks(settings: BenchSettings) -> Iterator[Task]:
    quick, axes = settings.quick, (1,) if settings.quick else (1, 2)
    yield Task("own", "40 minutes", long_run, (1, quick))
    for axis in axes:
        yield Task("own", f"warm-up, axis {axis}", warm_up, (axis, quick))
    yield from _foreign_tasks(quick)
    yield Task("own", "intervals", intervals, (1, quick))
    for axis in axes:
        yield Task("own", f"closed loop, axis {axis}", closed_loop, (axis, quick))
    yield Task("spoiled", "spoiled recordings", hostile, (quick,))
    for axis in axes:
        yield Task("own", f"loads, axis {axis}", loads, (axis, quick))
    for which in range(0 if quick else len(ERRORS)):
        yield Task("own", ERRORS[which][0], calibration, (which, quick))
    runs = 1 if quick else 2
    for first in range(0, 1 if quick else 8, runs):
        yield Task("thesis", f"thesis' simulations {first}", thesis_runs, (first, runs))


def _foreign_tasks(quick: bool) -> Iterator[Task]:
    for axis in (3,) if quick else (3, 4, 5):
        arguments = (axis, quick)
        yield Task("foreign", f"foreign axis {axis}", foreign, arguments)
        yield Task("foreign", f"foreign, one encoder {axis}", foreign_one_encoder, arguments)
    for error, share in () if quick else _FOREIGN_ERRORS:
        name = f"foreign {error} {share:g}"
        yield Task("foreign", name, foreign_errors, (error, share, quick))


def _axes(settings: BenchSettings) -> range:
    return range(settings.seed, settings.seed + settings.seeds)


def _life_tasks(settings: BenchSettings) -> Iterator[Task]:
    for plant in PLANTS:
        for shape in shapes(settings.quick):
            for axis in _axes(settings):
                arguments = (plant, shape, axis, settings.quick)
                yield Task("life", f"life {plant} {axis}: {shape}", live, arguments)


def _rate_tasks(settings: BenchSettings) -> Iterator[Task]:
    for warming in (False, True):
        for axis in _axes(settings):
            name = f"wear axis {axis}, {'warming up' if warming else 'cold'}"
            yield Task("rates", name, rate_session, (axis, warming, settings.quick))


def _healthy_tasks(settings: BenchSettings) -> Iterator[Task]:
    minutes = settings.healthy_minutes or (QUICK_MINUTES if settings.quick else MINUTES)
    plants = PLANTS
    each_s = 60.0 * minutes / len(plants)
    count = max(math.ceil(each_s / SHIFT_S), 1)
    for plant in plants:
        for first in range(0, count, SHIFTS_AT_ONCE):
            at_once = min(SHIFTS_AT_ONCE, count - first)
            seed = settings.seed + first
            arguments = (plant, seed, at_once, each_s / count)
            yield Task("healthy", f"healthy {plant} axes from {seed}", shifts, arguments)
