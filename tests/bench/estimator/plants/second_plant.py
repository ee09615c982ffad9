"""Rows of a benchmark that lies beside the checkout: run as a stranger would, by its commands.

It makes recordings of a plant of its own, calls the installed command on them and scores the
answers. Nothing of it is imported.
"""

import json
import math
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ...table import BenchError, Progress, Table, mean_of

BESIDE = Path(__file__).parents[4].parent / "shared" / "bench"
MAKE, SCORE = "preload_make.py", "preload_score.py"
HEADS: tuple[str, ...] = (
    "second plant beside the checkout",
    "wrong",
    "rows",
    "machines",
    "MAE",
    "fresh",
    "cover",
    "score",
    "drop",
    "rise",
    "end",
)
HEADS += ("seen s", "answered", "failed")


@dataclass(frozen=True, slots=True, eq=False)
class PlantPart:
    """One recording of the second plant.

    Attributes:
        sheet: whether the nominal machine file states the nut's stiffness and the table's mass.
        row: its figures by the benchmark's own names.
    """

    seed: int
    sheet: bool
    row: Mapping[str, Any]


def has_second_plant(folder: Path) -> bool:
    """Return whether its commands are there."""
    return all((folder / name).is_file() for name in (MAKE, SCORE))


def tool_command() -> str:
    """The running installation's own command, as a shell would read it."""
    return shlex.join([sys.executable, "-m", "edge_service"])


def run_second_plant(
    folder: Path, seed: int, quick: bool, processes: int, say: Progress
) -> Iterator[PlantPart]:
    """Make its recordings of one seed and score them with and without a data sheet.

    Raises BenchError where a command fails.
    """
    with tempfile.TemporaryDirectory(prefix="second-plant-") as home:
        out, answers = Path(home) / "recordings", Path(home) / "scores.json"
        say(f"second plant, seed {seed}: making recordings")
        extent = ["--set", "small" if quick else "full", "--jobs", str(processes)]
        extent += ["--minutes", "2"] if quick else []
        run_command([str(folder / MAKE), str(out), "--seed", str(seed), *extent], say)
        for sheet in (False, True):
            name = f"second plant, seed {seed}, {'data sheet' if sheet else 'no data sheet'}"
            command = [str(folder / SCORE), str(out), "--tool", tool_command()]
            command += ["--json", str(answers), *(["--sheet"] if sheet else [])]
            run_command(command, partial(_reported, say, name))
            for row in json.loads(answers.read_text("utf-8"))["traces"]:
                yield PlantPart(seed, sheet, row)


def _reported(say: Progress, name: str, line: str) -> None:
    say(f"{name}: {line}")


def run_command(command: Sequence[str], say: Progress) -> None:
    """Run one of its commands; what it tells on stderr is progress.

    Raises BenchError where it fails.
    """
    last = ""
    with (
        tempfile.TemporaryFile() as table,
        subprocess.Popen(
            [sys.executable, *command], stdout=table, stderr=subprocess.PIPE, text=True
        ) as running,
    ):
        assert running.stderr is not None
        for line in running.stderr:
            if line.strip():
                last = line.strip()
                say(last)
    if running.returncode:
        raise BenchError(f"{Path(command[0]).name} ended with {running.returncode}: {last}")


def plant_table(parts: Sequence[PlantPart]) -> Table:
    """One row for each scenario over all seeds, without and with a data sheet; then all."""
    rows: list[tuple[object, ...]] = []
    for sheet in dict.fromkeys(part.sheet for part in parts):
        mine = [part for part in parts if part.sheet is sheet]
        title = "sheet" if sheet else "no sheet"
        for scenario in dict.fromkeys(str(part.row["scenario"]) for part in mine):
            same = [part for part in mine if part.row["scenario"] == scenario]
            rows.append((f"{scenario.replace('_', ' ')}, {title}", *figures_of(same)))
        rows.append((f"all, {title}", *figures_of(mine)))
    seeds = ", ".join(map(str, sorted({part.seed for part in parts})))
    return Table(
        HEADS,
        tuple(rows),
        (
            f"seeds {seeds}; means over recordings; drop, rise: the farthest that a number left a "
            "preload that never changed; end: mean size of the mean error of the last minute; "
            "seen: s of motion, each recording with a drop or step",
            *(_failure(part) for part in parts if part.row["state"] != "ok"),
        ),
    )


def _failure(part: PlantPart) -> str:
    """Account of what became of a recording without answers, in one line."""
    where = f"seed {part.seed}, machine {part.row['machine']}, {part.row['scenario']}"
    return f"  failed: {where}: {' '.join(str(part.row['state']).split())}"


def figures_of(parts: Sequence[PlantPart]) -> tuple[object, ...]:
    """Figures in the order of `HEADS` behind the first."""
    rows = [part.row for part in parts]

    def known(key: str) -> list[float]:
        return [float(row[key]) for row in rows if row.get(key) is not None]

    seen = [
        math.inf if row.get("delay_motion_s") is None else float(row["delay_motion_s"])
        for row in rows
        if "detected" in row
    ]
    return (
        mean_of(known("wrong")),
        int(sum(known("rows"))),
        len({(part.seed, part.row["machine"]) for part in parts}),
        mean_of(known("mae")),
        mean_of(known("always_fresh_mae")),
        mean_of(known("coverage")),
        mean_of(known("interval_score")),
        max(known("false_drop"), default=math.nan),
        max(known("false_rise"), default=math.nan),
        mean_of([abs(end) for end in known("end_error")]),
        tuple(round(each, 1) for each in seen),
        mean_of(known("estimated")),
        sum(row["state"] != "ok" for row in rows),
    )
