"""A watched folder: every complete trace that a controller leaves there is read once."""

import asyncio
import hashlib
import json
import logging
import math
import os
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import aclosing, suppress
from dataclasses import asdict, dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import Field, TypeAdapter

from edge_service.atomic import damaged_name, put_in_place, replaced_file
from edge_service.messages.samples import SampleFrame
from edge_service.recordings.columns import TraceError

from ..base import DriverConfig, DriverContext, DriverUnavailableError, Probe
from ..recorded import RecordedRows
from ..rows import FRAME_S, FrameCutter

log = logging.getLogger(__name__)
SETTLE_S = 2.0
"""A file that has not changed for so long, and has its proper end, is complete."""
POLL_S = 1.0  # time between two looks into the folder
BETWEEN_S = 1.0
"""Axis time between two traces: the axis may be anywhere when the next begins."""
SAVE_ROWS = 20_000
"""After so many rows the ledger is written; more than these are never read twice."""
_CHUNK_BYTES = 1 << 20
_TAIL_BYTES = 4096
_PARQUET_MAGIC = b"PAR1"


class FolderConfig(DriverConfig):
    """Settings of a watched folder; `deploy/drivers/folder.toml` tells of each."""

    folder: Path
    pattern: str = Field("*", pattern=r"^[^/]+$")


class Arrivals:
    """Watches a folder. A file is complete when it rests for `settle_s` and has its proper end."""

    def __init__(self, folder: Path, pattern: str, settle_s: float) -> None:
        self._folder, self._pattern, self._settle_s = folder, pattern, settle_s
        self._since: dict[tuple[Path, int, int], float] = {}
        self._told: set[tuple[Path, int, int]] = set()
        self.links: set[Path] = set()  # symbolic ones, passed over by the last look

    def complete(self, now_s: float) -> list[Path]:
        """Files that have become complete since the last call, the oldest first.

        Raises:
            DriverUnavailableError: the folder cannot be looked into.
        """
        try:
            seen = [path for path in self._folder.iterdir() if path.name[0] != "."]
            there = {path for path in seen if fnmatch(path.name, self._pattern)}
            self.links = {path for path in there if path.is_symlink()}
            found = {
                (path, path.stat().st_size, path.stat().st_mtime_ns)
                for path in there - self.links
                if path.is_file()
            }
        except OSError as error:
            raise DriverUnavailableError(f"{self._folder}: {error.strerror}") from None
        self._since = {state: self._since.get(state, now_s) for state in found}
        ready = {
            each
            for each, t_s in self._since.items()
            if now_s - t_s >= self._settle_s and each not in self._told and has_proper_end(each[0])
        }
        self._told = (self._told & found) | ready
        return [path for path, _, _ in sorted(ready, key=lambda state: (state[2], state[0]))]


def has_proper_end(path: Path) -> bool:
    """Return whether a file ends as its form demands: closing tag, magic bytes, end of a line."""
    try:
        with path.open("rb") as file:
            head = file.read(_TAIL_BYTES)
            file.seek(max(path.stat().st_size - _TAIL_BYTES, 0))
            tail = file.read().rstrip(b" \t\0")
    except OSError:
        return False
    if head.startswith(_PARQUET_MAGIC):
        return tail.endswith(_PARQUET_MAGIC) and len(tail) > len(_PARQUET_MAGIC)
    if head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        return tail.rstrip().endswith(b"</traceSession>")
    return tail.endswith((b"\n", b"\r"))


@dataclass(slots=True)
class Entry:
    """One trace, known by its content: neither another name nor another date makes it new."""

    digest: str  # SHA-256 of the content
    name: str  # of the file when it was first seen
    size: int  # of the content, bytes
    rows: int = 0  # handed out so far
    done: bool = False  # nothing is left to read


_ENTRY = TypeAdapter(Entry)


class Ledger:
    """Record of what has been read: a small file with a line of JSON for each trace.

    Of a damaged one the lines that can be read stand, and it is kept beside. One that cannot be
    written is told once; what is read meanwhile is written as soon as that can be.

    Attributes:
        unsaved: times in a row that the file could not be written.

    Raises:
        DriverUnavailableError: it cannot be read now.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.unsaved = 0
        self._aside: Path | None = None  # place for a damaged one, until the next is written
        self._entries: dict[str, Entry] = {}
        try:
            lines = path.read_bytes().splitlines() if path.exists() else []
        except OSError as error:
            raise DriverUnavailableError(f"{path}: cannot be read ({error.strerror})") from None
        for line in lines:
            with suppress(ValueError):
                entry = _ENTRY.validate_json(line, strict=True)
                self._entries[entry.digest] = entry
        if len(self._entries) < len(lines):
            self._aside = path.with_name(damaged_name(path.name))
            known = len(self._entries)
            log.warning("%s: damaged, kept as %s; %d traces known", path, self._aside.name, known)

    def entry_of(self, path: Path) -> Entry:
        """The entry of a trace; a new one where it has not been seen. Raises OSError.

        One that begins with what was read of a file of its name goes on behind that.
        """
        size = path.stat().st_size
        shorter = [e for e in self._entries.values() if e.name == path.name and e.size < size]
        hasher, position = hashlib.sha256(), 0
        beginning: Entry | None = None
        with path.open("rb") as file:
            for end in sorted({size, *(each.size for each in shorter)}):
                while chunk := file.read(min(_CHUNK_BYTES, end - position)):
                    hasher.update(chunk)
                    position += len(chunk)
                digest = hasher.hexdigest()
                if end < size:
                    beginning = self._entries.get(digest, beginning)
        if digest not in self._entries:
            self._entries[digest] = Entry(digest, path.name, size)
            if beginning is not None:
                self._entries[digest].rows = beginning.rows
                del self._entries[beginning.digest]
        return self._entries[digest]

    def save(self) -> None:
        """Write all entries, if that can be."""
        try:
            with replaced_file(self._path) as file:
                file.writelines(f"{json.dumps(asdict(each))}\n" for each in self._entries.values())
                if self._aside is not None:
                    file.flush()  # a disk that is full is told here, before anything is moved
                    with suppress(FileNotFoundError):
                        put_in_place(self._path, self._aside)
                    self._aside = None
        except OSError as error:
            if not self.unsaved:
                log.warning("%s: cannot be written (%s)", self._path, error.strerror)
            self.unsaved += 1
        else:
            self.unsaved = 0


class FolderDriver:
    """Yields the rows of every complete trace in the folder, then waits for the next.

    The recorded clocks follow each other, with a gap between. A trace that cannot be read is told
    in the log, and is no reason to stop; neither is a ledger that cannot be written. The ledger
    lies in $STATE_DIRECTORY, or in the folder where there is none.
    """

    config_model: ClassVar[type[DriverConfig]] = FolderConfig
    paced = False
    quiet_s = math.inf
    """Nobody knows when the next trace comes."""

    def __init__(
        self,
        config: FolderConfig,
        context: DriverContext,
        *,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
        settle_s: float = SETTLE_S,
        ledger: Path | None = None,
    ) -> None:
        self._config, self._sleep, self._settle_s = config, sleep, settle_s
        state = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
        kept = Path(state) / f"folder-{context.axis}.jsonl"
        beside = config.folder / f".edge-service-{context.axis}.jsonl"
        self.ledger_path = ledger or (kept if state else beside)
        self.readings: dict[str, float] = {}  # a recording knows no more than its samples
        self._rows = RecordedRows(f"folder {context.axis}", context.machine)
        self._ledger: Ledger | None = None
        self._arrivals: Arrivals | None = None
        self._counts = {"files": 0, "bad_files": 0, "seen_before": 0, "rows": 0, "bad_cells": 0}
        self._newest_s = -np.inf
        self._told: set[Path] = set()

    @property
    def counters(self) -> dict[str, int]:
        unsaved = 0 if self._ledger is None else self._ledger.unsaved
        return self._counts | {"unsaved_ledger": unsaved}

    async def open(self) -> None:
        """Look into folder and ledger. Raises like all drivers."""
        if self._arrivals is None:
            await self._rows.run(self._complete_now)
            if self._ledger is None:
                self._ledger = await self._rows.run(Ledger, self.ledger_path)
            config = self._config
            self._arrivals = Arrivals(config.folder, config.pattern, self._settle_s)

    async def frames(self) -> AsyncGenerator[SampleFrame, None]:
        arrivals, ledger = self._arrivals, self._ledger
        if arrivals is None or ledger is None:
            raise DriverUnavailableError(f"{self._config.folder}: the folder is not open")
        clock = asyncio.get_running_loop().time
        while self._arrivals is arrivals:
            try:
                paths = await self._rows.run(arrivals.complete, clock())
            except DriverUnavailableError:
                self._arrivals = None
                raise
            for link in arrivals.links - self._told:
                log.warning("%s: passed over, for it is a symbolic link", link)
            self._told |= arrivals.links
            for path in paths:
                async with aclosing(self._read(arrivals, ledger, path)) as frames:
                    async for frame in frames:
                        yield frame
            if self._arrivals is arrivals:
                if ledger.unsaved:
                    await self._rows.run(ledger.save)
                await self._sleep(POLL_S)

    async def probe(self) -> Probe:
        def channels() -> tuple[str, ...]:
            for path in self._complete_now():
                with suppress(TraceError), self._rows.open_now(path) as reader:
                    return reader.channels
            return ()

        return Probe(f"traces in {self._config.folder}", await self._rows.run(channels), None)

    async def close(self) -> None:
        self._arrivals = None
        await self._rows.close()

    def _complete_now(self) -> list[Path]:
        return Arrivals(self._config.folder, self._config.pattern, 0.0).complete(0.0)

    async def _read(
        self, arrivals: Arrivals, ledger: Ledger, path: Path
    ) -> AsyncGenerator[SampleFrame, None]:
        """The rows of a trace that were not read before; what was read is written down."""
        try:
            entry = await self._rows.run(ledger.entry_of, path)
        except OSError as error:
            log.warning("%s: cannot be read (%s)", path, error.strerror)
            return
        if self._arrivals is not arrivals:
            return
        if entry.done:
            self._counts["seen_before"] += 1
            return
        saved_rows, shift_s = entry.rows, None
        try:
            async with aclosing(self._cut(path, entry.rows)) as frames:
                async for frame in frames:
                    if self._arrivals is not arrivals:
                        return
                    if shift_s is None:
                        anew = np.isfinite(self._newest_s)
                        shift_s = self._newest_s + BETWEEN_S - frame.time_s[0] if anew else 0.0
                    shifted = SampleFrame(frame.time_s + shift_s, frame.channels)
                    self._newest_s = max(self._newest_s, float(shifted.time_s.max()))
                    entry.rows += len(frame)
                    self._counts["rows"] += len(frame)
                    yield shifted
                    if entry.rows - saved_rows >= SAVE_ROWS:
                        await self._rows.run(ledger.save)
                        saved_rows = entry.rows
            if self._arrivals is not arrivals:  # closed meanwhile: not at its end
                return
            self._counts["files"] += 1
            entry.done = True
        except TraceError as error:
            log.warning("%s", error)
            self._counts["bad_files"] += 1
            entry.done = True
        finally:
            await self._rows.close()
            await self._rows.run(ledger.save)

    async def _cut(self, path: Path, skip: int) -> AsyncGenerator[SampleFrame, None]:
        """Frames of the rows beyond the first `skip`, until the end or `close`."""
        cutter, bad = FrameCutter(FRAME_S), 0
        reader = await self._rows.open(path)
        if reader is None:
            return
        log.info("reading %s", path)
        while (block := await self._rows.next(reader)) is not None:
            self._counts["bad_cells"] += sum(reader.bad_cells.values()) - bad
            bad = sum(reader.bad_cells.values())
            skip, skipped = max(skip - len(block), 0), min(skip, len(block))
            if skipped < len(block):
                for frame in cutter.cut(block.part(slice(skipped, None))):
                    await self._sleep(0.0)  # the event loop must get its turn between two reads
                    yield frame
        if cutter.rest is not None:
            yield cutter.rest
