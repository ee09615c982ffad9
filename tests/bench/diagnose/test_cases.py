"""A small part of the bench: what must hold of each kind of case, whatever its numbers."""

import pytest

from .bench import run_cases
from .cases import BenchCase
from .rows import BenchRow, are_all_named, is_first, is_sure
from .table import as_text

HEALTHY = [BenchCase((), 1.0, motion, 70 + k) for k, motion in enumerate(("full", "staircase"))]
SINGLES = [
    BenchCase((cause,), 1.0, motion, 80 + k)
    for k, (cause, motion) in enumerate(
        [("position_friction", "staircase"), ("backlash", "production")]
    )
]
PAIRS = [
    BenchCase(("load_offset", "encoder_eccentricity"), 1.0, "production", 90),
    BenchCase(("drag_error", "timestamp_skew"), 1.0, "staircase", 91),
]
ODD = [
    BenchCase((cause,), 1.0, "production", 100 + k)
    for k, cause in enumerate(("stuck_seal", "loose_fixture", "crosstalk"))
]
LEFT_OUT = [
    BenchCase((cause,), 1.0, "staircase", 110 + k, (cause,))
    for k, cause in enumerate(("torque_ripple", "position_friction"))
]
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def rows() -> dict[BenchCase, BenchRow]:
    return {row.case: row for row in run_cases(HEALTHY + SINGLES + PAIRS + ODD + LEFT_OUT)}


def test_nothing_is_wrong_with_a_healthy_axis(rows):
    for case in HEALTHY:
        assert rows[case].named == {}
        assert rows[case].verdict == "no_gap"


def test_a_single_cause_leads(rows):
    for case in SINGLES:
        assert rows[case].ratio > 1.5
        assert is_first(rows[case])


def test_both_of_a_pair_are_named(rows):
    for case in PAIRS:
        assert are_all_named(rows[case])


def test_what_no_library_holds_is_not_named_with_confidence(rows):
    for case in ODD + LEFT_OUT:
        assert not is_sure(rows[case])


def test_the_table_is_filled_from_the_rows(rows):
    table = as_text(list(rows.values()))
    assert f"| 0 of {len(HEALTHY)} |" in table
    for case in ODD + LEFT_OUT:
        assert case.causes[0] in table
