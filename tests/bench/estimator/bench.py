"""The bench of the mixture estimator: each row measured, beside the thesis', and what was aimed at.

Truth comes from the library's plant and from others written differently; every axis is
commissioned on a recording of its own before it is judged.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..life.bench import life_section
from ..pool import Progress, in_processes
from ..table import Section
from .healthy.false_conditions import healthy_section
from .parts import TABLE
from .plants.second_plant import has_second_plant, plant_section, run_second_plant
from .rows import BenchTable, table_of
from .tasks import BenchSettings, Task, tasks_of
from .wear.wear_rates import rate_section

SCHEMA = "estimator-bench/1"
_SECTIONS: Mapping[str, Callable[[Any], Section]] = {
    "life": life_section,
    "rates": rate_section,
    "healthy": healthy_section,
    "second-plant": plant_section,
}


@dataclass(frozen=True, slots=True, eq=False)
class EstimatorBench:
    """Accuracy of the estimator; a part that was not asked for is None or absent.

    Attributes:
        unmeasured: why a part that was asked for could not be measured.
    """

    table: BenchTable | None
    sections: tuple[Section, ...] = ()
    unmeasured: tuple[str, ...] = ()

    def as_text(self) -> str:
        """All tables, for a terminal."""
        tables = [each.as_text() for each in (self.table, *self.sections) if each]
        return "\n\n".join([*tables, *self.unmeasured])

    def as_dict(self) -> dict[str, Any]:
        """For a program; what is not a number is null."""
        known: dict[str, Any] = {"schema": SCHEMA, "unmeasured": list(self.unmeasured)}
        if self.table is not None:
            known |= self.table.as_dict()
        known |= {section.name: section.as_dict() for section in self.sections}
        return known


def run_estimator_bench(
    settings: BenchSettings | None = None, progress: Progress | None = None
) -> EstimatorBench:
    """Run the parts asked for, the same numbers in every run.

    Args:
        progress: called with what is done.
    """
    settings, say = settings or BenchSettings(), progress or (lambda _: None)
    found = _run(tasks_of(settings), settings.processes, say)
    unmeasured = _run_second_plant(settings, found, say)
    named = [name for name in _SECTIONS if found.get(name)]
    table = [part for name in TABLE for part in found.get(name, [])]
    return EstimatorBench(
        table=table_of(table) if table else None,
        sections=tuple(_SECTIONS[name](found[name]) for name in named),
        unmeasured=unmeasured,
    )


def _run(tasks: Sequence[Task], processes: int, say: Progress) -> dict[str, list[Any]]:
    """Results of all tasks by part, in the order of the tasks."""
    done: dict[int, list[Any]] = {}
    for number, result in in_processes(tasks, processes):
        done[number] = result
        say(f"{len(done)} of {len(tasks)}: {tasks[number].name}")
    found: dict[str, list[Any]] = {}
    for number, task in enumerate(tasks):
        found.setdefault(task.part, []).extend(done[number])
    return found


def _run_second_plant(
    settings: BenchSettings, found: dict[str, list[Any]], say: Progress
) -> tuple[str, ...]:
    """Add its recordings; why there are none, where there are none."""
    folder = settings.second_plant
    if "second-plant" not in settings.parts:
        return ()
    if not has_second_plant(folder):
        return (f"second plant: not measured, there is none in {folder}",)
    for seed in range(settings.seed, settings.seed + settings.seeds):
        parts = run_second_plant(folder, seed, settings.quick, settings.processes, say)
        found.setdefault("second-plant", []).extend(parts)
    return ()
