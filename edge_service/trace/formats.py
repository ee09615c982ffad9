"""The forms of a trace file, told apart by their first bytes."""

from collections.abc import Mapping
from pathlib import Path

from .block import Source
from .columns import ColumnLike, TraceError
from .csv_source import CsvSource
from .parquet_source import MAGIC, ParquetSource
from .sinumerik.controller_axis import ControllerAxis
from .sinumerik.controller_signals import (
    EDGE_SIGNALS,
    SINUMERIK_SIGNALS,
    ControllerColumns,
    check_edge_time,
    edge_signals,
    map_signals,
)
from .sinumerik.source import HEAD_BYTES, SinumerikSource, is_sinumerik

PARQUET_SUFFIXES = (".parquet", ".pq")


def open_source(path: Path, axis: ControllerAxis) -> Source:
    """Open a file in the form that its content has. Raises TraceError and OSError."""
    if path.exists() and not path.is_file():
        raise TraceError(f"{path}: a folder or device; expected a CSV, Parquet or XML file")
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    magic = head[: len(MAGIC)]
    if magic == MAGIC or (not magic.strip() and path.suffix.lower() in PARQUET_SUFFIXES):
        return ParquetSource(path)
    if is_sinumerik(head):
        return SinumerikSource(path, axis.interpolate_positions)
    return CsvSource(path)


def controller_columns(
    path: Path, source: Source, axis: ControllerAxis, columns: Mapping[str, ColumnLike]
) -> ControllerColumns:
    """Meaning of a controller's names: a SINUMERIK trace, Industrial Edge columns, or nothing.

    Args:
        path: the file, for messages.
        source: the open file.
        axis: the axis that is wanted.
        columns: of the machine file.

    Raises:
        TraceError: the axis is not there, or it is open which one is meant.
    """
    if isinstance(source, SinumerikSource):
        return map_signals(path, source.signals, SINUMERIK_SIGNALS, axis, columns)
    signals = edge_signals(source.names)
    if not signals:
        return ControllerColumns()
    check_edge_time(path, source.names, columns)
    return map_signals(path, signals, EDGE_SIGNALS, axis, columns)
