"""Rows of the bench: kept, read again, and counted as they should be."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from edge_service.diagnose.result import Place

from .bench import plan_cases
from .cases import BenchCase, BenchError
from .confusion import NOTHING, UNKNOWN, by_strength, confusion, confusion_matrix
from .overlap import overlap
from .rows import BenchRow, is_place_right, read_rows, write_rows
from .table import as_text, figures_of, reliability

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
    again={"transmission_m": (5e-6, 5.2e-7)},
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
    out.write_text('{"case": {"causes": []}}\n')
    with pytest.raises(BenchError, match="line 1 is no case"):
        read_rows(out)


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
    assert reached("shrink realised of what could", [ROW, WRONG]) == pytest.approx(4.48 / 4.98)
    assert "| top-1, full protocol, clear gap | 99 % | 1 of 2 |" in as_text(rows)
    assert "| shrink, predicted less realised: median | 2 % | 3.0 %, of 1 |" in as_text([ROW])


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


def test_the_confusion_counts_each_answer_once_where_it_belongs() -> None:
    tied = replace(
        WRONG,
        named={"backlash": 0.5, "drag_error": 0.5},
        classes={name: ["backlash", "drag_error"] for name in ("backlash", "drag_error")},
        shrink={"backlash": (0.5, 0.4, 0.6), "drag_error": (0.4, 0.3, 0.5)},
    )
    open_ = replace(WRONG, verdict="unknown", named={"backlash": 0.3})
    left_out = replace(WRONG, case=replace(WRONG.case, withheld=("drag_error",)))
    rows = [ROW, WRONG, HEALTHY, tied, open_, left_out]
    assert confusion(rows) == {
        "backlash": {"backlash": 1},
        "drag_error": {"backlash": 1, "drag_error": 1, UNKNOWN: 1},
        "healthy": {NOTHING: 1},
        "no drag_error": {"backlash": 1},
    }
    head, *lines = confusion_matrix(rows)
    assert head.split() == ["1", "2", "nothing", "unknown"]
    assert [line.split() for line in lines] == [
        ["1", "backlash", "1", ".", ".", "."],
        ["2", "drag_error", "1", "1", ".", "1"],
        ["3", "healthy", ".", ".", "1", "."],
        ["no", "drag_error", "1", ".", ".", "."],
    ]
    assert by_strength(rows) == [f"{'backlash':<26} x1 1 of 1", f"{'drag_error':<26} x1 1 of 3"]


def test_reliability_counts_what_was_true() -> None:
    assert reliability([ROW, WRONG]) == [(pytest.approx(0.95), 0.5, 2)]


@pytest.mark.parametrize(
    ("low", "high", "expected"), [(0.2, 0.4, 1.0), (0.2, 0.3, 0.5), (0.6, 0.8, 0.0)]
)
def test_the_overlap_is_of_what_the_cause_adds(low: float, high: float, expected: float) -> None:
    random = np.random.default_rng(3)
    time_s = np.arange(20_000) * 0.01
    position = random.uniform(0.0, 1.0, len(time_s))
    common = 0.3 * random.standard_normal(len(time_s))
    added = np.where((position > 0.2) & (position < 0.4), 1.0, 0.01)

    def session(gap: np.ndarray) -> SimpleNamespace:
        variables = {"time_s": time_s, "table_position_m": position}
        return SimpleNamespace(
            channels={"torque_nm": SimpleNamespace(gap=gap, variables=variables)}
        )

    place = Place(
        channel="torque_nm",
        variable="table_position_m",
        low=low,
        high=high,
        unit="m",
        share=0.9,
        energy=0.9,
    )
    ailing, healthy = session(common + added), session(common)
    right = frozenset({"table_position_m"})
    assert overlap([place], ailing, healthy, right) == pytest.approx(expected, abs=0.06)
    assert overlap([place], ailing, healthy, frozenset({"time_s"})) is None
    assert overlap([], ailing, healthy, right) is None
