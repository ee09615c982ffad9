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
from pathlib import Path
from typing import Any

from ...table import BenchError, Progress, Table, listed, mean_of

BESIDE = Path(__file__).parents[4].parent / "shared" / "bench"
MAKE, SCORE = "preload_make.py", "preload_score.py"


@dataclass(frozen=True, slots=True, eq=False)
class PlantPart:
    seed: int
    sheet: bool  # whether the nominal machine file states the nut's stiffness and the table's mass
    row: Mapping[str, Any]  # its figures by the benchmark's own names


def run_second_plant(seed: int, quick: bool, processes: int, say: Progress) -> Iterator[PlantPart]:
    """Make its recordings of one seed and score them with and without a data sheet.

    Raises BenchError where its commands are not there, or one fails.
    """
    with tempfile.TemporaryDirectory(prefix="second-plant-") as home:
        out, options = Path(home) / "recordings", ["--jobs", str(processes)]
        options += ["--minutes", "2"] if quick else []
        make_recordings(MAKE, out, seed, quick, say, *options)
        for sheet in (False, True):
            name = f"second plant, seed {seed}, {'data sheet' if sheet else 'no data sheet'}"
            for row in scored(SCORE, out, name, say, *["--sheet"][: int(sheet)])["traces"]:
                yield PlantPart(seed, sheet, row)


def make_recordings(
    make: str, out: Path, seed: int, quick: bool, say: Progress, *options: str
) -> None:
    """Run its command that makes recordings. Raises BenchError."""
    if not (BESIDE / make).is_file():
        raise BenchError(f"bench: no {make} in {BESIDE}")
    say(f"second plant, seed {seed}: making recordings")
    extent = ["--seed", str(seed), "--set", "small" if quick else "full"]
    _run([str(BESIDE / make), str(out), *extent, *options], say)


def scored(score: str, recordings: Path, name: str, say: Progress, *options: str) -> Any:
    """Scores that its command gives the running installation's answers. Raises BenchError."""
    answers = recordings / "scores.json"
    tool = shlex.join([sys.executable, "-m", "edge_service"])
    command = [str(BESIDE / score), str(recordings), "--tool", tool, "--json", str(answers)]
    _run([*command, *options], lambda line: say(f"{name}: {line}"))
    return json.loads(answers.read_text("utf-8"))


def _run(command: Sequence[str], say: Progress) -> None:
    """Run one of its commands; what it tells on stderr is progress."""
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
    rows: list[Mapping[str, object]] = []
    for sheet in dict.fromkeys(part.sheet for part in parts):
        mine = [part for part in parts if part.sheet is sheet]
        title = "sheet" if sheet else "no sheet"
        for scenario in dict.fromkeys(str(part.row["scenario"]) for part in mine):
            same = [part for part in mine if part.row["scenario"] == scenario]
            rows.append(_row(f"{scenario.replace('_', ' ')}, {title}", same))
        rows.append(_row(f"all, {title}", mine))
    return Table.of(
        rows,
        f"seeds {listed(part.seed for part in parts)}; means over recordings; drop, rise: the "
        "farthest that a number left a preload that never changed; end: mean size of the mean "
        "error of the last minute; seen: s of motion, each recording with a drop or step",
        *(_failure(part) for part in parts if part.row["state"] != "ok"),
    )


def _failure(part: PlantPart) -> str:
    """Account of what became of a recording without answers, in one line."""
    where = f"seed {part.seed}, machine {part.row['machine']}, {part.row['scenario']}"
    return f"  failed: {where}: {' '.join(str(part.row['state']).split())}"


def _row(title: str, parts: Sequence[PlantPart]) -> Mapping[str, object]:
    rows = [part.row for part in parts]

    def known(key: str) -> list[float]:
        return [float(row[key]) for row in rows if row.get(key) is not None]

    seen = [
        math.inf if row.get("delay_motion_s") is None else float(row["delay_motion_s"])
        for row in rows
        if "detected" in row
    ]
    return {
        "second plant beside the checkout": title,
        "wrong": mean_of(known("wrong")),
        "rows": int(sum(known("rows"))),
        "machines": len({(part.seed, part.row["machine"]) for part in parts}),
        "MAE": mean_of(known("mae")),
        "fresh": mean_of(known("always_fresh_mae")),
        "cover": mean_of(known("coverage")),
        "score": mean_of(known("interval_score")),
        "drop": max(known("false_drop"), default=math.nan),
        "rise": max(known("false_rise"), default=math.nan),
        "end": mean_of([abs(end) for end in known("end_error")]),
        "seen s": tuple(round(each, 1) for each in seen),
        "answered": mean_of(known("estimated")),
        "failed": sum(row["state"] != "ok" for row in rows),
    }
