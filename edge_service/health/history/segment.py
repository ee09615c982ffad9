"""The log that new records go to first: checked record by record, written again what failed."""

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ...atomic import (
    DamagedError,
    aside_name,
    made_folder,
    read_kept_bytes,
    replaced_bytes,
    set_aside,
    sync_folder,
)
from .record import Content, scan


class SegmentLog:
    """Image on disk of the records that are not compacted yet.

    It is told all of them each time and writes what it does not hold, at the place where it
    belongs: what a failed write or a crash left behind is written over.

    Args:
        path: of the file.
        tell: takes a sentence on damage.
    """

    def __init__(self, path: Path, tell: Callable[[str], None]) -> None:
        self._path = path
        self._tell = tell
        self._damaged = False
        self._held = self._synced = 0

    def open(self) -> bytes:
        """Good records of the last run; nothing is changed yet. Raises OSError."""
        try:
            found = scan(read_kept_bytes(self._path) or b"")
        except DamagedError as error:
            self._damaged = True
            self._tell(f"{self._path}: {error}")
            return b""
        self._held = self._synced = len(found.records)
        if found.damaged_bytes:
            self._damaged = True
            self._tell(f"{self._path}: {found.damaged_bytes} bytes are damaged")
        elif found.torn_bytes:
            self._tell(f"{self._path}: {found.torn_bytes} bytes were torn off at its end")
        return found.records

    def write(self, records: Content, *, sync: bool = False) -> None:
        """Bring the file to hold all of `records`; with `sync` on the disk. Raises OSError."""
        if self._damaged:
            self._renew(records)
        elif self._held < len(records) or (sync and self._synced < len(records)):
            self._extend(records, sync=sync)

    def rewrite(self) -> None:
        """Let the next `write` write everything: the records are others."""
        self._held = self._synced = 0

    def clear(self) -> None:
        """Forget everything: it is kept elsewhere by now. Raises OSError."""
        with suppress(FileNotFoundError):
            os.truncate(self._path, 0)
        self.rewrite()

    def _renew(self, records: Content) -> None:
        """Replace a damaged file, which is kept beside it, by the good records."""
        with replaced_bytes(self._path) as file:
            file.write(records)
            file.flush()
            self._keep_aside()
        self._damaged = False
        self._held = self._synced = len(records)

    def _keep_aside(self) -> None:
        try:
            os.link(self._path, aside_name(self._path), follow_symlinks=False)
        except FileNotFoundError:
            return
        except OSError:  # a folder, or a file system without links
            set_aside(self._path)

    def _extend(self, records: Content, *, sync: bool) -> None:
        if self._synced == 0:
            made_folder(self._path.parent)
        handle = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        try:
            self._write_rest(handle, records)
            if sync:
                self._sync(handle)
        finally:
            os.close(handle)

    def _write_rest(self, handle: int, records: Content) -> None:
        size = os.fstat(handle).st_size
        if size < self._held:  # somebody cut or removed it
            self.rewrite()
        if size > self._held:
            os.ftruncate(handle, self._held)
        start = self._held
        while start < len(records):
            start += os.pwrite(handle, records[start:], start)
        self._held = start

    def _sync(self, handle: int) -> None:
        try:
            os.fsync(handle)
            if self._synced == 0:
                sync_folder(self._path.parent)
        except OSError:
            self._held = self._synced  # what of it is on the disk, nobody knows
            raise
        self._synced = self._held
