"""The log that new records go to first: append only, checked record by record."""

import os
from pathlib import Path

from .record import good_length


class SegmentLog:
    """One file of records.

    What a crash tears off at its end, or damages, is cut off when it is opened; everything before
    stays.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        content = path.read_bytes() if path.exists() else b""
        good = good_length(content)
        self.content = content[:good]
        """The good records that were there when it was opened."""
        self.cut_bytes = len(content) - good
        """Bytes that were torn or damaged."""
        if self.cut_bytes:
            os.truncate(path, good)

    def append(self, records: bytes, *, sync: bool = False) -> None:
        """Add records at the end; with `sync` they are on the disk afterwards. Raises OSError."""
        with self._path.open("ab") as file:
            file.write(records)
            if sync:
                file.flush()
                os.fsync(file.fileno())

    def clear(self) -> None:
        """Forget everything: it is kept elsewhere by now."""
        os.truncate(self._path, 0)
