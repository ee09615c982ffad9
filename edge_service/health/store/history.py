"""History of the axes in three resolutions: estimates, minutes and hours.

New estimates are kept as they come, in the table of the open hour. When an hour is over, they
become one compressed chunk of single estimates, and rows in the chunks of the day's minutes and of
the month's hours, all in one transaction.
"""

import logging
import math
import sqlite3
import threading
import zlib
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from zlib import crc32

import numpy as np
import numpy.typing as npt

from ...clock import FUTURE_S
from ...messages.estimate import PreloadEstimate
from .rows import (
    NAN,
    SINGLE,
    SPAN,
    Bucket,
    Rows,
    aggregate,
    buckets,
    filled,
    in_order,
    joined,
    no_rows,
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
CREATE TABLE IF NOT EXISTS open_history (
    id INTEGER PRIMARY KEY, axis TEXT NOT NULL, hour_s INTEGER NOT NULL, rows BLOB NOT NULL,
    digest INTEGER NOT NULL
);
CREATE INDEX IF NOT EXISTS open_history_by_axis ON open_history (axis, hour_s);
"""
HOUR_S = 3600
MOST_WAITING = 36_000
"""Estimates of an axis, an hour of them, that wait for a disk that takes nothing."""
MEMORY_MB = 64.0
"""Budget where the store lives in memory."""
_GREATEST = 2**62
_OVER = "SELECT axis, hour_s FROM open_history WHERE hour_s <> ? LIMIT 1"
_OLDEST = """SELECT axis, step_s, start_s FROM history WHERE step_s < ?
ORDER BY step_s, start_s <= ?, start_s LIMIT 1"""


@dataclass(frozen=True, slots=True)
class Resolution:
    """Rows of one step.

    Attributes:
        step_s: 0 for single estimates.
        chunk_s: length of what is kept as one, s.
        record: of a row.
    """

    step_s: int
    chunk_s: int
    record: npt.DTypeLike


RAW = Resolution(0, HOUR_S, SINGLE)
MINUTE = Resolution(60, 24 * HOUR_S, SPAN)
HOUR = Resolution(HOUR_S, 30 * 24 * HOUR_S, SPAN)
RESOLUTIONS = (RAW, MINUTE, HOUR)


class History:
    """Estimates of all axes.

    `append` never waits and may be called from an event loop; all else is for any thread.

    Args:
        budget_mb: greatest size of the file; the oldest estimates make room first, then minutes.
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
        """Rows of [start_s, end_s) whose own steps are no longer than `finest_step_s`, by time.

        Where the finer rows have made room already, or were damaged, coarser ones stand in; those
        of the open hour are single estimates. Raises StoreFailedError.
        """
        fine = sum(each.step_s <= finest_step_s for each in RESOLUTIONS)
        wanted = RESOLUTIONS[max(fine - 1, 0) :]
        start_s, end_s = max(start_s, -_GREATEST), min(end_s, _GREATEST)

        def work(file: sqlite3.Connection) -> tuple[list[Rows], bytes]:
            tiers = [self._chunks(file, axis, each, start_s, end_s) for each in wanted]
            return tiers, self._open_records(file, axis)

        with self._lock:
            waiting = b"".join(self._waiting.get(axis, ()))
        tiers, open_records = self._store.read(work)
        known = filled(tiers, [each.step_s for each in wanted])
        fresh = rows_of(open_records + waiting).between(start_s, end_s)
        if wanted[0] is RAW:
            fresh = fresh.take(~np.isin(fresh.time_s, known.time_s))
        return in_order(joined([known, fresh]))

    def buckets(self, axis: str, start_s: float, end_s: float, step_s: float) -> tuple[Bucket, ...]:
        """Buckets of [start_s, end_s) that hold estimates, oldest first; empty ones are left out.

        Args:
            start_s, end_s: UNIX times, s.
            step_s: Length of a bucket, s. From a minute on, buckets are made of whole minutes, and
                from an hour on of whole hours: each belongs to the bucket in which it begins.

        Raises StoreFailedError.
        """
        rows = self.rows(axis, start_s, end_s, step_s)
        return buckets(aggregate(rows, start_s, step_s))

    def axes(self) -> list[str]:
        """Axes of which anything is kept. Raises StoreFailedError."""
        kept = "SELECT axis FROM history UNION SELECT axis FROM open_history ORDER BY axis"
        rows = self._store.read(lambda file: file.execute(kept).fetchall())
        return [axis for (axis,) in rows]

    def spans(
        self, axis: str, start_s: float = -math.inf, end_s: float = math.inf
    ) -> Iterator[Rows]:
        """All rows of [start_s, end_s) as fine as they are kept, by time, an hour or a day at once.

        Raises StoreFailedError.
        """
        chunks = "SELECT step_s, start_s FROM history WHERE axis = :axis"
        hours = "SELECT DISTINCT 0, hour_s FROM open_history WHERE axis = :axis"
        found = f"{chunks} UNION {hours}"
        starts = self._store.read(lambda file: file.execute(found, {"axis": axis}).fetchall())
        with self._lock:
            waiting = np.frombuffer(b"".join(self._waiting.get(axis, ())), SINGLE)
        hours_s = np.unique(waiting["time_us"] // (HOUR_S * 1_000_000)) * HOUR_S
        starts += [(RAW.step_s, hour_s) for hour_s in hours_s.tolist()]
        lengths_s = {each.step_s: each.chunk_s for each in RESOLUTIONS}
        fine = {start_s for step_s, start_s in starts if step_s == RAW.step_s}
        days = {
            at_s // MINUTE.chunk_s * MINUTE.chunk_s
            for step_s, first_s in starts
            for at_s in range(first_s, first_s + lengths_s[step_s], HOUR_S)
        }
        for day_s in sorted(days):
            is_fine = any(hour_s in fine for hour_s in range(day_s, day_s + MINUTE.chunk_s, HOUR_S))
            step_s = HOUR_S if is_fine else MINUTE.chunk_s
            for first_s in range(day_s, day_s + MINUTE.chunk_s, step_s):
                span = max(first_s, start_s), min(first_s + step_s, end_s)
                rows = self.rows(axis, *span, 0.0) if span[0] < span[1] else no_rows()
                if len(rows):
                    yield rows

    def _compact(self, file: sqlite3.Connection, axis: str, hour_s: int) -> None:
        """Make chunks of an hour of the open table, beside what is known of that hour already."""
        end_s = hour_s + HOUR_S
        single = self._chunks(file, axis, RAW, hour_s, end_s)
        minutes = self._chunks(file, axis, MINUTE, hour_s, end_s)
        fresh = rows_of(self._open_records(file, axis, hour_s))
        fresh = fresh.take(~np.isin(fresh.time_s, single.time_s))
        rows = in_order(joined([single, fresh]))
        has_all = len(single) >= int(minutes.samples.sum())
        minutes = aggregate(rows if has_all else joined([minutes, fresh]), hour_s, 60.0)
        self.replace(file, axis, RAW, rows, hour_s, end_s)
        self.replace(file, axis, MINUTE, minutes, hour_s, end_s)
        self.replace(file, axis, HOUR, aggregate(minutes, hour_s, HOUR_S), hour_s, end_s)
        file.execute("DELETE FROM open_history WHERE axis = ? AND hour_s = ?", (axis, hour_s))

    def replace(
        self,
        file: sqlite3.Connection,
        axis: str,
        resolution: Resolution,
        rows: Rows,
        start_s: int,
        end_s: int,
    ) -> None:
        """Let rows take the place of what the chunk holds of [start_s, end_s)."""
        chunk_s = start_s // resolution.chunk_s * resolution.chunk_s
        known = self._chunks(file, axis, resolution, chunk_s, chunk_s + resolution.chunk_s)
        others = known.take((known.time_s < start_s) | (known.time_s >= end_s))
        content = packed(in_order(joined([others, rows])), resolution.record)
        place = (axis, resolution.step_s, chunk_s)
        row = (*place, content, _digest(content, *place))
        file.execute("INSERT OR REPLACE INTO history VALUES (?, ?, ?, ?, ?)", row)

    def _chunks(
        self,
        file: sqlite3.Connection,
        axis: str,
        resolution: Resolution,
        start_s: float,
        end_s: float,
    ) -> Rows:
        """Rows of one resolution that begin in [start_s, end_s), by time."""
        wanted = """SELECT axis, step_s, start_s, rows, digest FROM history
        WHERE axis = ? AND step_s = ? AND start_s > ? AND start_s < ? ORDER BY start_s"""
        span = (start_s - resolution.chunk_s, end_s)
        parts = [no_rows()]
        for *place, content, digest in file.execute(wanted, (axis, resolution.step_s, *span)):
            try:
                if digest != _digest(content, *place):
                    raise ValueError("its checksum is wrong")
                parts.append(unpacked(content, resolution.record))
            except (ValueError, zlib.error) as error:
                self._note_damage(f"history of axis {axis}, from {place[2]} s on: {error}")
        return joined(parts).between(start_s, end_s)

    def _open_records(
        self, file: sqlite3.Connection, axis: str, hour_s: int | None = None
    ) -> bytes:
        """Records of the open table, of one hour or all, without damaged ones."""
        found = "SELECT hour_s, rows, digest FROM open_history WHERE axis = ?"
        wanted: tuple[object, ...] = (axis,)
        if hour_s is not None:
            found, wanted = f"{found} AND hour_s = ?", (axis, hour_s)
        good = []
        for hour, content, digest in file.execute(f"{found} ORDER BY id", wanted):
            if digest == _digest(content, axis, hour):
                good.append(content)
            else:
                self._note_damage(f"history of axis {axis}: estimates of a second are damaged")
        return b"".join(good)

    def _note_damage(self, words: str) -> None:
        if words not in self._store.damages:
            log.warning("%s; left out", words)
            self._store.damages.append(words)

    def _make_room(self, now_s: float) -> None:
        """Remove the oldest estimates, then minutes, until the file is within its budget."""

        def remove(file: sqlite3.Connection) -> bool:
            oldest = file.execute(_OLDEST, (HOUR_S, now_s + FUTURE_S)).fetchone()
            if oldest is not None:
                gone = "DELETE FROM history WHERE axis = ? AND step_s = ? AND start_s = ?"
                file.execute(gone, oldest)
            return oldest is not None

        is_more = True
        while is_more and self._store.read(_used_bytes) > self._budget_bytes:
            is_more = self._store.write(remove)


def _put_open(file: sqlite3.Connection, taken: dict[str, tuple[bytes, ...]]) -> None:
    for axis, each in taken.items():
        records = np.frombuffer(b"".join(each), SINGLE)
        hours = records["time_us"] // (HOUR_S * 1_000_000) * HOUR_S
        for hour_s in np.unique(hours).tolist():
            content = records[hours == hour_s].tobytes()
            row = (axis, hour_s, content, _digest(content, axis, hour_s))
            insert = "INSERT INTO open_history (axis, hour_s, rows, digest) VALUES (?, ?, ?, ?)"
            file.execute(insert, row)


def _used_bytes(file: sqlite3.Connection) -> int:
    (pages,) = file.execute("PRAGMA page_count").fetchone()
    (free,) = file.execute("PRAGMA freelist_count").fetchone()
    (size,) = file.execute("PRAGMA page_size").fetchone()
    return int((pages - free) * size)


def _digest(content: bytes, *place: object) -> int:
    return crc32(content, crc32(" ".join(map(str, place)).encode()))
