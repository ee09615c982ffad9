"""The history of all axes on disk: opened, flushed, kept within its budget."""

import contextlib
import fcntl
import logging
import time
from functools import partial
from pathlib import Path
from typing import TextIO

from ...config import ConfigError, EdgeConfig
from ...health.events.journal import EventJournal
from ...health.history.archive import AxisArchive
from ...health.history.budget import make_room
from ...health.state_settings import Keeping
from ..supervision.heartbeat import Heartbeat
from .watch_store import axis_folder

log = logging.getLogger(__name__)
FLUSH_PERIOD_S = 1.0
_FLUSHES_PER_SYNC = 5
_READ_STEP_S = 3600.0
_MB = 1_000_000


class HistoryStore:
    """Archives of every axis; without a folder they live in memory."""

    def __init__(self, config: EdgeConfig, ratios_m_per_rad: dict[str, float]) -> None:
        self._folder = config.history.folder
        self._budget_bytes = round(config.history.budget_mb * _MB)
        self._lock = None if self._folder is None else _locked(self._folder)
        self._archives = {
            axis.name: AxisArchive(_axis_folder(self._folder, axis.name)) for axis in config.axes
        }
        for axis, archive in self._archives.items():
            if archive.cut_bytes:
                log.warning("axis %s: history log, %d bytes torn off", axis, archive.cut_bytes)
        self.keeping = _keeping(self._folder, config, self._archives, ratios_m_per_rad)
        self._failing = False

    async def run(self, heart: Heartbeat) -> None:
        """Flush once a second until cancelled; what is left is flushed at the end."""
        flushes = 0
        try:
            await heart.in_thread(self._read_once)
            while True:
                await heart.sleep(FLUSH_PERIOD_S)
                flushes += 1
                sync = flushes % _FLUSHES_PER_SYNC == 0
                await heart.in_thread(partial(self._flush, sync=sync))
        finally:
            self._flush(sync=True)

    def close(self) -> None:
        """Let another service have the folder."""
        if self._lock is not None:
            self._lock.close()

    def _read_once(self) -> None:
        """The first reading loads the Parquet library, a second that no person should wait."""
        with contextlib.suppress(OSError):  # a request for the history reports it
            for archive in self._archives.values():
                archive.rows(0.0, time.time(), _READ_STEP_S)

    def _flush(self, *, sync: bool) -> None:
        try:
            over = [archive.flush(sync=sync) for archive in self._archives.values()]
            if self._folder is not None and any(over):
                removed = make_room(self._folder, self._budget_bytes)
                if removed:
                    log.info("history: %d files of oldest estimates made room", removed)
        except OSError as error:
            if not self._failing:
                log.warning("history cannot be kept: %s", error)
            self._failing = True
        else:
            self._failing = False


def _locked(folder: Path) -> TextIO:
    """The folder's lock, held until it is closed; ConfigError if another service holds it."""
    folder.mkdir(parents=True, exist_ok=True)
    lock = (folder / "@lock").open("w")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        lock.close()
        raise ConfigError(f"history.folder: {folder} is in use by another service") from None
    return lock


def _axis_folder(folder: Path | None, axis: str) -> Path | None:
    return None if folder is None else axis_folder(folder, axis)


def _keeping(
    folder: Path | None,
    config: EdgeConfig,
    archives: dict[str, AxisArchive],
    ratios_m_per_rad: dict[str, float],
) -> Keeping:
    if folder is None:
        return Keeping(archives=archives, ratios_m_per_rad=ratios_m_per_rad)
    return Keeping(
        archives=archives,
        journal=EventJournal(folder / "@events.log"),
        ratios_m_per_rad=ratios_m_per_rad,
        place=f"on disk, up to {config.history.budget_mb:g} MB; the oldest estimates go first",
    )


def open_history(config: EdgeConfig, ratios_m_per_rad: dict[str, float]) -> HistoryStore:
    """Open what is kept. Raises ConfigError where that cannot be."""
    try:
        return HistoryStore(config, ratios_m_per_rad)
    except OSError as error:
        folder = config.history.folder
        raise ConfigError(f"history.folder: {folder} cannot be used ({error.strerror})") from None
