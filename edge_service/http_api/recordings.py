"""Recordings on disk: whole or not at all, and never more than there is room for."""

import contextlib
import os
import re
import shutil
import stat
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, BinaryIO

from pydantic import Field, WithJsonSchema

from ..atomic import made_folder, replaced_bytes
from ..messages.interval import rfc3339_s
from ..threads import Threads
from .answers import Answer, Timestamp
from .problems import RefusedError

MOST_AT_ONCE = 4
LEFT_FREE_BYTES = 200_000_000
"""Room on the disk that recordings leave to history and events."""
_AT_ONCE_BYTES = 1 << 20
_NAME = r"[A-Za-z0-9_][A-Za-z0-9_.\- ]{0,99}\.(csv|parquet)"
RecordingName = Annotated[str, WithJsonSchema({"type": "string", "pattern": f"^{_NAME}$"})]
"""Name of a recording; whoever keeps them judges it."""


class RecordingAnswer(Answer):
    """One recording."""

    name: str
    size: int = Field(description="Bytes.")
    uploaded: Timestamp


class Recordings:
    """Recordings of one folder. Every call may raise RefusedError.

    Args:
        folder: where they are; what uploads left there that were cut off is removed.
        most_bytes: of all recordings, those that are just coming included.
    """

    def __init__(self, folder: Path, most_bytes: int) -> None:
        self.folder = folder
        self._most_bytes = most_bytes
        self._uploads = self._coming_bytes = 0
        self._threads = Threads("upload", MOST_AT_ONCE)
        for left in folder.glob(".*.part*"):
            with contextlib.suppress(OSError):
                left.unlink()

    def listed(self) -> list[RecordingAnswer]:
        """All recordings, newest first."""
        answers = [_answer(path, status) for path, status in self._kept()]
        return sorted(answers, key=lambda each: each.uploaded, reverse=True)

    def path(self, name: str) -> Path:
        """File of a recording that is there."""
        path = self._named(name)
        if path.is_symlink() or not path.is_file():
            raise RefusedError(404, f"there is no recording {name!r}")
        return path

    def place(self, name: str) -> Path:
        """File that a new recording is to have; refused where there is no room for one."""
        path = self._named(name)
        try:
            made_folder(self.folder)
            self._check_room(0)
        except OSError as error:
            raise RefusedError(507, f"{name}: cannot be kept ({error.strerror})") from None
        return path

    def remove(self, name: str) -> None:
        """Forget a recording."""
        try:
            self.path(name).unlink(missing_ok=True)
        except OSError as error:
            raise RefusedError(507, f"{name}: cannot be removed ({error.strerror})") from None

    async def receive(self, name: str, chunks: AsyncIterator[bytes]) -> RecordingAnswer:
        """Keep a recording that comes in chunks; no disk holds up the event loop."""
        path = self._named(name)
        if self._uploads >= MOST_AT_ONCE:
            raise RefusedError(
                503, f"{MOST_AT_ONCE} recordings are already being uploaded; try again later"
            )
        self._uploads += 1
        try:
            await self._threads.run(made_folder, self.folder)
            await self._write(path, chunks)
            return _answer(path, path.stat())
        except OSError as error:
            raise RefusedError(507, f"{name}: cannot be kept ({error.strerror})") from None
        finally:
            self._uploads -= 1

    async def _write(self, path: Path, chunks: AsyncIterator[bytes]) -> None:
        closing, size = ExitStack(), 0
        file = await self._threads.run(closing.enter_context, replaced_bytes(path))
        try:
            async for batch in _batches(chunks):
                size += len(batch)
                self._coming_bytes += len(batch)
                await self._threads.run(self._append, file, batch)
            if size == 0:
                raise RefusedError(422, f"{path.name}: the file is empty")
        except BaseException:
            await self._threads.run(closing.__exit__, *sys.exc_info())
            raise
        else:
            await self._threads.run(closing.close)
        finally:
            self._coming_bytes -= size

    def _append(self, file: BinaryIO, batch: bytes) -> None:
        self._check_room(len(batch))
        file.write(batch)

    def _check_room(self, more_bytes: int) -> None:
        kept = sum(status.st_size for _, status in self._kept())
        if kept + self._coming_bytes > self._most_bytes:
            raise RefusedError(507, f"{self._most_bytes / 1e6:g} MB of recordings: remove some")
        if shutil.disk_usage(self.folder).free < LEFT_FREE_BYTES + more_bytes:
            raise RefusedError(507, "the disk is nearly full: remove some recordings")

    def _kept(self) -> Iterator[tuple[Path, os.stat_result]]:
        """Recordings that are whole. Nothing else in the folder is one: no link, no folder."""
        for path in self.folder.glob("[!.]*"):
            with contextlib.suppress(OSError):  # it was removed just now
                status = path.lstat()
                if stat.S_ISREG(status.st_mode):
                    yield path, status

    def _named(self, name: str) -> Path:
        if not re.fullmatch(_NAME, name):
            raise RefusedError(
                422,
                f"{name!r}: expected letters, digits, '_', '-', '.', ending in .csv or .parquet",
            )
        return self.folder / name


async def _batches(chunks: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
    """The same bytes in pieces that are worth a turn of the disk."""
    batch = bytearray()
    async for chunk in chunks:
        batch += chunk
        if len(batch) >= _AT_ONCE_BYTES:
            yield bytes(batch)
            batch.clear()
    if batch:
        yield bytes(batch)


def _answer(path: Path, status: os.stat_result) -> RecordingAnswer:
    return RecordingAnswer(name=path.name, size=status.st_size, uploaded=rfc3339_s(status.st_mtime))
