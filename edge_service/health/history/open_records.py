"""Records that are not compacted yet: in memory, and on disk as soon as that can be written."""

from collections import deque
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ...messages.samples import Floats
from .record import RECORD_BYTES, rows_of
from .rows import Rows, joined, no_rows
from .segment import SegmentLog

HOUR_S = 3600.0
MOST_RECORDS = 100_000
"""More are compacted though their hour is not over; where that fails, the oldest go."""


class OpenRecords:
    """Records of one axis since the last compaction.

    `append` never waits; everything else is for one thread at a time.

    Args:
        path: of the log; None keeps them in memory.
        tell: takes a sentence on damage.
    """

    def __init__(self, path: Path | None, tell: Callable[[str], None]) -> None:
        self.lost = 0
        """Number of records that found no place."""
        self._tell = tell
        self._pending: deque[bytes] = deque(maxlen=MOST_RECORDS)
        self._log = None if path is None else SegmentLog(path, tell)
        self._is_open = path is None
        self._records = bytearray()
        self._rows = no_rows()
        self._converted = 0

    def append(self, record: bytes) -> None:
        """Take a record in."""
        self.lost += len(self._pending) == self._pending.maxlen
        self._pending.append(record)

    def open(self) -> None:
        """Go on from the log of the last run, once. Raises OSError."""
        if self._log is not None and not self._is_open:
            self._records = bytearray(self._log.open()) + self._records
            self._forget_rows()
            self._is_open = True

    def rows(self) -> Rows:
        """All of them, by time as far as they came so."""
        self._take()
        if self._converted < len(self._records):
            self._rows = joined([self._rows, rows_of(self._records[self._converted :])])
            self._converted = len(self._records)
        return self._rows

    def hours(self) -> Floats:
        """UNIX times of the beginnings of their hours, s, in order."""
        hours: Floats = np.unique(np.floor(self.rows().time_s / HOUR_S)) * HOUR_S
        return hours

    def write(self, *, sync: bool = False) -> None:
        """Bring the log up to date. Raises OSError: what is missing is written next time."""
        self._take()
        if self._log is not None:
            self.open()
            self._log.write(self._records, sync=sync)

    def an_hour_is_over(self) -> bool:
        """Tell whether they are of more than one hour, or too many."""
        if len(self._records) > MOST_RECORDS * RECORD_BYTES:
            return True
        ends = bytes(self._records[:RECORD_BYTES] + self._records[-RECORD_BYTES:])
        return len(ends) > 0 and np.unique(np.floor(rows_of(ends).time_s / HOUR_S)).size > 1

    def clear(self) -> None:
        """Forget those that were taken: they are kept elsewhere by now. Raises OSError."""
        if self._log is not None:
            self._log.clear()
        self._records.clear()
        self._forget_rows()

    def make_room(self) -> None:
        """Take the new ones in; the oldest go where there are far too many and no file for them."""
        self._take()
        excess = len(self._records) // RECORD_BYTES - MOST_RECORDS * 5 // 4
        if excess <= 0:
            return
        excess += MOST_RECORDS // 4
        self._tell(f"{excess} estimates are lost: for hours no file could take them")
        self.lost += excess
        del self._records[: excess * RECORD_BYTES]
        self._forget_rows()
        if self._log is not None:
            self._log.rewrite()

    def _take(self) -> None:
        self._records += b"".join(self._pending.popleft() for _ in range(len(self._pending)))

    def _forget_rows(self) -> None:
        self._rows, self._converted = no_rows(), 0
