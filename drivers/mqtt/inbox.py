"""Messages that wait to be read, in bounded memory."""

import asyncio
from typing import Any

MOST_WAITING = 10_000
MOST_BYTES = 1 << 26


class Inbox(asyncio.Queue[Any]):
    """A queue that leaves out what is too large, and drops the oldest where there is no room.

    Attributes:
        oversized, dropped: how many messages that were.
    """

    def __init__(self, largest_bytes: int) -> None:
        super().__init__()
        self.oversized = self.dropped = 0
        self._largest_bytes = largest_bytes
        self._bytes = 0

    def put_nowait(self, item: Any) -> None:
        """Take a message; None is the end."""
        size = _size(item)
        if size > self._largest_bytes:
            self.oversized += 1
            return
        while self.qsize() >= MOST_WAITING or (self._bytes + size > MOST_BYTES and self.qsize()):
            self.get_nowait()
            self.dropped += 1
        super().put_nowait(item)

    def _put(self, item: Any) -> None:
        self._bytes += _size(item)
        super()._put(item)

    def _get(self) -> Any:
        item = super()._get()
        self._bytes -= _size(item)
        return item


def _size(item: Any) -> int:
    return 0 if item is None else len(item.payload or b"")
