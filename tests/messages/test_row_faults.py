import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from edge_service.messages.row_faults import CLOCK_RESET_S, clock_parts

TIMES = st.lists(st.one_of(st.floats(0.0, 10.0), st.just(float("nan"))), max_size=40)


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
