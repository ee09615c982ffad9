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
from zlib import crc32

import numpy as np
import numpy.typing as npt

from ...clock import FUTURE_S
from ...messages.estimate import PreloadEstimate
from .rows import (
    NAN,
    NO_ROWS,
    SINGLE,
    SPAN,
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
CREATE TABLE IF NOT EXISTS open_history (
    id INTEGER PRIMARY KEY, axis TEXT NOT NULL, hour_s INTEGER NOT NULL, rows BLOB NOT NULL,
    digest INTEGER NOT NULL
);
CREATE INDEX IF NOT EXISTS open_history_by_axis ON open_history (axis, hour_s);
"""
HOUR_S = 3600
DAY_S = 24 * HOUR_S
CHUNKS_S = {0: HOUR_S, 60: DAY_S, HOUR_S: 30 * DAY_S}
"""Length of what is kept as one, s, by the step of its rows, s; 0: single estimates."""
MOST_WAITING = 36_000
"""Estimates of an axis, an hour of them, that wait for a disk that takes nothing."""
MEMORY_MB = 64.0
"""Budget where the store lives in memory."""
_GREATEST = 2**62
_HOUR_US = HOUR_S * 1_000_000
_OVER = "SELECT axis, hour_s FROM open_history WHERE hour_s <> ? LIMIT 1"
_OLDEST = """SELECT axis, step_s, start_s FROM history WHERE step_s < ?
ORDER BY step_s, start_s <= ?, start_s LIMIT 1"""


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
        fine = [step_s for step_s in CHUNKS_S if step_s <= finest_step_s]
        steps_s = [step_s for step_s in CHUNKS_S if step_s >= max(fine, default=0)]
        start_s, end_s = max(start_s, -_GREATEST), min(end_s, _GREATEST)

        def work(file: sqlite3.Connection) -> tuple[list[Rows], bytes]:
            tiers = [self._chunks(file, axis, step_s, start_s, end_s) for step_s in steps_s]
            return tiers, self._open_records(file, axis)

        with self._lock:
            waiting = b"".join(self._waiting.get(axis, ()))
        tiers, open_records = self._store.read(work)
        known = filled(tiers, steps_s)
        fresh = between(rows_of(open_records + waiting), start_s, end_s)
        if steps_s[0] == 0:
            fresh = _without(fresh, known)
        return joined(known, fresh)

    def buckets(self, axis: str, start_s: float, end_s: float, step_s: float) -> tuple[Bucket, ...]:
        """Buckets of [start_s, end_s) that hold estimates, oldest first; empty ones are left out.

        Args:
            start_s, end_s: UNIX times, s.
            step_s: Length of a bucket, s. From a minute on, buckets are made of whole minutes, and
                from an hour on of whole hours: each belongs to the bucket in which it begins.

        Raises StoreFailedError.
        """
        return buckets(aggregate(self.rows(axis, start_s, end_s, step_s), start_s, step_s))

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
        hours_s = np.unique(waiting["time_us"] // _HOUR_US) * HOUR_S
        starts += [(0, hour_s) for hour_s in hours_s.tolist()]
        fine = {start_s for step_s, start_s in starts if step_s == 0}
        days = {
            at_s // DAY_S * DAY_S
            for step_s, first_s in starts
            for at_s in range(first_s, first_s + CHUNKS_S[step_s], HOUR_S)
        }
        for day_s in sorted(days):
            is_fine = any(hour_s in fine for hour_s in range(day_s, day_s + DAY_S, HOUR_S))
            step_s = HOUR_S if is_fine else DAY_S
            for first_s in range(day_s, day_s + DAY_S, step_s):
                first, last = max(first_s, start_s), min(first_s + step_s, end_s)
                rows = self.rows(axis, first, last, 0.0) if first < last else NO_ROWS
                if rows.size:
                    yield rows

    def _compact(self, file: sqlite3.Connection, axis: str, hour_s: int) -> None:
        """Make chunks of an hour of the open table, beside what is known of that hour already."""
        end_s = hour_s + HOUR_S
        single = self._chunks(file, axis, 0, hour_s, end_s)
        minutes = self._chunks(file, axis, 60, hour_s, end_s)
        fresh = _without(rows_of(self._open_records(file, axis, hour_s)), single)
        rows = joined(single, fresh)
        has_all = single.size >= int(minutes["samples"].sum())
        minutes = aggregate(rows if has_all else joined(minutes, fresh), hour_s, 60.0)
        hours = aggregate(minutes, hour_s, HOUR_S)
        for step_s, made in zip(CHUNKS_S, (rows, minutes, hours), strict=True):
            chunk_s = hour_s // CHUNKS_S[step_s] * CHUNKS_S[step_s]
            known = self._chunks(file, axis, step_s, chunk_s, chunk_s + CHUNKS_S[step_s])
            before, after = between(known, -math.inf, hour_s), between(known, end_s, math.inf)
            put_chunk(file, axis, step_s, chunk_s, joined(before, made, after))
        file.execute("DELETE FROM open_history WHERE axis = ? AND hour_s = ?", (axis, hour_s))

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
                parts.append(unpacked(content, _record(step_s)))
            except (ValueError, zlib.error) as error:
                self._note_damage(f"history of axis {axis}, from {place[2]} s on: {error}")
        return between(joined(*parts), start_s, end_s)

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


def put_chunk(file: sqlite3.Connection, axis: str, step_s: int, chunk_s: int, rows: Rows) -> None:
    """Write all rows of a chunk, which begins at UNIX time `chunk_s`, in the place of an older."""
    content, place = packed(rows, _record(step_s)), (axis, step_s, chunk_s)
    row = (*place, content, _digest(content, *place))
    file.execute("INSERT OR REPLACE INTO history VALUES (?, ?, ?, ?, ?)", row)


def _record(step_s: int) -> npt.DTypeLike:
    return SINGLE if step_s == 0 else SPAN


def _without(rows: Rows, known: Rows) -> Rows:
    return rows[~np.isin(rows["time_us"], known["time_us"])]


def _put_open(file: sqlite3.Connection, taken: dict[str, tuple[bytes, ...]]) -> None:
    for axis, each in taken.items():
        records = np.frombuffer(b"".join(each), SINGLE)
        hours = records["time_us"] // _HOUR_US * HOUR_S
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
