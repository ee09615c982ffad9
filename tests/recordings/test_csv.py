"""Reading CSV: kindness where a file is unambiguous, faults as data, columns made of two."""

from pathlib import Path

import numpy as np
import pytest

from edge_service.messages.samples import ColumnMap, SampleFrame
from edge_service.recordings.columns import TraceError
from edge_service.recordings.reader import DirectionSign, open_trace, read_trace
from edge_service.recordings.text import BLOCK_BYTES


def _read(tmp_path: Path, content: bytes | str, **columns: ColumnMap) -> SampleFrame:
    path = tmp_path / "trace.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return read_trace(path, columns)


PLAIN = "time_s,torque_command_nm\n0.0,1.5\n0.001,-2.5\n"


@pytest.mark.parametrize(
    "content",
    [
        PLAIN,
        PLAIN.rstrip("\n"),
        b"\xef\xbb\xbf" + PLAIN.encode(),
        PLAIN.replace("\n", "\r\n"),
        PLAIN.replace("\n", "\r"),
        PLAIN.replace("\n", ",\n"),
        PLAIN.replace("\n", ",\n", 1),
        "time_s,torque_command_nm\n0.0,1.5,\n0.001,-2.5,\n",
        PLAIN.replace("\n", "\n\n"),
        " time_s , torque_command_nm \n 0.0 , 1.5 \n 0.001 , -2.5 \n",
        '"time_s","torque_command_nm"\n"0.0","1.5"\n"0.001","-2.5"\n',
        '"time_s", "torque_command_nm"\n0.0,1.5\n0.001,-2.5\n',
        "# recorded on axis X\n#\n" + PLAIN,
        "# time_s,torque_command_nm\n0.0,1.5\n0.001,-2.5\n",
        "time_s;torque_command_nm\n0.0;1.5\n0.001;-2.5\n",
        "time_s;torque_command_nm\n0,0;1,5\n0,001;-2,5\n",
        "time_s\ttorque_command_nm\n0.0\t1.5\n0.001\t-2.5\n",
        "torque_command_nm,program,time_s\n1.5,N10,0.0\n-2.5,N20,0.001\n",
        'time_s,remark,torque_command_nm\n0.0,"a, b ""c""",1.5\n0.001,,-2.5\n',
        "time_s,torque_command_nm,Temp [\u00b0C]\n0.0,1.5,20\n0.001,-2.5,20\n".encode("latin-1"),
        "time_s,torque_command_nm\n+0.0,15e-1\n1E-3,-25.e-1\n",
    ],
)
def test_the_same_trace_in_many_hands(tmp_path: Path, content: bytes | str) -> None:
    frame = _read(tmp_path, content)
    assert list(frame.channels) == ["torque_command_nm"]
    np.testing.assert_array_equal(frame.time_s, [0.0, 0.001])
    np.testing.assert_array_equal(frame.channels["torque_command_nm"], [1.5, -2.5])


def test_foreign_columns_are_scaled_to_si(tmp_path: Path) -> None:
    frame = _read(
        tmp_path,
        "t_ms,u_V,x_mm\n1000,2.0,10\n1001,-3.0,11\n",
        time_s=ColumnMap("t_ms", scale=1e-3, offset=-1.0),
        torque_command_nm=ColumnMap("u_V", scale=0.5),
        table_position_m=ColumnMap("x_mm", scale=1e-3, offset=0.25),
    )
    np.testing.assert_allclose(frame.time_s, [0.0, 0.001], atol=1e-15)
    np.testing.assert_array_equal(frame.channels["torque_command_nm"], [1.0, -1.5])
    np.testing.assert_allclose(frame.channels["table_position_m"], [0.26, 0.261])


def test_row_number_as_clock_counts_ragged_rows_and_goes_on_over_blocks(tmp_path: Path) -> None:
    rows = 2 * BLOCK_BYTES // len(b"0.125,x\n")
    lines = ["0.125,x"] * rows
    ragged = [3, 4, rows - 2]
    for row in ragged:
        lines[row] = "0.125"
    frame = _read(
        tmp_path,
        "torque_command_nm,n\n" + "\n".join(lines) + "\n",
        time_s=ColumnMap("#row", scale=0.5, offset=1.0),
    )
    expected = np.delete(np.arange(rows), ragged) * 0.5 + 1.0
    np.testing.assert_array_equal(frame.time_s, expected)


def test_cells_without_a_number_are_missing_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "trace.csv"
    cells = ["1", "", "nan", "NaN", "null", "inf", "-Infinity", "1e999", "ERR", "1.2.3", "0x1", "7"]
    lines = [f"{index},{cell},5" for index, cell in enumerate(cells)]
    path.write_text("time_s,torque_command_nm,motor_angle_rad\n" + "\n".join(lines) + "\n")
    with open_trace(path) as reader:
        frames = list(reader)
    torque = np.concatenate([frame.channels["torque_command_nm"] for frame in frames])
    np.testing.assert_array_equal(torque, [1.0, *[np.nan] * 10, 7.0])
    assert reader.bad_cells == {"time_s": 0, "torque_command_nm": 10, "motor_angle_rad": 0}
    assert reader.rows_read == 12


def test_rows_without_time_and_ragged_rows_are_left_out_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "trace.csv"
    path.write_text(
        "time_s,torque_command_nm\n0,1\nnan,2\n,3\ntime_s,torque_command_nm\n1\n1,2,3\n2,4\n3"
    )
    with open_trace(path) as reader:
        (frame,) = list(reader)
    np.testing.assert_array_equal(frame.time_s, [0.0, 2.0])
    np.testing.assert_array_equal(frame.channels["torque_command_nm"], [1.0, 4.0])
    assert (reader.bad_cells["time_s"], reader.ragged_rows) == (3, 3)


def test_a_stray_quote_costs_its_cell_not_the_rest_of_the_file(tmp_path: Path) -> None:
    frame = _read(tmp_path, 'time_s,torque_command_nm\n0,1\n1,"2\n2,3\n3,4\n')
    np.testing.assert_array_equal(frame.time_s, [0, 1, 2, 3])
    np.testing.assert_array_equal(frame.channels["torque_command_nm"], [1, np.nan, 3, 4])


def test_a_machine_file_chooses_among_columns_that_differ_in_case(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time_s,torque_command_nm,Torque_Command_NM\n0.0,1.0,5.0\n0.001,2.0,6.0\n")
    with pytest.raises(TraceError, match="differ in case alone"):
        read_trace(path)
    for name, first in (("torque_command_nm", 1.0), ("Torque_Command_NM", 5.0)):
        read = read_trace(path, {"torque_command_nm": ColumnMap(name)})
        assert read.channels["torque_command_nm"][0] == first


@pytest.mark.parametrize("cut", range(9))
def test_the_sign_is_that_of_the_last_change_over_any_cut(cut: int) -> None:
    values = np.array([0.0, 0.0, 1.0, 1.0, np.nan, 2.0, 1.5, 1.5, 1.5])
    sign = DirectionSign()
    signs = np.concatenate([sign.of(values[:cut]), sign.of(values[cut:])])
    np.testing.assert_array_equal(signs, [np.nan, np.nan, 1, 1, 1, 1, -1, -1, -1])


def test_a_position_is_read_as_a_difference_and_a_current_with_direction(tmp_path: Path) -> None:
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
