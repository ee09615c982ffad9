"""Axis-hours of healthy axes through estimator and health monitor, and every alarm on the way.

`python -m tests.bench.estimator.healthy.axis_hours --hours 20 --seed 7000`

Skipped by calling both in the process: drivers, bus, clocks and the disk. Each shift begins anew,
as a service does that knows nothing, where false alarms are most likely.
"""

import argparse
import math
import sys
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.messages.features import Fault, FeatureBlock
from edge_service.models.machine import Machine

from ..axis import OwnAxis
from ..plants.foreign import commissioned_machine
from ..scores import Recorded, follow
from .false_conditions import FALSE, WatchCount, Watched, upper_bound
from .production_cases import HEALTHY, Course, draw_shift, produced

SHIFT_S = 600.0
PER_AXIS_HOURS = 1000.0
PLANTS = ("own", "foreign", "own, one encoder", "foreign, one encoder")


@dataclass(frozen=True, slots=True)
class Shift:
    """Alarms and conditions told in one shift of a healthy axis."""

    plant: str
    axis_seed: int
    hours: float
    said: Counter[str]


def said_of(count: WatchCount) -> Counter[str]:
    """Alarms raised, and the conditions that no healthy axis has."""
    said = Counter(dict(count.alarms))
    said.update({each.value: count.conditions.get(each.value, 0) for each in FALSE})
    return +said


def watched(plant: str, axis_seed: int) -> Shift:
    """One shift through estimator and monitor."""
    machine, recorded = worked(plant, axis_seed)
    axis = Watched(MixturePreloadEstimator(machine), machine)
    follow(axis, recorded)
    return Shift(plant, axis_seed, SHIFT_S / 3600.0, said_of(axis.count()))


def worked(
    plant: str, axis_seed: int, course: Course = HEALTHY, shift_s: float = SHIFT_S
) -> tuple[Machine, Recorded]:
    """Machine file and recording of a shift; without the linear encoder where the plant says so."""
    name, _, lacking = plant.partition(", ")
    machine, recorded = produced(draw_shift(name, axis_seed, shift_s), course)
    return (_one_encoder(name, axis_seed), blind(recorded)) if lacking else (machine, recorded)


def _one_encoder(plant: str, axis_seed: int) -> Machine:
    """Machine file as the owner of an axis with one encoder gets it."""
    if plant == "own":
        return OwnAxis(axis_seed, one_encoder=True).commissioned()
    return commissioned_machine(axis_seed, one_encoder=True)


def blind(recorded: Recorded) -> Recorded:
    """The same shift without anything that its linear encoder told."""
    return replace(recorded, blocks=[_blind(block) for block in recorded.blocks])


def _blind(block: FeatureBlock) -> FeatureBlock:
    phases = {
        name: replace(getattr(block, name), table_m=math.nan)
        for name in ("accelerating", "cruising", "braking")
    }
    return replace(block, fault=block.fault | Fault.NO_TABLE, **phases)


def table(shifts: Iterable[Shift]) -> str:
    """Axis-hours and false alarms of each plant, and the bound of their rate."""
    by_plant: defaultdict[str, list[Shift]] = defaultdict(list)
    for each in shifts:
        by_plant[each.plant].append(each)
    rows = [_row(plant, mine) for plant, mine in sorted(by_plant.items())]
    rows.append(_row("all", [each for mine in by_plant.values() for each in mine]))
    false = [f"  {s.plant} {s.axis_seed}: {dict(s.said)}" for p in by_plant.values() for s in p]
    return "\n".join([*rows, *(line for line in false if not line.endswith("{}"))])


def _row(plant: str, shifts: Sequence[Shift]) -> str:
    hours = sum(each.hours for each in shifts)
    count = sum(sum(each.said.values()) for each in shifts)
    most = upper_bound(count, 60.0 * hours) / 10_000.0 * 60.0 * PER_AXIS_HOURS
    return (
        f"{plant}: {count} false in {hours:.1f} axis-hours ({len(shifts)} axes), "
        f"at most {most:.1f} per {PER_AXIS_HOURS:.0f} axis-hours (95 %)"
    )


def told(shifts: Iterable[Shift]) -> Iterator[Shift]:
    """The shifts, each told on standard error as it comes."""
    for count, each in enumerate(shifts, start=1):
        said = dict(each.said) or "silent"
        sys.stderr.write(f"{count}: {each.plant} {each.axis_seed}: {said}\n")
        yield each


def main(arguments: Sequence[str] | None = None) -> int:
    """Run; the status is 1 where a healthy axis was accused."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=7000)
    parser.add_argument("--plants", nargs="*", choices=PLANTS, default=PLANTS)
    parser.add_argument("--processes", type=int, default=1)
    given = parser.parse_args(arguments)
    count = max(round(given.hours * 3600.0 / SHIFT_S / len(given.plants)), 1)
    jobs = [(plant, given.seed + k) for k in range(count) for plant in given.plants]
    with ProcessPoolExecutor(given.processes) as pool:
        shifts = list(told(pool.map(watched, *zip(*jobs, strict=True))))
    sys.stdout.write(table(shifts) + "\n")
    return 1 if any(each.said for each in shifts) else 0


if __name__ == "__main__":
    sys.exit(main())
