"""History as a file, every row of it: CSV, or Parquet for any tool.

pyarrow is imported when it is needed: a service that nobody asks for files saves its 40 MB.
"""

from collections.abc import Iterable
from enum import StrEnum
from typing import IO, Any

import numpy as np

from .history import History
from .rows import NO_ROWS, QUANTITIES, STATUSES, Rows


class HistoryForm(StrEnum):
    """Form of a file."""

    CSV = "csv"
    PARQUET = "parquet"


def write_history(
    sink: IO[bytes],
    form: HistoryForm,
    history: History,
    axes: Iterable[str],
    start_s: float = -np.inf,
    end_s: float = np.inf,
) -> int:
    """Write all rows of axes in [start_s, end_s), oldest first; returns their number.

    Columns: axis, time, status, samples (1 of a single estimate, more of a minute or an hour), low,
    high, and of each quantity the mean; empty where there was none. Raises StoreFailedError.
    """
    from pyarrow import csv, parquet

    count, empty = 0, _table("", NO_ROWS)
    writer: Any = (
        parquet.ParquetWriter(sink, empty.schema, compression="zstd")
        if form is HistoryForm.PARQUET
        else csv.CSVWriter(sink, _as_text(empty).schema)
    )
    with writer:
        for axis in axes:
            for rows in history.spans(axis, start_s, end_s):
                table = _table(axis, rows)
                writer.write_table(table if form is HistoryForm.PARQUET else _as_text(table))
                count += rows.size
    return count


def _table(axis: str, rows: Rows) -> Any:
    """Rows as an Arrow table, NaN as null."""
    import pyarrow as pa

    status = pa.array(
        np.array([each.value for each in STATUSES], object)[rows["status"]], pa.string()
    )
    columns = {
        "axis": pa.array([axis] * rows.size, pa.string()),
        "time": pa.array(rows["time_us"], pa.timestamp("us", "UTC")),
        "status": status,
        "samples": pa.array(rows["samples"], pa.int64()),
        "low": pa.array(rows["bounds"][:, 0], pa.float64(), from_pandas=True),
        "high": pa.array(rows["bounds"][:, 1], pa.float64(), from_pandas=True),
    }
    for name, values in zip(QUANTITIES, rows["values"][:, 1].T, strict=True):
        columns[name] = pa.array(values, pa.float64(), from_pandas=True)
    return pa.table(columns)


def _as_text(table: Any) -> Any:
    """Times as RFC 3339."""
    from pyarrow import compute

    time = compute.strftime(table.column("time"), "%Y-%m-%dT%H:%M:%SZ")
    return table.set_column(table.schema.get_field_index("time"), "time", time)
