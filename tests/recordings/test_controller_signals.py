"""Names and units of controllers: SINUMERIK signals and Industrial Edge columns."""

import math
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from edge_service.messages.samples import ColumnMap
from edge_service.recordings.columns import TraceError
from edge_service.recordings.reader import open_trace, read_trace
from edge_service.recordings.sinumerik.signals import ControllerAxis

AXIS = ControllerAxis(number=1, lead_m=0.01)
RAD_PER_MM = 2.0 * math.pi / 10.0
EDGE = (
    "time_s,TORQUE|1,ENC1_POS|1,ENC2_POS|1,DES_POS|1,CURRENT|1,LOAD|1,CMD_SPEED|1,ENC1_POS|2\n"
    "0.000,0.5,100.0,99.5,100.5,2.0,10,5.0,7.0\n"
    "0.002,0.6,101.0,100.5,101.5,2.5,11,5.0,8.0\n"
)


def _write(folder: Path, suffix: str, text: str = EDGE) -> Path:
    path = folder / f"edge{suffix}"
    path.write_text(text)
    if suffix == ".parquet":
        names, *rows = [line.split(",") for line in text.splitlines()]
        cells = [[float(cell) for cell in column] for column in zip(*rows, strict=True)]
        pq.write_table(pa.table(dict(zip(names, cells, strict=True))), path)
    return path


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_edge_columns_are_known_by_their_names(tmp_path: Path, suffix: str) -> None:
    path = _write(tmp_path, suffix)
    frame = read_trace(path, axis=AXIS)
    expected = {
        "torque_command_nm": [0.5, 0.6],
        "motor_angle_rad": [100.0 * RAD_PER_MM, 101.0 * RAD_PER_MM],
        "table_position_m": [0.0995, 0.1005],
        "position_setpoint_m": [0.1005, 0.1015],
    }
    assert set(frame.channels) == set(expected)
    for name, values in expected.items():
        np.testing.assert_allclose(frame.channels[name], values, rtol=1e-14)
    with open_trace(path, axis=AXIS) as reader:
        assert set(reader.ignored) == {"CURRENT|1", "LOAD|1", "CMD_SPEED|1", "ENC1_POS|2"}


def test_another_axis_and_one_that_is_not_there(tmp_path: Path) -> None:
    path = _write(tmp_path, ".csv")
    frame = read_trace(path, axis=ControllerAxis(number=2, lead_m=0.02))
    np.testing.assert_allclose(frame.channels["motor_angle_rad"], [0.7 * math.pi, 0.8 * math.pi])
    with pytest.raises(TraceError, match="no signal of axis 3; axes there are: 1, 2"):
        open_trace(path, axis=ControllerAxis(number=3))
    for text, there in ((EDGE, "1, 2"), (EDGE.replace("|1", "|5"), "2, 5")):
        with pytest.raises(TraceError, match=f"axes there are: {there}; expected .*--axis-number"):
            open_trace(_write(tmp_path, ".csv", text))


def test_the_machine_file_comes_first_and_may_use_short_names(tmp_path: Path) -> None:
    path = _write(tmp_path, ".csv")
    columns = {
        "torque_command_nm": ColumnMap("CURRENT", 0.4, 0.1),
        "motor_speed_rad_s": ColumnMap("CMD_SPEED", 3.0),
    }
    with open_trace(path, columns, AXIS) as reader:
        (frame,) = list(reader)
    np.testing.assert_allclose(frame.channels["torque_command_nm"], [0.9, 1.1])
    np.testing.assert_allclose(frame.channels["motor_speed_rad_s"], [15.0, 15.0])
    assert not any(remark.startswith("torque_command_nm") for remark in reader.remarks)


def test_a_current_is_no_torque_without_a_scale(tmp_path: Path) -> None:
    path = _write(tmp_path, ".csv", EDGE.replace("TORQUE|1", "POWER|1"))
    with open_trace(path, axis=AXIS) as reader:
        assert "torque_command_nm" not in reader.channels
        wish = "torque_command_nm could be CURRENT, lacking: the torque constant in N m/A"
        assert wish in reader.remarks
