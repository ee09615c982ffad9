"""Rows and times of a recording without reading all of its numbers: for lists."""

from contextlib import suppress
from pathlib import Path

from ..messages.samples import TIME
from .parquet import PARQUET_SUFFIXES, parquet_extent

_CHUNK_BYTES, _LINE_BYTES = 1 << 20, 1 << 14
Extent = tuple[int | None, float | None, float | None]
"""Rows, first and last `time_s` of a recording; None: not known."""


def extent_of(path: Path) -> Extent:
    """Extent of a Parquet or CSV file; of one in another form, or that is none, what is known."""
    with suppress(OSError, ValueError):
        return parquet_extent(path, TIME) if path.suffix in PARQUET_SUFFIXES else _of_text(path)
    return None, None, None


def _of_text(path: Path) -> Extent:
    """Extent of text with a header; times are known where the first column is `time_s`."""
    with path.open("rb") as file:
        header, first = file.readline(_LINE_BYTES), file.readline(_LINE_BYTES)
        lines, end = header.count(b"\n") + first.count(b"\n"), first
        while chunk := file.read(_CHUNK_BYTES):
            lines += chunk.count(b"\n")
            end = (end + chunk)[-_LINE_BYTES:]
    rows = max(lines - 1 + (not end.endswith(b"\n")), 0)
    if rows and header.split(b",")[0].strip() == TIME.encode():
        last = end.rstrip().rpartition(b"\n")[2]
        with suppress(ValueError):
            return rows, float(first.split(b",")[0]), float(last.split(b",")[0])
    return rows, None, None
