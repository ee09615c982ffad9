"""Rows in Parquet: one column per number, readable with any tool.

pyarrow is imported when it is needed: a service without history on disk saves its 40 MB.
"""

import errno
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ...atomic import DamagedError, read_kept_bytes, replaced_bytes
from ...messages.samples import Floats
from .rows import QUANTITIES, STATUSES, Rows, is_plausible, no_rows, single_rows
from .seal import SEAL, is_sealed, sealed

WRITTEN, ADOPTED = "written", "adopted"
"""Origins of a seal: with the file, or later, on a file of a version that wrote none."""
_UNREADABLE = (
    *(ValueError, KeyError, TypeError, IndexError, AttributeError),
    *(OverflowError, RuntimeError, OSError),
)
_KINDS = ("count", "least", "mean", "most")
_WORDS = {"count": "count", "least": "min", "mean": "mean", "most": "max"}
_NAMES = [
    (kind, number, f"{quantity}_{_WORDS[kind]}")
    for number, quantity in enumerate(QUANTITIES)
    for kind in _KINDS
]


def to_table(rows: Rows) -> Any:
    """The rows as an Arrow table, NaN as null; single estimates have one column per quantity."""
    import pyarrow as pa

    columns: dict[str, Any] = {
        "time": pa.array((rows.time_s * 1e6).round().astype(np.int64), pa.timestamp("us", "UTC")),
        "status": pa.DictionaryArray.from_arrays(
            pa.array(rows.status.astype(np.int8)), [each.value for each in STATUSES]
        ),
        "low": pa.array(rows.low, from_pandas=True),
        "high": pa.array(rows.high, from_pandas=True),
    }
    if np.all(rows.samples == 1):
        values = zip(QUANTITIES, rows.mean, strict=True)
        return pa.table(columns | {name: pa.array(row, from_pandas=True) for name, row in values})
    columns["samples"] = pa.array(rows.samples.astype(np.int32))
    for kind, number, name in _NAMES:
        row = getattr(rows, kind)[number]
        counts = kind == "count"
        columns[name] = (
            pa.array(row.astype(np.int32)) if counts else pa.array(row, from_pandas=True)
        )
    return pa.table(columns)


def from_table(table: Any) -> Rows:
    """The rows of an Arrow table made by `to_table`.

    No value is cast by Arrow: its functions for that take another 15 MB.
    """
    time_s = table.column("time").to_numpy().astype("datetime64[us]").astype(np.int64) / 1e6
    status = _statuses(table.column("status").combine_chunks())
    low, high = _column(table, "low"), _column(table, "high")
    if "samples" not in table.column_names:
        values = np.stack([_column(table, name) for name in QUANTITIES])
        return single_rows(time_s, status, low, high, values)
    count, least, mean, most = (
        np.stack([_column(table, name) for k, _, name in _NAMES if k == kind]) for kind in _KINDS
    )
    samples = _column(table, "samples").astype(np.int64)
    return Rows(time_s, samples, status, low, high, count.astype(np.int64), least, mean, most)


def _statuses(coded: Any) -> npt.NDArray[np.int64]:
    index = {each.value: number for number, each in enumerate(STATUSES)}
    words = coded.dictionary.to_pylist()
    numbers: npt.NDArray[np.int64] = np.array([index[word] for word in words], np.int64)
    return np.asarray(numbers[coded.indices.to_numpy()])


def _column(table: Any, name: str) -> Floats:
    values: Floats = table.column(name).to_numpy().astype(np.float64)
    return values


def write_rows(path: Path, rows: Rows, origin: str = WRITTEN) -> None:
    """Write a sealed file that takes `path`'s place on success. Raises OSError."""
    table = to_table(rows).replace_schema_metadata({SEAL: origin})
    content = sealed(_parquet(table))
    with replaced_bytes(path) as file:
        file.write(content)


def read_rows(path: Path) -> tuple[Rows, bool]:
    """Read a file written by `write_rows`, and whether it has a seal.

    Raises:
        DamagedError: it is not what was written.
        OSError: it cannot be read now.
    """
    content = read_kept_bytes(path)
    if content is None:
        return no_rows(), True
    has_seal = is_sealed(content)
    rows = _decoded(content)
    if not has_seal and not is_plausible(rows):
        raise DamagedError("its content contradicts itself")
    return rows, has_seal


def check_rows(path: Path) -> bool:
    """True if a file has a seal, which fits. Raises DamagedError, OSError."""
    content = read_kept_bytes(path)
    return content is None or is_sealed(content)


def _decoded(content: bytes) -> Rows:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        return from_table(pq.ParquetFile(pa.BufferReader(content)).read(use_threads=False))
    except MemoryError:
        raise OSError(errno.ENOMEM, "too little memory") from None
    except (pa.ArrowException, *_UNREADABLE) as error:
        words = str(error).splitlines() or [""]
        raise DamagedError(f"no history file ({words[0][:100]})") from None


def _parquet(table: Any) -> bytes:
    import pyarrow as pa
    import pyarrow.parquet as pq

    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd")
    content: bytes = sink.getvalue().to_pybytes()
    return content


def _write_csv(table: Any, sink: Any) -> None:
    """Write times as RFC 3339 and states as words."""
    import pyarrow as pa
    from pyarrow import compute, csv

    time = compute.strftime(table.column("time"), "%Y-%m-%dT%H:%M:%SZ")
    table = table.set_column(table.schema.get_field_index("time"), "time", time)
    at = table.schema.get_field_index("status")
    csv.write_csv(table.set_column(at, "status", table.column("status").cast(pa.string())), sink)


def as_bytes(rows: Rows, form: str) -> bytes:
    """The rows as the bytes of a Parquet, CSV or Arrow IPC file (`parquet`, `csv`, `arrow`)."""
    import pyarrow as pa

    table = to_table(rows)
    if form == "parquet":
        return _parquet(table)
    sink = pa.BufferOutputStream()
    if form == "csv":
        _write_csv(table, sink)
        return bytes(sink.getvalue())
    with pa.ipc.new_file(sink, table.schema) as writer:
        writer.write_table(table)
    content: bytes = sink.getvalue().to_pybytes()
    return content
