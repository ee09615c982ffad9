"""Records in memory, in room taken at once: what a service takes does not rise with the hour."""

from .record import RECORD_BYTES

ROOM_BYTES = 36_000 * RECORD_BYTES
"""An hour at 10 Hz."""


class RecordRoom:
    """Records one after the other; the room grows only where it has to."""

    def __init__(self) -> None:
        self._room = _taken(ROOM_BYTES)
        self._end = 0

    def __len__(self) -> int:
        """Bytes that are held."""
        return self._end

    def view(self) -> memoryview:
        """All records, until the next change."""
        return memoryview(self._room)[: self._end]

    def extend(self, records: bytes | memoryview) -> None:
        """Put records behind those that are there."""
        end = self._end + len(records)
        if end > len(self._room):
            self._room = self._room + _taken(end - len(self._room) + ROOM_BYTES // 4)
        self._room[self._end : end] = records
        self._end = end

    def replace(self, records: bytes) -> None:
        """Hold these records and no others."""
        self._end = 0
        if len(self._room) > ROOM_BYTES:
            self._room = _taken(ROOM_BYTES)
        self.extend(records)


def _taken(size: int) -> bytearray:
    """Memory that was written to: the kernel has really given it."""
    return bytearray(b"\0") * size
