"""Tests of printed values: each lies in its interval, with no more digits than that allows."""

from hypothesis import given
from hypothesis import strategies as st

from edge_service.messages.interval import printed

NUMBERS = st.floats(0.0, 1e4)
WIDTHS = st.floats(0.0, 1e3)
DECIMALS = st.sampled_from([0, 1, 2])


@given(value=NUMBERS, below=WIDTHS, above=WIDTHS, decimals=DECIMALS)
def test_the_printed_value_lies_within_printed_bounds_that_hold_the_true_ones(
    value: float, below: float, above: float, decimals: int
) -> None:
    low, high = value - below, value + above
    middle, least, most = map(float, printed(value, low, high, decimals))
    assert least <= low + 1e-6
    assert most >= high - 1e-6
    assert least <= middle <= most
    assert abs(middle - value) <= 10.0**-decimals
    if min(below, above) > 2e-3:
        assert least < middle < most
