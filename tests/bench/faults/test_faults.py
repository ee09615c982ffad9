"""Short forms of the benchmarks of damage, disk and crashes, and how they judge."""

import os
import random
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from . import kept
from .answers import Answers
from .crash import kill_at_random
from .damage import damage
from .disk import CASES, run_case
from .every_call import AXES, die_at, loss, work

BUCKET = {
    "samples": 3,
    "preload_percent": {"min": 1.0, "max": 3.0, "mean": 2.0},
    **dict.fromkeys(("drag_torque_nm", "nis", "stiffness_n_per_m", "temperature_c")),
}
TRUTH = Answers(frozenset({("use way", "5"), ("log[]", '"a note"')}), {"12:00": BUCKET})
EMPTY = Answers(frozenset({("use way", "0")}), {})


def _false(**changes: object) -> int:
    answers = replace(TRUTH, **changes)
    return len(answers.false_ones(TRUTH, EMPTY, frozenset({"age"}), 1.7e9))


@pytest.mark.parametrize(
    ("changes", "false"),
    [
        ({}, 0),
        ({"leaves": frozenset({("use way", "0")})}, 0),
        ({"leaves": frozenset({("use way", "4")})}, 1),
        ({"leaves": frozenset({("age", "4")})}, 0),
        ({"leaves": frozenset({("use since", '"2100-01-01T00:00:00Z"')})}, 0),
        ({"leaves": frozenset({("use since", '"1999-01-01T00:00:00Z"')})}, 1),
        ({"buckets": {"12:01": BUCKET}}, 1),
        ({"buckets": {"12:00": BUCKET | {"nis": 1.0}}}, 1),
        ({"buckets": {"12:00": BUCKET | {"samples": 2}}}, 0),
        ({"buckets": {"12:00": BUCKET | {"samples": 4}}}, 1),
        ({"leaves": frozenset({("audit newest", "4"), ("audit problem", '""')})}, 1),
        ({"leaves": frozenset({("audit newest", "4"), ("audit problem", '"5 is gone"')})}, 0),
        ({"leaves": frozenset({("log[]", '{"number": 1, "problem": ""}')})}, 1),
        ({"leaves": frozenset({("log[]", '{"number": 1, "problem": "changed"}')})}, 0),
    ],
)
def test_an_answer_is_false_unless_it_was_kept_or_nothing_is_known(
    changes: dict[str, object], false: int
) -> None:
    assert _false(**changes) == false


def test_kinds_of_files_have_no_axis_time_or_number() -> None:
    paths = ["axis=X/raw/2026-01-31T12.parquet", "axis=Y2/hour/2026.parquet", "jobs/12.json"]
    assert [kept.kind(Path(path)) for path in paths] == [
        "axis=*/raw/*.parquet",
        "axis=*/hour/*.parquet",
        "jobs/*.json",
    ]


def test_a_loss_is_seen(tmp_path: Path) -> None:
    reading, writing = os.pipe()
    work(tmp_path, 0, writing)
    os.close(writing)
    acknowledged = os.read(reading, 4096).decode()
    os.close(reading)
    assert loss(tmp_path, acknowledged).lost == 0
    shutil.rmtree(tmp_path / f"axis={AXES[0]}")
    (tmp_path / "state.json").unlink()
    assert loss(tmp_path, acknowledged).lost > 3


@pytest.mark.slow
def test_no_damage_of_a_kept_file_is_served_or_blocks_a_start(tmp_path: Path) -> None:
    found = {each.key: each.value for each in damage(tmp_path, 60, hours=2).figures}
    assert (found["served"], found["blocked"], found["disturbed"]) == (0.0, 0.0, 0.0)


@pytest.mark.slow
def test_a_service_that_is_killed_keeps_what_it_acknowledged(tmp_path: Path) -> None:
    toll = kill_at_random(tmp_path / "kills", 3, random.Random(1))
    assert (toll.kills, toll.lost, toll.doubled) == (3, 0, 0)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("strace") is None, reason="needs strace")
def test_work_that_is_killed_at_a_call_keeps_what_it_acknowledged(tmp_path: Path) -> None:
    for call in range(1, 200, 13):
        found, _ = die_at(tmp_path / str(call), 0, call)
        assert (found.lost, found.doubled, found.damages) == (0, 0, 0), call


@pytest.mark.slow
@pytest.mark.parametrize("name", ["no growth"])
def test_a_disk_that_takes_nothing_for_a_while_costs_nothing(tmp_path: Path, name: str) -> None:
    (case,) = (each for each in CASES if each.name == name)
    outcome = run_case(case, tmp_path / "work")
    assert (outcome.told, outcome.lost, outcome.doubled) == (True, 0, 0)
