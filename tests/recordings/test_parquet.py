"""Reading Parquet and MCAP: the same columns, whatever their type; rows come back."""

import json
from decimal import Decimal
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from edge_service.messages.samples import ANGLE, TORQUE, ColumnMap, SampleFrame
from edge_service.recordings.columns import TraceError
from edge_service.recordings.reader import open_trace, read_trace
from edge_service.recordings.writer import TraceWriter


def test_types_nulls_and_unknown_columns(tmp_path: Path) -> None:
    path = tmp_path / "no-suffix-needed.csv"
    table = pa.table(
        {
            "n": pa.array([0, 1, 2], pa.int64()),
            "torque_command_nm": pa.array([1.5, None, float("inf")], pa.float32()),
            "motor_angle_rad": pa.array(["1.25", " -2e1 ", "?"]),
            "table_position_m": pa.array(["3", None, "3"]).dictionary_encode(),
            "temperature_c": pa.array([Decimal("20.5"), None, Decimal("21.0")]),
            "external_force_n": pa.nulls(3),
            "mode": pa.array([{"auto": True}] * 3),
        }
    )
    pq.write_table(table, path)
    with open_trace(path, {"time_s": ColumnMap("n", scale=0.5)}) as reader:
        (frame,) = list(reader)
    nan = np.nan
    np.testing.assert_array_equal(frame.time_s, [0.0, 0.5, 1.0])
    np.testing.assert_array_equal(frame.channels["torque_command_nm"], [1.5, nan, nan])
    np.testing.assert_array_equal(frame.channels["motor_angle_rad"], [1.25, -20.0, nan])
    np.testing.assert_array_equal(frame.channels["table_position_m"], [3.0, nan, 3.0])
    np.testing.assert_array_equal(frame.channels["temperature_c"], [20.5, nan, 21.0])
    assert np.isnan(frame.channels["external_force_n"]).all()
    assert (reader.bad_cells["torque_command_nm"], reader.bad_cells["motor_angle_rad"]) == (2, 1)


def test_a_column_of_another_type_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "trace.parquet"
    stamps = pa.array([b"0", b"1"])
    pq.write_table(pa.table({"time_s": stamps, "motor_angle_rad": [0.0, 1.0]}), path)
    with pytest.raises(TraceError, match=r"column 'time_s' is of type binary"):
        open_trace(path)


@pytest.mark.parametrize("keep", [4, 100, 0.5, 0.99])
def test_truncated_file(tmp_path: Path, keep: float) -> None:
    path = tmp_path / "trace.parquet"
    time_s = np.arange(5000) * 1e-3
    pq.write_table(pa.table({"time_s": time_s, "motor_angle_rad": np.sin(time_s)}), path)
    content = path.read_bytes()
    path.write_bytes(content[: int(keep if keep >= 1 else keep * len(content))])
    with pytest.raises(TraceError, match="truncated or damaged"):
        read_trace(path)


def test_damaged_page_is_noticed_by_its_checksum(tmp_path: Path) -> None:
    path = tmp_path / "trace.parquet"
    time_s = np.random.default_rng(1).normal(size=5000)
    table = pa.table({"time_s": time_s, "motor_angle_rad": np.sin(time_s)})
    pq.write_table(table, path, write_page_checksum=True, compression="none", use_dictionary=False)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(TraceError, match="truncated or damaged"):
        read_trace(path)


def test_a_page_that_unpacks_to_too_much_is_refused_and_many_pages_are_not(tmp_path: Path) -> None:
    """A few kilobytes may hold gigabytes; a group of rows may be large."""
    path, rows = tmp_path / "trace.parquet", 500_000
    table = pa.table({"time_s": np.arange(rows) * 1e-3, "motor_angle_rad": [f"{0.5:.72f}"] * rows})
    pq.write_table(table, path, row_group_size=rows, use_dictionary=False, compression="zstd")
    with open_trace(path) as reader:
        assert next(iter(reader)).channels["motor_angle_rad"][0] == 0.5
    pq.write_table(
        table,
        path,
        use_dictionary=False,
        compression="zstd",
        data_page_size=1 << 28,
        max_rows_per_page=rows,
    )
    assert path.stat().st_size < 1 << 21
    with pytest.raises(TraceError, match=r"a page of .* bytes; more than"), open_trace(path):
        pass


mcap_reader = pytest.importorskip("mcap.reader", reason="the extra 'mcap' is not installed")
TORQUES = np.array([0.1, np.nan, 1e-300, -2.5])
ANGLES = np.array([1.0, np.pi, 2.0 / 3.0, np.inf])


def _write(path: Path, time_s: list[float]) -> Path:
    with TraceWriter(path, [TORQUE, ANGLE]) as writer:
        writer.write(SampleFrame(np.array(time_s), {TORQUE: TORQUES, ANGLE: ANGLES}))
    return path


def test_every_value_comes_back_at_its_time(tmp_path: Path) -> None:
    path = _write(tmp_path / "trace.mcap", [0.0, 0.002, 0.004, 12.5])
    with path.open("rb") as file:
        reader = mcap_reader.make_reader(file, validate_crcs=True)
        messages = list(reader.iter_messages())
        (schema,) = reader.get_summary().schemas.values()
    assert [each.log_time for _, _, each in messages] == [0, 2_000_000, 4_000_000, 12_500_000_000]
    assert {channel.topic for _, channel, _ in messages} == {"axis/samples"}
    assert {channel.message_encoding for _, channel, _ in messages} == {"json"}
    rows = [json.loads(message.data) for _, _, message in messages]
    assert [row["time_s"] for row in rows] == [0.0, 0.002, 0.004, 12.5]
    assert [row[TORQUE] for row in rows] == [0.1, None, 1e-300, -2.5]
    assert [row[ANGLE] for row in rows] == [1.0, np.pi, 2.0 / 3.0, None]
    assert schema.encoding == "jsonschema"
    assert set(json.loads(schema.data)["properties"]) == {"time_s", TORQUE, ANGLE}


def test_log_times_count_from_the_first_row_where_time_is_negative(tmp_path: Path) -> None:
    path = _write(tmp_path / "trace.mcap", [-0.5, 0.0, 0.5, 1.0])
    with path.open("rb") as file:
        reader = mcap_reader.make_reader(file)
        times = [message.log_time for _, _, message in reader.iter_messages()]
        (metadata,) = list(reader.iter_metadata())
    assert times == [0, 500_000_000, 1_000_000_000, 1_500_000_000]
    assert metadata.metadata == {"log_time_zero_s": "-0.5"}


@pytest.mark.parametrize("time_s", [[0.0, 1.0, -1.0, 2.0], [0.0, 1e12, 2.0, 3.0]])
def test_a_time_that_cannot_be_a_log_time(tmp_path: Path, time_s: list[float]) -> None:
    with pytest.raises(TraceError, match="cannot be a log time of MCAP"):
        _write(tmp_path / "trace.mcap", time_s)
    assert list(tmp_path.iterdir()) == []
