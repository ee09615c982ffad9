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

import numpy as np

from ...pool import Progress
from ...table import Section, mean_of
from ..scores import Track

BESIDE = Path(__file__).parents[4].parent / "shared" / "bench"
MAKE, SCORE = "preload_make.py", "preload_score.py"
ANSWERS = "scores.json"
HEADS: tuple[str, ...] = (
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


class SecondPlantError(Exception):
    """Reason why its commands could not be run, in one line."""


@dataclass(frozen=True, slots=True, eq=False)
class PlantPart:
    """One recording of the second plant.

    Attributes:
        sheet: whether the nominal machine file states the nut's stiffness and the table's mass.
        row: its figures by the benchmark's own names.
        track: thinned; None where there was no number.
    """

    seed: int
    sheet: bool
    row: Mapping[str, Any]
    track: Track | None


def has_second_plant(folder: Path) -> bool:
    """Tell whether its commands are there."""
    return all((folder / name).is_file() for name in (MAKE, SCORE))


def tool_command() -> str:
    """The running installation's own command, as a shell would read it."""
    return shlex.join([sys.executable, "-m", "edge_service"])


def run_second_plant(
    folder: Path,
    seed: int,
    quick: bool,
    processes: int,
    say: Progress,
    minutes: float | None = None,
) -> list[PlantPart]:
    """Make its recordings of one seed and score them with and without a data sheet.

    Args:
        minutes: length of a recording; None: the benchmark's own.

    Raises SecondPlantError where a command fails.
    """
    parts: list[PlantPart] = []
    with tempfile.TemporaryDirectory(prefix="second-plant-") as home:
        out = Path(home) / "recordings"
        say(f"second plant, seed {seed}: making recordings")
        make_recordings(folder, out, seed, quick, processes, say, minutes)
        for sheet in (False, True):
            name = f"second plant, seed {seed}, {'data sheet' if sheet else 'no data sheet'}"
            answers = Path(home) / ANSWERS
            command = [str(folder / SCORE), str(out), "--tool", tool_command()]
            command += ["--json", str(answers), *(["--sheet"] if sheet else [])]
            run_command(command, partial(_reported, say, name))
            parts += read_answers(json.loads(answers.read_text("utf-8")), out, seed, sheet)
    return parts


def make_recordings(
    folder: Path,
    out: Path,
    seed: int,
    quick: bool,
    processes: int,
    say: Progress,
    minutes: float | None = None,
) -> None:
    """Make its recordings of one seed in a new folder. Raises SecondPlantError if it fails."""
    extent = ["--set", "small" if quick else "full", "--jobs", str(processes)]
    if minutes is not None:
        extent += ["--minutes", str(minutes)]
    run_command([str(folder / MAKE), str(out), "--seed", str(seed), *extent], say)


def _reported(say: Progress, name: str, line: str) -> None:
    say(f"{name}: {line}")


def read_answers(
    answers: Mapping[str, Any], recordings: Path, seed: int, sheet: bool
) -> Iterator[PlantPart]:
    """Every recording's figures with its curve and truth."""
    for row in answers["traces"]:
        name = f"machine-{row['machine']}-{row['scenario']}.npz"
        yield PlantPart(seed, sheet, row, _track(row, recordings / "hidden" / name))


def _track(row: Mapping[str, Any], truth_file: Path) -> Track | None:
    if not row.get("curve") or not truth_file.is_file():
        return None
    curve = np.array(row["curve"], dtype=np.float64)
    with np.load(truth_file) as known:
        truth = known["truth"]
    time_s, percent, low, high = curve.T
    true_percent = np.interp(time_s, truth[:, 0], truth[:, 1])
    return Track(
        time_s, true_percent, percent, low, high, np.interp(time_s, truth[:, 0], truth[:, 3])
    )


def run_command(command: Sequence[str], say: Progress) -> None:
    """Run one of its commands; what it tells on stderr is progress.

    Raises SecondPlantError where it fails.
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
        raise SecondPlantError(f"{Path(command[0]).name} ended with {running.returncode}: {last}")


def plant_section(parts: Sequence[PlantPart]) -> Section:
    """One row for each scenario over all seeds, without and with a data sheet; then all."""
    rows = []
    for sheet in dict.fromkeys(part.sheet for part in parts):
        mine = [part for part in parts if part.sheet is sheet]
        title = "sheet" if sheet else "no sheet"
        for scenario in dict.fromkeys(str(part.row["scenario"]) for part in mine):
            same = [part for part in mine if part.row["scenario"] == scenario]
            rows.append((f"{scenario.replace('_', ' ')}, {title}", figures_of(same)))
        rows.append((f"all, {title}", figures_of(mine)))
    seeds = ", ".join(map(str, sorted({part.seed for part in parts})))
    return Section(
        name="second-plant",
        title=f"second plant beside the checkout (seeds {seeds})",
        heads=HEADS,
        rows=tuple(rows),
        notes=(
            "means over recordings; drop, rise: the farthest that a number left a preload that "
            "never changed; end: mean size of the mean error of the last minute; seen: s of "
            "motion, each recording with a drop or step",
            *(_failure(part) for part in parts if part.row["state"] != "ok"),
        ),
    )


def _failure(part: PlantPart) -> str:
    """Account of what became of a recording without answers, in one line."""
    where = f"seed {part.seed}, machine {part.row['machine']}, {part.row['scenario']}"
    return f"  failed: {where}: {' '.join(str(part.row['state']).split())}"


def figures_of(parts: Sequence[PlantPart]) -> tuple[object, ...]:
    """Figures in the order of `HEADS`."""
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
