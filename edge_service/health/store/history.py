"""History of the axes in three resolutions: seconds, minutes and hours.

Estimates are kept within a second of their coming, in the table of the open hour. When an hour is
over, they become a compressed chunk of its seconds, and rows in the chunks of the day's minutes and
of the month's hours, all in one transaction.
"""

import logging
import math
import sqlite3
import threading
import zlib
from collections import deque
from collections.abc import Iterable, Iterator
from typing import IO, Any, Literal
from zlib import crc32

import numpy as np

from ...messages.estimate import PreloadEstimate
from .rows import (
    NAN,
    NO_ROWS,
    QUANTITIES,
    STATUSES,
    Bucket,
    Rows,
    aggregate,
    between,
    buckets,
    filled,
    joined,
    packed,
    record_of,
    rows_of,
    unpacked,
)
from .store import Store

log = logging.getLogger(__name__)
SCHEMA = """
CREATE TABLE IF NOT EXISTS history (
    axis TEXT NOT NULL, step_s INTEGER NOT NULL, start_s INTEGER NOT NULL, rows BLOB NOT NULL,
    digest INTEGER NOT NULL, PRIMARY KEY (axis, step_s, start_s)
);
CREATE TABLE IF NOT EXISTS open_hour (
    id INTEGER PRIMARY KEY, axis TEXT NOT NULL, hour_s INTEGER NOT NULL, rows BLOB NOT NULL,
    digest INTEGER NOT NULL
);
CREATE INDEX IF NOT EXISTS open_hour_by_axis ON open_hour (axis, hour_s);
"""
HOUR_S = 3600
DAY_S = 24 * HOUR_S
CHUNKS_S = {1: HOUR_S, 60: DAY_S, HOUR_S: 30 * DAY_S}
"""Length of what is kept as one, s, by the step of its rows, s."""
MOST_WAITING = 36_000
"""Estimates of an axis, an hour of them, that wait for a disk that takes nothing."""
MEMORY_MB = 64.0
"""Budget where the store lives in memory."""
_GREATEST = 2**62
_PAGES = ("page_count", "freelist_count", "page_size")
_OVER = "SELECT axis, hour_s FROM open_hour WHERE hour_s <> ? LIMIT 1"
_OLDEST = """SELECT axis, step_s, start_s FROM history WHERE step_s < ?
ORDER BY step_s, start_s <= ?, start_s LIMIT 1"""
FUTURE_S = 86_400.0
"""Lead over the clock from which on a row was written while the clock was wrong, s."""


class History:
    """Estimates of all axes.

    `append` never waits and may be called from an event loop; all else is for any thread. Where the
    file grows beyond the budget, the oldest seconds make room first, then minutes.
    """

    def __init__(self, store: Store, budget_mb: float = MEMORY_MB) -> None:
        self._store = store
        store.define(SCHEMA)
        self._budget_bytes = budget_mb * 1e6
        self._lock, self._flushing = threading.Lock(), threading.Lock()
        self._waiting: dict[str, deque[bytes]] = {}
        self._is_new = True
        self.lost = 0
        """Estimates that found no place."""

    def append(
        self, axis: str, time_ns: int, estimate: PreloadEstimate, temperature_c: float = NAN
    ) -> None:
        """Take an estimate in; it is on the disk after the next `flush`."""
        record = record_of(time_ns, estimate, temperature_c)
        with self._lock:
            waiting = self._waiting.setdefault(axis, deque(maxlen=MOST_WAITING))
            self.lost += len(waiting) == MOST_WAITING
            waiting.append(record)

    def flush(self, now_s: float) -> None:
        """Write what was taken in, and make chunks of one axis' hour that is over.

        Raises StoreFailedError: nothing is lost, and the next call tries again.
        """
        with self._flushing:
            with self._lock:
                taken = {axis: tuple(each) for axis, each in self._waiting.items() if each}
            if taken:
                self._store.write(lambda file: _put_open(file, taken))
            with self._lock:
                for axis, records in taken.items():
                    waiting = self._waiting[axis]
                    for _ in range(min(len(records), len(waiting))):
                        waiting.popleft()
            hour_s = int(now_s // HOUR_S) * HOUR_S
            over = self._store.read(lambda file: file.execute(_OVER, (hour_s,)).fetchone())
            if over is not None:
                self._store.write(lambda file: self._compact(file, *over))
            if over is not None or self._is_new:
                self._make_room(now_s)
                self._is_new = False

    def rows(self, axis: str, start_s: float, end_s: float, finest_step_s: float) -> Rows:
        """Rows that begin in [start_s, end_s), of steps no longer than `finest_step_s`, by time.

        Where the finer rows have made room already, or were damaged, coarser ones stand in; those
        of the open hour are seconds. Raises StoreFailedError.
        """
        fine = [step_s for step_s in CHUNKS_S if step_s <= finest_step_s]
        steps_s = [step_s for step_s in CHUNKS_S if step_s >= max(fine, default=1)]
        start_s, end_s = max(start_s, -_GREATEST), min(end_s, _GREATEST)

        def work(file: sqlite3.Connection) -> tuple[list[Rows], bytes]:
            tiers = [self._chunks(file, axis, step_s, start_s, end_s) for step_s in steps_s]
            return tiers, self._records(file, axis, start_s, end_s)

        with self._flushing:  # else the same may be found here and in the file
            with self._lock:
                waiting = b"".join(self._waiting.get(axis, ()))
            tiers, records = self._store.read(work)
        fresh = between(aggregate(rows_of(records + waiting), 1.0), start_s, end_s)
        return joined(filled(tiers, steps_s), fresh)

    def buckets(self, axis: str, start_s: float, end_s: float, step_s: float) -> tuple[Bucket, ...]:
        """Buckets of [start_s, end_s) that hold estimates, oldest first; empty ones are left out.

        Args:
            start_s, end_s: UNIX times, s.
            step_s: Length of a bucket, s. Buckets are made of whole seconds, from a minute on of
                whole minutes, and from an hour on of whole hours: each belongs to the bucket in
                which it begins.

        Raises StoreFailedError.
        """
        return buckets(aggregate(self.rows(axis, start_s, end_s, step_s), step_s, start_s))

    def axes(self) -> list[str]:
        """Axes of which anything is kept. Raises StoreFailedError."""
        kept = "SELECT axis FROM history UNION SELECT axis FROM open_hour ORDER BY axis"
        rows = self._store.read(lambda file: file.execute(kept).fetchall())
        return [axis for (axis,) in rows]

    def spans(self, axis: str, start_s: float = -np.inf, end_s: float = np.inf) -> Iterator[Rows]:
        """All rows of [start_s, end_s) as fine as they are kept, by time, an hour at once.

        Raises StoreFailedError.
        """
        chunks = "SELECT step_s, start_s FROM history WHERE axis = :axis"
        found = f"{chunks} UNION SELECT 1, hour_s FROM open_hour WHERE axis = :axis"
        starts = self._store.read(lambda file: file.execute(found, {"axis": axis}).fetchall())
        with self._lock:
            waiting = rows_of(b"".join(self._waiting.get(axis, ())))
        starts += [(1, int(each) // 1_000_000) for each in waiting["time_us"]]
        hours = {
            at_s // HOUR_S * HOUR_S
            for step_s, first_s in starts
            for at_s in range(first_s, first_s + CHUNKS_S.get(step_s, 0), HOUR_S)
        }
        for hour_s in sorted(hours):
            first, last = max(hour_s, start_s), min(hour_s + HOUR_S, end_s)
            rows = self.rows(axis, first, last, 1.0) if first < last else NO_ROWS
            if rows.size:
                yield rows

    def _compact(self, file: sqlite3.Connection, axis: str, hour_s: int) -> None:
        """Make chunks of an hour of the open table, beside what is known of that hour already."""
        end_s = hour_s + HOUR_S
        seconds = self._chunks(file, axis, 1, hour_s, end_s)
        minutes = self._chunks(file, axis, 60, hour_s, end_s)
        fresh = rows_of(self._records(file, axis, hour_s, end_s))
        rows = aggregate(joined(seconds, fresh), 1.0)
        has_all = seconds["samples"].sum() >= minutes["samples"].sum()
        minutes = aggregate(rows if has_all else joined(minutes, fresh), 60.0)
        hours = aggregate(minutes, HOUR_S)
        for step_s, made in zip(CHUNKS_S, (rows, minutes, hours), strict=True):
            chunk_s = hour_s // CHUNKS_S[step_s] * CHUNKS_S[step_s]
            known = self._chunks(file, axis, step_s, chunk_s, chunk_s + CHUNKS_S[step_s])
            before, after = between(known, -math.inf, hour_s), between(known, end_s, math.inf)
            put_chunk(file, axis, step_s, chunk_s, joined(before, made, after))
        file.execute("DELETE FROM open_hour WHERE axis = ? AND hour_s = ?", (axis, hour_s))

    def _chunks(
        self, file: sqlite3.Connection, axis: str, step_s: int, start_s: float, end_s: float
    ) -> Rows:
        """Rows of one resolution that begin in [start_s, end_s), by time."""
        wanted = """SELECT axis, step_s, start_s, rows, digest FROM history
        WHERE axis = ? AND step_s = ? AND start_s > ? AND start_s < ? ORDER BY start_s"""
        span = (start_s - CHUNKS_S[step_s], end_s)
        parts = []
        for *place, content, digest in file.execute(wanted, (axis, step_s, *span)):
            try:
                if digest != _digest(content, *place):
                    raise ValueError("its checksum is wrong")
                parts.append(unpacked(content))
            except (ValueError, zlib.error) as error:
                self._note_damage(f"history of axis {axis}, from {place[2]} s on: {error}")
        return between(joined(*parts), start_s, end_s)

    def _records(self, file: sqlite3.Connection, axis: str, start_s: float, end_s: float) -> bytes:
        """Rows of the open table, of hours that meet [start_s, end_s), without damaged ones."""
        found = """SELECT hour_s, rows, digest FROM open_hour
        WHERE axis = ? AND hour_s > ? AND hour_s < ? ORDER BY id"""
        good = []
        for hour, content, digest in file.execute(found, (axis, start_s - HOUR_S, end_s)):
            if digest != _digest(content, axis, hour):
                self._note_damage(f"history of axis {axis}: estimates of a second are damaged")
            else:
                good.append(content)
        return b"".join(good)

    def _note_damage(self, words: str) -> None:
        if words not in self._store.damages:
            log.warning("%s; left out", words)
            self._store.damages.append(words)

    def _make_room(self, now_s: float) -> None:
        """Remove seconds, then minutes, the oldest and those of the future first, to the budget."""

        def remove(file: sqlite3.Connection) -> bool:
            oldest = file.execute(_OLDEST, (HOUR_S, now_s + FUTURE_S)).fetchone()
            if oldest is not None:
                gone = "DELETE FROM history WHERE axis = ? AND step_s = ? AND start_s = ?"
                file.execute(gone, oldest)
            return oldest is not None

        is_more = True
        while is_more and self._store.read(_used_bytes) > self._budget_bytes:
            is_more = self._store.write(remove)


def put_chunk(file: sqlite3.Connection, axis: str, step_s: int, chunk_s: int, rows: Rows) -> None:
    """Write all rows of a chunk, which begins at UNIX time `chunk_s`, in the place of an older."""
    content, place = packed(rows), (axis, step_s, chunk_s)
    row = (*place, content, _digest(content, *place))
    file.execute("INSERT OR REPLACE INTO history VALUES (?, ?, ?, ?, ?)", row)


def _put_open(file: sqlite3.Connection, taken: dict[str, tuple[bytes, ...]]) -> None:
    for axis, each in taken.items():
        rows = aggregate(rows_of(b"".join(each)), 1.0)
        hours = rows["time_us"] // (HOUR_S * 1_000_000) * HOUR_S
        for hour_s in np.unique(hours).tolist():
            content = rows[hours == hour_s].tobytes()
            row = (axis, hour_s, content, _digest(content, axis, hour_s))
            insert = "INSERT INTO open_hour (axis, hour_s, rows, digest) VALUES (?, ?, ?, ?)"
            file.execute(insert, row)


def _used_bytes(file: sqlite3.Connection) -> int:
    pages, free, size = (file.execute(f"PRAGMA {each}").fetchone()[0] for each in _PAGES)
    return int((pages - free) * size)


def _digest(content: bytes, *place: object) -> int:
    return crc32(content, crc32(" ".join(map(str, place)).encode()))


HistoryForm = Literal["csv", "parquet"]
"""Form of a file."""


def write_history(
    sink: IO[bytes],
    form: HistoryForm,
    history: History,
    axes: Iterable[str],
    start_s: float = -np.inf,
    end_s: float = np.inf,
) -> int:
    """Write all rows of axes in [start_s, end_s), oldest first; returns their number.

    Columns: axis, time, status, samples (estimates of a second, minute or hour), low, high, and of
    each quantity the mean; empty where there was none. Raises StoreFailedError.
    """
    from pyarrow import csv, parquet  # 40 MB that only who asks for files needs

    count, empty = 0, _table("", NO_ROWS, form)
    writer: Any = (
        parquet.ParquetWriter(sink, empty.schema, compression="zstd")
        if form == "parquet"
        else csv.CSVWriter(sink, empty.schema)
    )
    with writer:
        for axis in axes:
            for rows in history.spans(axis, start_s, end_s):
                writer.write_table(_table(axis, rows, form))
                count += rows.size
    return count


def _table(axis: str, rows: Rows, form: HistoryForm) -> Any:
    """Rows as an Arrow table, NaN as null; times of CSV as RFC 3339."""
    import pyarrow as pa
    from pyarrow import compute

    names = np.array([each.value for each in STATUSES], object)
    time = pa.array(rows["time_us"], pa.timestamp("us", "UTC"))
    if form == "csv":
        time = compute.strftime(time, "%Y-%m-%dT%H:%M:%SZ")
    columns = {
        "axis": pa.array([axis] * rows.size, pa.string()),
        "time": time,
        "status": pa.array(names[rows["status"]], pa.string()),
        "samples": pa.array(rows["samples"], pa.int64()),
        "low": pa.array(rows["bounds"][:, 0], pa.float64(), from_pandas=True),
        "high": pa.array(rows["bounds"][:, 1], pa.float64(), from_pandas=True),
    }
    for name, values in zip(QUANTITIES, rows["values"][:, 1].T, strict=True):
        columns[name] = pa.array(values, pa.float64(), from_pandas=True)
    return pa.table(columns)
