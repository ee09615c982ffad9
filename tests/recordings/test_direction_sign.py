"""Columns made of two: a difference, and a sign from another column's direction."""

from pathlib import Path

import numpy as np
import pytest

from edge_service.recordings.columns import ColumnMap, TraceError
from edge_service.recordings.reader import DirectionSign, read_trace


@pytest.mark.parametrize("cut", range(9))
def test_the_sign_is_that_of_the_last_change_over_any_cut(cut: int) -> None:
    values = np.array([0.0, 0.0, 1.0, 1.0, np.nan, 2.0, 1.5, 1.5, 1.5])
    sign = DirectionSign()
    signs = np.concatenate([sign.of(values[:cut]), sign.of(values[cut:])])
    np.testing.assert_array_equal(signs, [np.nan, np.nan, 1, 1, 1, 1, -1, -1, -1])


def test_a_position_is_read_as_a_difference_and_a_current_with_the_direction(
    tmp_path: Path,
) -> None:
    path = tmp_path / "r.csv"
    path.write_text("t,set,error,i\n0,10,1,5\n1,20,2,5\n2,30,3,5\n3,20,-2,5\n4,20,-1,-5\n")
    columns = {
        "time_s": ColumnMap("t"),
        "table_position_m": ColumnMap("set", 1e-3, 0.5, minus="error"),
        "torque_command_nm": ColumnMap("i", 2.0, direction="set"),
    }
    frame = read_trace(path, columns)
    np.testing.assert_allclose(
        frame.channels["table_position_m"], 0.5 + np.array([9.0, 18.0, 27.0, 22.0, 21.0]) / 1e3
    )
    np.testing.assert_array_equal(frame.channels["torque_command_nm"], [np.nan, 10, 10, -10, -10])


@pytest.mark.parametrize("part", ["minus", "direction"])
def test_a_part_that_the_file_lacks_is_named(part: str, tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text("t,set\n0,1\n")
    columns = {"time_s": ColumnMap("t"), "table_position_m": ColumnMap("set", **{part: "fault"})}
    with pytest.raises(TraceError, match="no column 'fault', which the machine file gives for tab"):
        read_trace(path, columns)
