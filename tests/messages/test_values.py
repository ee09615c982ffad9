"""Values: printed within their intervals; faults of rows; quality, and its way over the wire."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge_service.messages.codec import CodecError, Header
from edge_service.messages.interval import printed
from edge_service.messages.row_faults import CLOCK_RESET_S, clock_parts
from edge_service.messages.samples import ANGLE, TORQUE, Quality, SampleFrame, is_bad, is_uncertain
from edge_service.messages.topics import RAW

HEADER = Header(1, 2, 3, 4)
CODES = np.array([Quality.GOOD, Quality.LATE_READ, Quality.NO_REPLY], dtype=np.uint8)
FRAME = SampleFrame(
    np.array([0.0, 0.1, 0.2]),
    {TORQUE: np.array([0.1, 0.2, np.nan]), ANGLE: np.array([1.0, 2.0, 3.0])},
    {TORQUE: CODES, ANGLE: np.zeros(3, dtype=np.uint8)},
)
NUMBERS = st.floats(0.0, 1e4)
WIDTHS = st.floats(0.0, 1e3)
DECIMALS = st.sampled_from([0, 1, 2])
TIMES = st.lists(st.one_of(st.floats(0.0, 10.0), st.just(float("nan"))), max_size=40)


def test_every_code_has_its_level() -> None:
    for code in Quality:
        codes = np.array([code], dtype=np.uint8)
        assert is_bad(codes)[0] == (code.level == "bad")
        assert is_uncertain(codes)[0] == (code.level == "uncertain")


def test_quality_goes_over_the_wire_where_it_is_not_all_good() -> None:
    payload = RAW.encode("X", HEADER, FRAME)
    axis, header, decoded = RAW.decode(payload)
    assert (axis, header) == ("X", HEADER)
    assert set(decoded.channels) == {TORQUE, ANGLE}
    assert set(decoded.quality) == {TORQUE}
    np.testing.assert_array_equal(decoded.quality[TORQUE], CODES)
    np.testing.assert_array_equal(decoded.channels[TORQUE], FRAME.channels[TORQUE])


def test_samples_without_doubt_are_the_bytes_they_always_were() -> None:
    plain = SampleFrame(FRAME.time_s, FRAME.channels)
    good = SampleFrame(FRAME.time_s, FRAME.channels, {ANGLE: np.zeros(3, dtype=np.uint8)})
    assert RAW.encode("X", HEADER, good) == RAW.encode("X", HEADER, plain)


@pytest.mark.parametrize("value", [-1.0, 256.0, np.nan])
def test_a_code_that_is_none_is_no_payload(value: float) -> None:
    named = "torque_command_nm.quality"
    forged = SampleFrame(FRAME.time_s, {**FRAME.channels, named: np.full(3, value)})
    with pytest.raises(CodecError, match="no code"):
        RAW.decode(RAW.encode("X", HEADER, forged))


def test_quality_of_a_channel_that_is_not_there_is_refused() -> None:
    with pytest.raises(ValueError, match="quality of motor_angle_rad"):
        SampleFrame(FRAME.time_s, {TORQUE: FRAME.channels[TORQUE]}, {ANGLE: CODES})
    forged = SampleFrame(FRAME.time_s, {"a": np.zeros(3), "b.quality": np.zeros(3)})
    with pytest.raises(CodecError, match="quality of b"):
        RAW.decode(RAW.encode("X", HEADER, forged))


def test_cutting_a_frame_cuts_its_quality() -> None:
    cut = FRAME.part(FRAME.time_s < 0.15)
    np.testing.assert_array_equal(cut.quality[TORQUE], CODES[:2])


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


@given(TIMES)
def test_parts_hold_every_row_once_and_count_up_without_the_faulty_ones(times: list[float]) -> None:
    time_s = np.array(times, dtype=np.float64)
    parts = list(clock_parts(time_s))
    assert [part.rows.start for part in parts] == [0, *(part.rows.stop for part in parts[:-1])]
    assert parts[-1].rows.stop == len(time_s)
    for part in parts:
        inside = time_s[part.rows]
        kept = inside[~(part.repeated | part.backwards | np.isnan(inside))]
        assert (np.diff(kept) > 0.0).all()
        newest = np.fmax.accumulate(inside)[part.backwards]
        assert (newest - inside[part.backwards] <= CLOCK_RESET_S).all()


@given(TIMES, st.integers(0, 40))
def test_any_split_finds_the_same_rows(times: list[float], cut: int) -> None:
    time_s = np.array(times, dtype=np.float64)
    whole = list(clock_parts(time_s))
    first = list(clock_parts(time_s[:cut]))
    both = [*first, *clock_parts(time_s[cut:], first[-1].newest_s)]
    for name in ("repeated", "backwards"):
        np.testing.assert_array_equal(
            np.concatenate([getattr(part, name) for part in both]),
            np.concatenate([getattr(part, name) for part in whole]),
        )
