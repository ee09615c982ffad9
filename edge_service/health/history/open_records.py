"""Records that are not compacted yet: in memory, and on disk as soon as that can be written."""

from collections import deque
from collections.abc import Callable
from pathlib import Path

from ...messages.samples import Floats
from .record import RECORD_BYTES, rows_of, steps_of
from .record_room import RecordRoom
from .rows import Rows
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
        self._records = RecordRoom()

    def append(self, record: bytes) -> None:
        """Take a record in."""
        self.lost += len(self._pending) == self._pending.maxlen
        self._pending.append(record)

    def open(self) -> None:
        """Go on from the log of the last run, once. Raises OSError."""
        if self._log is not None and not self._is_open:
            self._records.replace(self._log.open() + bytes(self._records.view()))
            self._is_open = True

    def rows(self, start_s: float, end_s: float) -> Rows:
        """Those of [start_s, end_s), by time."""
        self._take()
        return rows_of(self._records.view(), start_s, end_s)

    def hours(self) -> Floats:
        """UNIX times of the beginnings of their hours, s, in order."""
        self._take()
        return steps_of(self._records.view(), HOUR_S)

    def write(self, *, sync: bool = False) -> None:
        """Bring the log up to date. Raises OSError: what is missing is written next time."""
        self._take()
        if self._log is not None:
            self.open()
            self._log.write(self._records.view(), sync=sync)

    def an_hour_is_over(self) -> bool:
        """Tell whether they are of more than one hour, or too many."""
        if len(self._records) > MOST_RECORDS * RECORD_BYTES:
            return True
        records = self._records.view()
        ends = bytes(records[:RECORD_BYTES]) + bytes(records[-RECORD_BYTES:])
        return steps_of(ends, HOUR_S).size > 1

    def clear(self) -> None:
        """Forget those that were taken: they are kept elsewhere by now. Raises OSError."""
        if self._log is not None:
            self._log.clear()
        self._records.replace(b"")

    def make_room(self) -> None:
        """Take the new ones in; the oldest go where there are far too many and no file for them."""
        self._take()
        excess = len(self._records) // RECORD_BYTES - MOST_RECORDS * 5 // 4
        if excess <= 0:
            return
        excess += MOST_RECORDS // 4
        self._tell(f"{excess} estimates are lost: for hours no file could take them")
        self.lost += excess
        self._records.replace(bytes(self._records.view()[excess * RECORD_BYTES :]))
        if self._log is not None:
            self._log.rewrite()

    def _take(self) -> None:
        self._records.extend(b"".join(self._pending.popleft() for _ in range(len(self._pending))))
