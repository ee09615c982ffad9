"""Recordings on disk: whole or not at all, and never more than there is room for."""

import os
import re
import shutil
import stat
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import ExitStack, suppress
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import Annotated

from pydantic import Field, WithJsonSchema

from ..atomic import made_folder, replaced_bytes
from ..messages.interval import Frozen, TimeNs
from ..threads import Threads
from .problems import RefusedError

LEFT_FREE_BYTES = 200_000_000
"""Room on the disk that recordings leave to history and events."""
_AT_ONCE_BYTES = 1 << 20
_UNIX_S = 1e9
"""A time in a file that is at least this is UNIX time; an axis' clock begins at 0."""
_ENDS = "csv|parquet|txt|xml|json|mat"
_NAME = rf"[A-Za-z0-9_][A-Za-z0-9_.\- ]{{0,99}}\.({_ENDS})"
_STAMPED = re.compile(r"(?P<kind>\w+)_(?P<axis>[A-Za-z0-9.\-]+)_(?P<stamp>\d{8}T\d{6}Z)\.\w+")
RecordingName = Annotated[str, WithJsonSchema({"type": "string", "pattern": f"^{_NAME}$"})]
"""Name of a recording; whoever keeps them judges it."""
Extent = tuple[int | None, float | None, float | None]
"""Rows, first and last time of a recording, s; None: not known."""


class Recording(Frozen):
    """One recording; what the file and its name do not tell is null."""

    name: str
    axis: str | None
    bytes: int
    from_ns: TimeNs | None = Field(alias="from")
    to_ns: TimeNs | None = Field(alias="to")
    rows: int | None
    kind: str = Field(description="`disagreement`, `record`, the motion; else `upload`.")


class Recordings:
    """Recordings of one folder. Every call may raise RefusedError.

    Args:
        folder: where they are; what uploads left there that were cut off is removed.
        most_bytes: of all recordings, those that are just coming included.
    """

    def __init__(
        self,
        folder: Path,
        most_bytes: int,
        extent: Callable[[Path], Extent] = lambda _path: (None, None, None),
    ) -> None:
        self.folder = folder
        self._most_bytes = most_bytes
        self._extent = lru_cache(1024)(lambda path, _size, _changed_ns: extent(path))
        self._threads = Threads("upload", 4)
        for left in folder.glob(".*.part*"):
            with suppress(OSError):
                left.unlink()

    async def page(self, before_ns: int, most: int) -> list[tuple[int, Recording]]:
        """Recordings that were changed before some time, newest first, with that time, ns."""

        def found() -> list[tuple[int, Recording]]:
            kept = [(status.st_mtime_ns, path, status) for path, status in self._files()]
            newest = sorted((each for each in kept if each[0] < before_ns), reverse=True)[:most]
            return [(at_ns, self._shown(path, status)) for at_ns, path, status in newest]

        return await self._threads.run(found)

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

    async def receive(self, name: str, chunks: AsyncIterator[bytes]) -> Recording:
        """Keep a recording that comes in chunks; no disk holds up the event loop."""
        path = self._named(name)
        try:
            await self._threads.run(made_folder, self.folder)
            await self._write(path, chunks)
            return await self._threads.run(self._shown, path, path.stat())
        except OSError as error:
            raise RefusedError(507, f"{name}: cannot be kept ({error.strerror})") from None

    async def _write(self, path: Path, chunks: AsyncIterator[bytes]) -> None:
        closing, size = ExitStack(), 0
        one = Threads("upload")  # a single thread: what is opened is closed after that
        try:
            file = await one.run(closing.enter_context, replaced_bytes(path))
            async for batch in _batches(chunks):
                size += len(batch)
                await one.run(self._check_room, len(batch))
                await one.run(file.write, batch)
            if size == 0:
                raise RefusedError(422, f"{path.name}: the file is empty")
        except BaseException:
            await one.run(closing.__exit__, *sys.exc_info())
            raise
        await one.run(closing.close)

    def _check_room(self, more_bytes: int) -> None:
        there = sum(status.st_size for _, status in self._files("*"))  # what is coming, too
        if there + more_bytes > self._most_bytes:
            raise RefusedError(507, f"{self._most_bytes / 1e6:g} MB of recordings: remove some")
        if shutil.disk_usage(self.folder).free < LEFT_FREE_BYTES + more_bytes:
            raise RefusedError(507, "the disk is nearly full: remove some recordings")

    def _files(self, pattern: str = "[!.]*") -> Iterator[tuple[Path, os.stat_result]]:
        """Recordings that are whole. Nothing else in the folder is one: no link, no folder."""
        for path in self.folder.glob(pattern):
            with suppress(OSError):  # it was removed just now
                status = path.lstat()
                if stat.S_ISREG(status.st_mode):
                    yield path, status

    def _named(self, name: str) -> Path:
        if not re.fullmatch(_NAME, name):
            expected = f"letters, digits, '_', '-', '.', ending in {_ENDS.replace('|', ', ')}"
            raise RefusedError(422, f"{name!r}: expected {expected}")
        return self.folder / name

    def _shown(self, path: Path, status: os.stat_result) -> Recording:
        """A recording by its name, `{kind}_{axis}_{UTC}`, and what is in its file."""
        rows, first_s, last_s = self._extent(path, status.st_size, status.st_mtime_ns)
        stamped = _STAMPED.fullmatch(path.name)
        from_s = first_s if first_s is not None and first_s >= _UNIX_S else None
        if stamped and from_s is None:
            with suppress(ValueError):  # no date
                moment = datetime.strptime(stamped["stamp"], "%Y%m%dT%H%M%SZ")
                from_s = moment.replace(tzinfo=UTC).timestamp()
        is_known = None not in (from_s, first_s, last_s)
        to_s = (from_s or 0.0) + (last_s or 0.0) - (first_s or 0.0) if is_known else None
        return Recording(
            name=path.name,
            axis=stamped and stamped["axis"],
            bytes=status.st_size,
            from_ns=None if from_s is None else round(from_s * 1e9),
            to_ns=None if to_s is None else round(to_s * 1e9),
            rows=rows,
            kind=stamped["kind"] if stamped else "upload",
        )


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
