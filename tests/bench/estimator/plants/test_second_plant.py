"""A second plant beside the checkout: its commands are run, its answers read."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ..bench import run_estimator_bench
from ..tasks import BenchSettings
from .second_plant import (
    BESIDE,
    PlantPart,
    SecondPlantError,
    figures_of,
    has_second_plant,
    plant_section,
    run_second_plant,
)

MAKE = """
import pathlib, sys
import numpy as np
hidden = pathlib.Path(sys.argv[1]) / "hidden"
hidden.mkdir(parents=True)
time_s = np.arange(0.0, 11.0)
truth = np.column_stack([time_s, 6.0 - 0.1 * time_s, np.ones(11), 0.5 * time_s])
np.savez(hidden / "machine-0-slow_loss.npz", truth=truth)
"""
SCORE = """
import json, pathlib, sys
print("a table " * 20_000)
print("\\r1/1 slow_loss", end="", file=sys.stderr, flush=True)
tool, out = (sys.argv[sys.argv.index(name) + 1] for name in ("--tool", "--json"))
row = {"machine": 0, "scenario": "slow_loss", "state": "ok", "rows": 10, "mae": 0.5,
       "curve": [[2.0, 6.0, 5.5, 6.5], [4.0, None, None, None]], "tool": tool,
       "wrong": 0.25 if "--sheet" in sys.argv else 0.75}
pathlib.Path(out).write_text(json.dumps({"traces": [row]}))
"""


def benchmark(folder: Path, make: str = MAKE) -> Path:
    (folder / "preload_make.py").write_text(make)
    (folder / "preload_score.py").write_text(SCORE)
    return folder


def test_its_commands_are_run_with_and_without_a_data_sheet(tmp_path: Path) -> None:
    said: list[str] = []
    parts = run_second_plant(benchmark(tmp_path), 7, True, 1, said.append)
    assert [(part.seed, part.sheet, part.row["wrong"]) for part in parts] == [
        (7, False, 0.75),
        (7, True, 0.25),
    ]
    assert "second plant, seed 7, data sheet: 1/1 slow_loss" in said
    assert parts[0].row["tool"].endswith("-m edge_service")
    track = parts[0].track
    assert track is not None
    assert track.truth == pytest.approx([5.8, 5.6])
    assert track.motion_s == pytest.approx([1.0, 2.0])
    assert np.isnan(track.percent[1])
    text = plant_section(parts).as_text()
    assert "slow loss, no sheet" in text
    assert "slow loss, sheet" in text


def test_a_command_that_fails_is_reported_in_one_line(tmp_path: Path) -> None:
    folder = benchmark(tmp_path, "raise SystemExit('no room left')")
    with pytest.raises(SecondPlantError, match=r"preload_make\.py ended with 1: no room left"):
        run_second_plant(folder, 1, True, 1, lambda _: None)


def part_of(**row: Any) -> PlantPart:
    known = {"machine": 0, "scenario": "sudden_drop", "state": "ok", "rows": 100}
    return PlantPart(1, False, known | row, None)


def test_figures_are_means_but_the_worst_of_false_changes() -> None:
    names = ("wrong", "rows", "machines", "mae", "fresh", "cover", "score", "drop", "rise", "end")
    parts = [
        part_of(
            mae=1.0, wrong=0.5, false_drop=0.2, end_error=-0.4, detected=True, delay_motion_s=3
        ),
        part_of(machine=1, mae=3.0, wrong=0.0, false_drop=0.9, end_error=0.2, detected=False),
        part_of(machine=1, state="exit 2", detected=False, delay_motion_s=None),
    ]
    figures = figures_of(parts)
    row = dict(zip((*names, "seen", "answered", "failed"), figures, strict=True))
    assert row["mae"] == pytest.approx(2.0)
    assert row["wrong"] == pytest.approx(0.25)
    assert (row["rows"], row["machines"], row["failed"]) == (300, 2, 1)
    assert row["drop"] == pytest.approx(0.9)
    assert row["end"] == pytest.approx(0.3)
    assert row["seen"] == (3.0, math.inf, math.inf)
    assert "failed: seed 1, machine 1, sudden_drop: exit 2" in plant_section(parts).as_text()
    assert isinstance(row["rise"], float)
    assert math.isnan(row["rise"])


def test_the_rows_end_up_in_one_document(tmp_path: Path) -> None:
    settings = BenchSettings(True, ("second-plant",), 9, second_plant=benchmark(tmp_path))
    document = run_estimator_bench(settings).as_dict()
    assert set(document) == {"schema", "unmeasured", "second-plant"}
    assert document["unmeasured"] == []
    assert document["second-plant"]["rows"][0]["wrong"] == pytest.approx(0.75)


def test_what_cannot_be_measured_beside_others_is_reported(tmp_path: Path) -> None:
    settings = BenchSettings(parts=("second-plant",), second_plant=tmp_path)
    found = run_estimator_bench(settings)
    assert found.sections == ()
    assert "second plant: not measured" in found.as_text()
    assert found.as_dict()["unmeasured"] == list(found.unmeasured)


@pytest.mark.slow
@pytest.mark.skipif(not has_second_plant(BESIDE), reason=f"no second plant in {BESIDE}")
def test_the_installed_command_is_scored_on_it() -> None:
    parts = run_second_plant(BESIDE, 1, True, 1, lambda _: None, minutes=2.0)
    assert {part.sheet for part in parts} == {False, True}
    for part in parts:
        assert part.row["state"] == "ok", part.row
        assert part.track is not None
