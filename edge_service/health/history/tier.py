"""Rows of one resolution: in files that appear whole or not at all, or in memory alone."""

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Protocol

import numpy as np

from .parquet import read_rows, write_rows
from .rows import Rows, in_order, joined, no_rows

_CACHED_ROWS = 20_000


@dataclass(frozen=True, slots=True)
class Resolution:
    """One tier's step and files.

    Attributes:
        name: its folder.
        step_s: length of a row, s; 0: every estimate by itself.
        file_name: strftime format of its files' names; what it leaves out shares a file.
        file_span: the longest time in one file.
    """

    name: str
    step_s: float
    file_name: str
    file_span: timedelta


RAW = Resolution("raw", 0.0, "%Y-%m-%dT%H", timedelta(hours=1))
MINUTE = Resolution("minute", 60.0, "%Y-%m-%d", timedelta(days=1))
HOUR = Resolution("hour", 3600.0, "%Y", timedelta(days=366))


class Tier(Protocol):
    """A table of rows by time."""

    resolution: Resolution

    def read(self, start_s: float, end_s: float) -> Rows:
        """Rows that begin in [start_s, end_s), by time."""
        ...

    def replace(self, start_s: float, end_s: float, rows: Rows) -> None:
        """Let `rows`, all inside [start_s, end_s), take the place of what is there."""
        ...


class MemoryTier:
    """The newest `capacity` rows, in memory."""

    def __init__(self, resolution: Resolution, capacity: int) -> None:
        self.resolution = resolution
        self._capacity = capacity
        self._rows = no_rows()

    def read(self, start_s: float, end_s: float) -> Rows:
        """Rows that begin in [start_s, end_s), by time."""
        return self._rows.between(start_s, end_s)

    def replace(self, start_s: float, end_s: float, rows: Rows) -> None:
        """Let `rows` take the place of what is in [start_s, end_s); the oldest make room."""
        kept = in_order(joined([_outside(self._rows, start_s, end_s), rows]))
        excess = len(kept) - self._capacity
        self._rows = kept.take(np.arange(excess, len(kept))) if excess > 0 else kept


class FileTier:
    """Rows in Parquet files, each whole; those read last are kept decoded."""

    def __init__(self, resolution: Resolution, folder: Path) -> None:
        self.resolution = resolution
        self._folder = folder / resolution.name
        self._cache: OrderedDict[Path, Rows] = OrderedDict()

    def read(self, start_s: float, end_s: float) -> Rows:
        """Rows that begin in [start_s, end_s), by time. Raises OSError."""
        parts = [self._read(path) for path in self._paths(start_s, end_s) if path.exists()]
        return joined(parts).between(start_s, end_s)

    def replace(self, start_s: float, end_s: float, rows: Rows) -> None:
        """Let `rows` take the place of what is in [start_s, end_s), file by file. OSError."""
        for path in self._paths(start_s, end_s):
            old = self._read(path) if path.exists() else no_rows()
            mine = np.array([self._path(time_s) == path for time_s in rows.time_s], bool)
            new = in_order(joined([_outside(old, start_s, end_s), rows.take(mine)]))
            if len(new):
                write_rows(path, new)
            self._cache.pop(path, None)

    def _paths(self, start_s: float, end_s: float) -> Iterator[Path]:
        """Files that may hold rows of [start_s, end_s), in order."""
        if self._many(start_s, end_s):
            first, last = self._path(start_s).name, self._path(end_s).name
            yield from sorted(p for p in self._folder.glob("*.parquet") if first <= p.name <= last)
            return
        seen = None
        step_s = self.resolution.file_span.total_seconds()
        for time_s in (*np.arange(start_s, end_s, step_s), np.nextafter(end_s, 0.0)):
            path = self._path(float(time_s))
            if path != seen:
                yield path
            seen = path

    def _many(self, start_s: float, end_s: float) -> bool:
        """Tell whether listing the folder is cheaper than asking for every name."""
        return end_s - start_s > 50 * self.resolution.file_span.total_seconds()

    def _path(self, time_s: float) -> Path:
        moment = datetime.fromtimestamp(time_s, UTC)
        return self._folder / f"{moment.strftime(self.resolution.file_name)}.parquet"

    def _read(self, path: Path) -> Rows:
        rows = self._cache.pop(path, None)
        if rows is None:
            rows = read_rows(path)
        self._cache[path] = rows
        while len(self._cache) > 1 and sum(map(len, self._cache.values())) > _CACHED_ROWS:
            self._cache.popitem(last=False)
        return rows


def _outside(rows: Rows, start_s: float, end_s: float) -> Rows:
    return rows.take((rows.time_s < start_s) | (rows.time_s >= end_s))
