"""Reading Parquet: the same columns, whatever their type."""

from decimal import Decimal
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from edge_service.recordings.columns import ColumnMap, TraceError
from edge_service.recordings.reader import open_trace, read_trace


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
    assert reader.bad_cells["torque_command_nm"] == 2
    assert reader.bad_cells["motor_angle_rad"] == 1


def test_a_column_of_another_type_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "trace.parquet"
    stamps = pa.array([0, 1], pa.timestamp("us"))
    pq.write_table(pa.table({"time_s": stamps, "motor_angle_rad": [0.0, 1.0]}), path)
    with pytest.raises(TraceError, match=r"column 'time_s' is of type timestamp\[us\]"):
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
