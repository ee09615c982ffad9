"""The history of one axis: new estimates in, buckets of any span out."""

import threading
from collections import deque
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...messages.estimate import PreloadEstimate
from .buckets import Bucket, buckets
from .record import NAN, RECORD_BYTES, record_of, rows_of
from .rows import Rows, aggregate, joined, no_rows
from .segment import SegmentLog
from .tier import HOUR, MINUTE, RAW, FileTier, MemoryTier, Resolution, Tier

_HOUR_S = HOUR.step_s
_MOST_OPEN_RECORDS = 200_000
_MEMORY_ROWS = {RAW: 40_000, MINUTE: 10_080, HOUR: 43_800}
"""Without a folder: an hour of estimates, a week of minutes, five years of hours."""


class AxisArchive:
    """Estimates of one axis, at three resolutions.

    New estimates go to a log; when an hour is over it is compacted: the estimates themselves, one
    row per minute and one per hour, each tier in files of its own. Compacting twice, as after a
    crash between the files, gives the same files as once.

    `append` never waits and may be called from an event loop; everything else may be called from
    any thread and takes turns.

    Args:
        folder: Where the axis' files live; None keeps everything in memory, in bounded size.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._lock = threading.Lock()
        self._pending: deque[bytes] = deque(maxlen=_MOST_OPEN_RECORDS)
        self._log = None if folder is None else SegmentLog(folder / "open.log")
        self.cut_bytes = 0 if self._log is None else self._log.cut_bytes
        """Bytes of the log that a crash had damaged."""
        self._open = bytearray() if self._log is None else bytearray(self._log.content)
        self._open_rows = no_rows()
        self._converted = 0
        self._raw, self._minute, self._hour = (_tier(each, folder) for each in (RAW, MINUTE, HOUR))

    def append(self, time_ns: int, estimate: PreloadEstimate, temperature_c: float = NAN) -> None:
        """Take an estimate in; it is on disk after the next `flush`."""
        self._pending.append(record_of(time_ns, estimate, temperature_c))

    def flush(self, *, sync: bool = False) -> bool:
        """Write what was taken in, and compact when an hour is over; whether it was. OSError."""
        with self._lock:
            self._drain(sync=sync)
            over = self._an_hour_is_over()
            if over:
                self._compact()
            return over

    def rows(self, start_s: float, end_s: float, finest_step_s: float) -> Rows:
        """Rows of [start_s, end_s) whose own steps are no longer than `finest_step_s`.

        Where the finer rows have made room already, coarser ones stand in. Raises OSError.
        """
        with self._lock:
            self._drain()
            tiers: list[Tier] = [self._raw, self._minute, self._hour]
            fine = [tier for tier in tiers if tier.resolution.step_s <= finest_step_s]
            closed = _filled(start_s, end_s, fine[-1], tiers[len(fine) :])
            return joined([closed, self._newest().between(start_s, end_s)])

    def buckets(self, start_s: float, end_s: float, step_s: float) -> tuple[Bucket, ...]:
        """Buckets of [start_s, end_s) that hold estimates, oldest first; empty ones are left out.

        Args:
            start_s, end_s: UNIX times, s.
            step_s: Length of a bucket, s. From a minute on, buckets are made of whole minutes, and
                from an hour on of whole hours: each belongs to the bucket in which it begins.
        """
        return buckets(aggregate(self.rows(start_s, end_s, step_s), start_s, step_s))

    def _drain(self, *, sync: bool = False) -> None:
        new = b"".join(self._pending.popleft() for _ in range(len(self._pending)))
        self._open += new  # first: if the log cannot be written, they are kept until compaction
        if self._log is not None and (new or sync):
            self._log.append(new, sync=sync)

    def _newest(self) -> Rows:
        """Rows of the log."""
        if self._converted < len(self._open):
            self._open_rows = joined([self._open_rows, rows_of(self._open[self._converted :])])
            self._converted = len(self._open)
        return self._open_rows

    def _an_hour_is_over(self) -> bool:
        if len(self._open) > _MOST_OPEN_RECORDS * RECORD_BYTES:
            return True
        ends = bytes(self._open[:RECORD_BYTES] + self._open[-RECORD_BYTES:])
        return len(ends) > 0 and np.unique(np.floor(rows_of(ends).time_s / _HOUR_S)).size > 1

    def _compact(self) -> None:
        rows = rows_of(self._open)
        hours = np.floor(rows.time_s / _HOUR_S)
        for hour in np.unique(hours):
            self._compact_hour(float(hour) * _HOUR_S, rows.take(hours == hour))
        if self._log is not None:
            self._log.clear()
        self._open, self._open_rows, self._converted = bytearray(), no_rows(), 0

    def _compact_hour(self, start_s: float, rows: Rows) -> None:
        end_s = start_s + _HOUR_S
        known, before = self._raw.read(start_s, end_s), self._minute.read(start_s, end_s)
        fresh = rows.take(~np.isin(rows.time_s, known.time_s))
        whole = joined([known, fresh])
        made_room = int(before.samples.sum()) > len(known)
        minutes = aggregate(joined([before, fresh]) if made_room else whole, start_s, 60.0)
        self._raw.replace(start_s, end_s, whole)
        self._minute.replace(start_s, end_s, minutes)
        self._hour.replace(start_s, end_s, aggregate(minutes, start_s, _HOUR_S))


def _tier(resolution: Resolution, folder: Path | None) -> Tier:
    if folder is None:
        return MemoryTier(resolution, _MEMORY_ROWS[resolution])
    return FileTier(resolution, folder)


def _filled(start_s: float, end_s: float, tier: Tier, coarser: Sequence[Tier]) -> Rows:
    """Rows of a tier, with those of coarser ones for the time before its oldest."""
    rows = tier.read(start_s, end_s)
    for other in coarser:
        oldest_s = float(rows.time_s[0]) if len(rows) else end_s
        step_s = other.resolution.step_s
        until_s = np.floor(oldest_s / step_s) * step_s
        if until_s > start_s:
            rows = joined([other.read(start_s, until_s), rows])
    return rows
