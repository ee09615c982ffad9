"""A factor against what is expected of it: on either side, and when too little is known."""

import pytest

from edge_service.checks.finding import FACTOR_TOLERANCE, Verdict, judge_factor
from edge_service.regression.interval_estimate import IntervalEstimate, around, undetermined

EXPECTED = 2.5


def factor(ratio: float, share: float) -> IntervalEstimate:
    """An estimate at a ratio to what is expected, with an error of so much of it."""
    return around(ratio * EXPECTED, share * EXPECTED, "", 1000.0)


@pytest.mark.parametrize(
    ("ratio", "said"), [(3.0, "3 times too large"), (0.5, "2 times too small"), (-1.0, "inverted")]
)
def test_a_factor_far_off_is_doubted_on_either_side(ratio: float, said: str) -> None:
    found = judge_factor("scale", factor(ratio, 1e-3), EXPECTED, "as stated", "torque")
    assert found.verdict is Verdict.DOUBTFUL
    assert said in found.sentence


def test_a_factor_within_the_tolerance_fits_and_a_vague_one_is_unknown() -> None:
    near = judge_factor("scale", factor(1.0 + 0.5 * FACTOR_TOLERANCE, 1e-3), EXPECTED, "as stated")
    assert (near.verdict, near.sentence) == (Verdict.FITS, "as stated")
    vague = judge_factor("scale", factor(1.0, 2.0 * FACTOR_TOLERANCE), EXPECTED, "as stated")
    assert vague.verdict is Verdict.UNKNOWN
    none = judge_factor("scale", undetermined("", "no motion"), EXPECTED, "as stated")
    assert none.verdict is Verdict.UNKNOWN
    assert "no motion" in none.sentence
