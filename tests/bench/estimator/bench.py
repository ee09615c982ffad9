"""The bench of the fused estimator: every row measured, beside the thesis', and what was aimed at.

Truth comes from the library's plant and from others written differently; every axis is
commissioned on a recording of its own before it is judged.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..life.bench import life_pictures, life_section
from ..pool import Progress, in_processes
from ..table import Drawn, PipelineBench, Section
from .ablation import ablation_section, run_ablation
from .healthy.false_alarms import count_false_alarms
from .healthy.false_conditions import healthy_pictures, healthy_section
from .parts import TABLE
from .plants.second_plant import has_second_plant, plant_pictures, plant_section, run_second_plant
from .rows import BenchTable, table_of
from .speed.fused_speed import speed_bench
from .tasks import BenchSettings, Task, tasks_of
from .wear.wear_rates import rate_pictures, rate_section

QUICK_RUNS, FULL_RUNS = 20, 1200
"""Of 1000 steps each, for false alarms."""
SCHEMA = "estimator-bench/1"
_Sections = Mapping[str, tuple[Callable[[Any], Section], Callable[[Any], list[Drawn]]]]
_SECTIONS: _Sections = {
    "life": (life_section, life_pictures),
    "rates": (rate_section, rate_pictures),
    "healthy": (healthy_section, healthy_pictures),
    "second-plant": (plant_section, plant_pictures),
    "ablation": (ablation_section, lambda _: []),
}


@dataclass(frozen=True, slots=True, eq=False)
class EstimatorBench:
    """Accuracy and speed of the estimator; a part that was not asked for is None or absent.

    Attributes:
        drawn: pictures by section.
        unmeasured: why a part that was asked for could not be measured.
    """

    table: BenchTable | None
    speed: PipelineBench | None
    sections: tuple[Section, ...] = ()
    drawn: Mapping[str, Sequence[Drawn]] | None = None
    unmeasured: tuple[str, ...] = ()

    def as_text(self) -> str:
        """All tables, for a terminal."""
        tables = [each.as_text() for each in (self.table, *self.sections, self.speed) if each]
        return "\n\n".join([*tables, *self.unmeasured])

    def as_json(self) -> str:
        """For a program; what is not a number is null."""
        known: dict[str, Any] = {"schema": SCHEMA, "unmeasured": list(self.unmeasured)}
        if self.table is not None:
            known |= json.loads(self.table.as_json())
        known |= {section.name: section.as_dict() for section in self.sections}
        if self.speed is not None:
            known["speed"] = self.speed.as_dict()["figures"]
        return json.dumps(known, indent=2, allow_nan=False)


def run_estimator_bench(
    settings: BenchSettings | None = None, progress: Progress | None = None
) -> EstimatorBench:
    """Run the parts asked for, the same numbers in every run; then the speeds of this machine.

    Args:
        progress: called with what is done.
    """
    settings, say = settings or BenchSettings(), progress or (lambda _: None)
    found = _run(tasks_of(settings), settings.processes, say)
    unmeasured = _run_second_plant(settings, found, say)
    if "ablation" in settings.parts:
        found["ablation"] = _ablation(settings, say)
    named = [name for name in _SECTIONS if found.get(name)]
    table = [part for name in TABLE for part in found.get(name, [])]
    return EstimatorBench(
        table=table_of(table) if table else None,
        speed=_speed(settings.quick, say) if "speed" in settings.parts else None,
        sections=tuple(_SECTIONS[name][0](found[name]) for name in named),
        drawn={name: _SECTIONS[name][1](found[name]) for name in named},
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
    folder, wanted = settings.second_plant, {"second-plant", "ablation"} & {*settings.parts}
    if wanted and not has_second_plant(folder):
        return (f"second plant: not measured, there is none in {folder} (--second-plant)",)
    if "second-plant" not in wanted:
        return ()
    for seed in range(settings.seed, settings.seed + settings.seeds):
        parts = run_second_plant(folder, seed, settings.quick, settings.processes, say)
        found.setdefault("second-plant", []).extend(parts)
    return ()


def _ablation(settings: BenchSettings, say: Progress) -> list[Any]:
    seeds = range(settings.seed, settings.seed + settings.seeds)
    return list(run_ablation(settings.second_plant, seeds, settings.quick, settings.processes, say))


def _speed(quick: bool, say: Progress) -> PipelineBench:
    say("speed")
    speed = speed_bench(quick)
    say("false alarms")
    figures = count_false_alarms(QUICK_RUNS if quick else FULL_RUNS).figures()
    return replace(speed, figures=(*speed.figures, *figures))
