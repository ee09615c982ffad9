"""Rows of the bench: kept, read again, and counted as they should be."""

from dataclasses import replace
from pathlib import Path

import pytest

from edge_service.studies.diagnose_bench import (
    BenchCase,
    BenchRow,
    plan_cases,
    read_rows,
    write_rows,
)
from edge_service.studies.diagnose_table import figures_of, is_place_right

CASE = BenchCase(("backlash",), 1.0, "full", 5)
ROW = BenchRow(
    case=CASE,
    verdict="explained",
    named={"backlash": 0.95},
    classes={"backlash": ["backlash"]},
    ratio=10.0,
    unexplained=0.01,
    shrink={"backlash": (0.8, 0.7, 0.9)},
    realised={"backlash": 0.83},
    gap={"transmission_m": (5e-6, 1e-6, 2e-8)},
    where=["transmission_m:direction"],
    seconds=3.0,
)
WRONG = replace(ROW, case=replace(CASE, causes=("drag_error",), seed=6))
HEALTHY = replace(ROW, case=replace(CASE, causes=(), seed=7), named={}, shrink={}, realised={})


def reached(name: str, rows: list[BenchRow]) -> float:
    return next(each.reached for each in figures_of(rows) if each.name.startswith(name))


def test_rows_are_read_as_they_were_written(tmp_path: Path) -> None:
    out = tmp_path / "rows.jsonl"
    write_rows([ROW, WRONG], out, "w")
    write_rows([HEALTHY], out, "a")
    assert read_rows(out) == [ROW, WRONG, HEALTHY]
    out.write_text(out.read_text()[:-20])
    assert read_rows(out) == [ROW, WRONG]
    assert read_rows(tmp_path / "none.jsonl") == []


def test_figures_count_what_is_right_and_wrong() -> None:
    rows = [ROW, WRONG, HEALTHY]
    assert reached("top-1, full protocol, clear", rows) == pytest.approx(0.5)
    assert reached("confident and wrong", rows) == pytest.approx(1.0 / 3.0)
    assert reached("healthy falsely", rows) == 0.0
    assert reached("healthy falsely", [replace(HEALTHY, named={"stribeck": 0.4})]) == 1.0
    assert reached("calibration error", [ROW]) == pytest.approx(0.05)
    assert reached("calibration error", [WRONG]) == pytest.approx(0.95)
    assert reached("shrink, predicted less realised: median", [ROW]) == pytest.approx(0.03)
    assert reached("shrink: 90 % interval", [ROW]) == 1.0


def test_the_place_must_be_a_variable_of_the_cause() -> None:
    assert is_place_right(ROW)
    assert not is_place_right(replace(ROW, where=["transmission_m:motor_angle_rad"]))
    assert not is_place_right(replace(ROW, where=[]))


def test_a_plan_holds_every_kind_and_is_the_same_each_time() -> None:
    cases = plan_cases(48, seed=3)
    assert cases == plan_cases(48, seed=3)
    assert len(set(cases)) == 48
    assert {len(case.causes) for case in cases} == {0, 1, 2, 3}
    assert any(case.withheld for case in cases)
    assert {case.motion for case in cases} == {"full", "production", "staircase"}
