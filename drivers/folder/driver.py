"""Traces that a controller leaves in a folder: each is read once, one after the other."""

import asyncio
import logging
import math
import threading
from collections.abc import AsyncGenerator, Awaitable, Callable, Iterator
from contextlib import aclosing
from pathlib import Path
from typing import ClassVar

import numpy as np

from edge_service.messages.samples import SampleFrame
from edge_service.recordings.columns import TraceError
from edge_service.recordings.reading_process import ReadingProcess
from edge_service.recordings.sinumerik.controller_axis import ControllerAxis
from edge_service.threads import Threads

from ..base import DriverConfig, DriverContext, DriverUnavailableError, Probe
from ..frame_cutter import FrameCutter
from .arrivals import Arrivals
from .config import FolderConfig
from .digests import Digests
from .ledger import Entry, Ledger

log = logging.getLogger(__name__)
BETWEEN_S = 1.0
"""Axis time between two traces: the axis may be anywhere when the next begins."""
SAVE_ROWS = 20_000
"""After so many rows the ledger is written; more than these are never read twice."""


class FolderDriver:
    """Yields the rows of every complete trace in the folder, then waits for the next.

    The recorded clocks follow each other, with a gap between. A trace that cannot be read is told
    in the log and in the ledger, and is no reason to stop; neither is a ledger that cannot be
    written. Files are read in a process with limits: who writes into the folder is a stranger.
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
    ) -> None:
        self._config = config
        self._columns = context.machine.columns
        self._axis = ControllerAxis(
            config.axis_number or context.machine.axis.number, context.machine.axis.lead_m
        )
        self._ledger_path = config.ledger or config.folder / f".edge-service-{context.axis}.json"
        self._sleep = sleep
        self._threads = Threads(f"folder {context.axis}", 2)  # one may hang while the other closes
        self._lock = threading.Lock()  # held by the one thread that reads or closes
        self._reader: ReadingProcess | None = None
        self._turn = 0  # grows when a trace is let go of, also while its process is being started
        self._digests = Digests()
        self._ledger: Ledger | None = None
        self._last_ledger: Ledger | None = None
        self._counts = {"files": 0, "bad_files": 0, "seen_before": 0, "rows": 0, "bad_cells": 0}
        self._newest_s = -np.inf

    @property
    def counters(self) -> dict[str, int]:
        """Files and rows read, files that cannot be, and cells without a number."""
        unsaved = 0 if self._last_ledger is None else self._last_ledger.unsaved
        return self._counts | {"unsaved_ledger": unsaved}

    @property
    def readings(self) -> dict[str, float]:
        """None: a recording knows no more than its samples."""
        return {}

    async def open(self) -> None:
        """Look into folder and ledger. Raises like all drivers."""
        if self._ledger is None:
            self._ledger = await self._threads.run(self._open)

    async def frames(self) -> AsyncGenerator[SampleFrame, None]:
        """Frames of one trace after the other, until `close` or the folder is gone."""
        ledger = self._ledger
        if ledger is None:
            raise DriverUnavailableError(f"{self._config.folder}: the folder is not open")
        config, clock = self._config, asyncio.get_running_loop().time
        arrivals = Arrivals(config.folder, config.pattern, config.settle_s)
        while self._ledger is ledger:
            for path in await self._arrived(arrivals, clock()):
                async with aclosing(self._read(ledger, path)) as frames:
                    async for frame in frames:
                        yield frame
            if self._ledger is ledger:
                if ledger.unsaved:
                    await self._threads.run(ledger.save)
                await self._sleep(config.poll_s)

    async def probe(self) -> Probe:
        """Describe what the folder holds. Raises like `open`."""
        await self._threads.run(self._open)
        return Probe(f"traces in {self._config.folder}", await self._channels(), None)

    async def close(self) -> None:
        """End `frames`; safe twice."""
        self._ledger = None
        await self._threads.run(self._let_go)

    def _open(self) -> Ledger:
        Arrivals(self._config.folder, self._config.pattern, 0.0).complete(0.0)
        if self._last_ledger is None or not self._last_ledger.unsaved:
            self._last_ledger = Ledger(self._ledger_path)
        return self._last_ledger

    async def _channels(self) -> tuple[str, ...]:
        """Channels of the first trace that can be read; none while there is none."""
        config = self._config
        paths = Arrivals(config.folder, config.pattern, 0.0).complete(0.0)
        return await self._threads.run(self._first_channels, paths)

    def _first_channels(self, paths: list[Path]) -> tuple[str, ...]:
        for path in paths:
            try:
                with ReadingProcess(path, self._columns, self._axis) as reader:
                    return reader.channels
            except (TraceError, OSError):
                continue
        return ()

    async def _arrived(self, arrivals: Arrivals, now_s: float) -> list[Path]:
        try:
            return await self._threads.run(arrivals.complete, now_s)
        except DriverUnavailableError:
            self._ledger = None
            raise

    async def _read(self, ledger: Ledger, path: Path) -> AsyncGenerator[SampleFrame, None]:
        """The rows of a trace that were not read before; what was read is written down."""
        entry = await self._threads.run(self._begin, ledger, path)
        if entry is None:
            return
        unsaved, shift_s = 0, None
        frames = self._cut(entry, path, self._turn)
        try:
            while (frame := await self._threads.run(next, frames, None)) is not None:
                await self._sleep(0.0)  # the event loop must get its turn between two reads
                if self._ledger is not ledger:
                    return
                if shift_s is None:
                    starts_anew = np.isfinite(self._newest_s)
                    shift_s = self._newest_s + BETWEEN_S - frame.time_s[0] if starts_anew else 0.0
                shifted = SampleFrame(frame.time_s + shift_s, frame.channels)
                self._newest_s = max(self._newest_s, float(shifted.time_s.max()))
                entry.rows += len(frame)
                self._counts["rows"] += len(frame)
                unsaved += len(frame)
                yield shifted
                if unsaved >= SAVE_ROWS:
                    await self._threads.run(ledger.save)
                    unsaved = 0
        finally:
            await self._threads.run(self._finish, ledger)

    def _begin(self, ledger: Ledger, path: Path) -> Entry | None:
        """Its entry, unless it has been read already; one that has grown is read on."""
        try:
            size = path.stat().st_size
            shorter = ledger.shorter(path.name, size)
            digests = self._digests.of(path, {size, *(each.size for each in shorter)})
        except OSError as error:
            log.warning("%s: cannot be read (%s)", path, error.strerror)
            return None
        entry = ledger.entry(digests[size], path.name, size)
        if entry.rows == 0 and not entry.done:
            beginnings = [each for each in shorter if digests[each.size] == each.digest]
            entry.rows = max((each.rows for each in beginnings), default=0)
            ledger.note_grown(beginnings)
        if entry.done:
            self._counts["seen_before"] += 1
            return None
        return entry

    def _cut(self, entry: Entry, path: Path, turn: int) -> Iterator[SampleFrame]:
        """Frames of the rows beyond `entry.rows`; at the end the entry is done."""
        cutter = FrameCutter(self._config.frame_s)
        try:
            reader = ReadingProcess(path, self._columns, self._axis, skip_rows=entry.rows)
            self._reader = reader
            if self._turn != turn:  # let go of meanwhile
                self._let_go()
                return
            log.info("reading %s", path)
            bad = 0
            while (block := self._next(reader)) is not None:
                self._counts["bad_cells"] += sum(reader.bad_cells.values()) - bad
                bad = sum(reader.bad_cells.values())
                yield from cutter.cut(block)
            if self._reader is not reader:  # closed meanwhile: not at its end
                return
            rest = cutter.rest()
            if rest is not None:
                yield rest
            self._counts["files"] += 1
        except OSError as error:
            raise DriverUnavailableError(
                f"{path}: no process to read it ({error.strerror})"
            ) from None
        except TraceError as error:
            log.warning("%s", error)
            entry.problem = str(error)
            self._counts["bad_files"] += 1
        entry.done = True

    def _next(self, reader: ReadingProcess) -> SampleFrame | None:
        with self._lock:
            return next(reader, None) if self._reader is reader else None

    def _finish(self, ledger: Ledger) -> None:
        self._let_go()
        ledger.save()

    def _let_go(self) -> None:
        self._turn += 1  # first: whoever sets a reader looks at it afterwards
        reader, self._reader = self._reader, None
        if reader is None:
            return
        reader.close()  # a read that is under way ends
        with self._lock:
            reader.release()
