"""The history of all axes on disk: opened, flushed, checked, kept within its budget."""

import contextlib
import fcntl
import logging
import os
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from ...atomic import made_folder
from ...clock import now_ns
from ...config import ConfigError, EdgeConfig
from ...health.history.archive import AxisArchive
from ...health.history.budget import make_room, sweep
from ...health.history.file_tier import FileTier
from ...health.state_settings import Keeping
from ..supervision.heartbeat import Heartbeat
from .history_watch import HistoryWatch, Turn
from .watch_store import axis_folder

log = logging.getLogger(__name__)
FLUSH_PERIOD_S = 1.0
_FLUSHES_PER_SYNC = 5
_FLUSHES_PER_LOOK = 30
"""Into the future: its files come with a wrong clock alone."""
_FLUSHES_PER_TRIAL = 3
"""While it fails it is tried less often: each trial prepares a whole hour."""
_CHECKING_S = 0.2
_CHECK_AGAIN_AFTER_S = 86_400.0
_READ_STEP_S = 3600.0
_MB = 1_000_000
UNFINISHED = "@restore"
"""Folder in which a restore unpacks a backup; it is gone once the history is whole."""
_File = tuple[AxisArchive, FileTier, Path]


class HistoryStore:
    """Archives of every axis; without a folder they live in memory.

    With a folder they do so too while nothing can be written; what they hold is written later.
    """

    def __init__(self, config: EdgeConfig, ratios_m_per_rad: dict[str, float]) -> None:
        self._folder = config.history.folder
        self._budget_bytes = round(config.history.budget_mb * _MB)
        self._lock: int | None = None
        with contextlib.suppress(OSError):  # tried again with every flush, which reports it
            self._hold()
        self._archives = {
            axis.name: AxisArchive(_axis_folder(self._folder, axis.name)) for axis in config.axes
        }
        self.keeping = _keeping(self._folder, config, self._archives, ratios_m_per_rad)
        self._failing = False
        self._turns = 0
        self._unchecked: Iterator[_File] = iter(())
        self._checked_s = -_CHECK_AGAIN_AFTER_S

    async def run(self, watch: HistoryWatch, heart: Heartbeat) -> None:
        """Flush once a second until cancelled; what is left is flushed at the end."""
        flushes = 0
        try:
            await heart.in_thread(self._read_once)
            while True:
                flushes += 1
                if not self._failing or flushes % _FLUSHES_PER_TRIAL == 0:
                    sync = self._failing or flushes % _FLUSHES_PER_SYNC == 0
                    watch.take(await heart.in_thread(partial(self._turn, sync=sync)))
                await heart.next(FLUSH_PERIOD_S)
        finally:
            watch.take(self._turn(sync=True))

    def close(self) -> None:
        """Let another service have the folder."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _read_once(self) -> None:
        """The first reading loads the Parquet library, a second that no person should wait."""
        with contextlib.suppress(OSError):  # a request for the history reports it
            for archive in self._archives.values():
                archive.rows(0.0, now_ns() / 1e9, _READ_STEP_S)

    def _turn(self, *, sync: bool) -> Turn:
        """Write what was taken in, whatever fails for one axis; then look after the files."""
        turn = Turn()
        over = False
        try:
            self._hold()
        except (OSError, ConfigError) as error:
            turn.problems.append(_words(error))
            for archive in self._archives.values():
                archive.hold()
        else:
            for axis, archive in self._archives.items():
                over |= _flush(axis, archive, turn, sync=sync)
            self._look_after(turn, over=over)
        self._failing = bool(turn.problems)
        self._count(turn)
        if self._turns % _FLUSHES_PER_LOOK == 0:
            turn.future = self._future_files()
        self._turns += 1
        return turn

    def _look_after(self, turn: Turn, *, over: bool) -> None:
        try:
            if self._folder is not None:
                self._keep_budget(self._folder, over=over)
            self._check_some()
            for archive in self._archives.values():
                archive.mend()
        except OSError as error:
            turn.problems.append(_words(error))

    def _count(self, turn: Turn) -> None:
        for axis, archive in self._archives.items():
            turn.damages += [(axis, words) for words in archive.take_damages()]
            turn.lost += archive.lost
            turn.adopted += archive.adopted

    def _future_files(self) -> dict[str, list[str]]:
        now_s = now_ns() / 1e9
        return {axis: each.future_files(now_s) for axis, each in self._archives.items()}

    def _keep_budget(self, folder: Path, *, over: bool) -> None:
        if not over:
            return
        sweep(folder)
        removed = make_room(folder, self._budget_bytes)
        if removed:
            log.info(
                "history: %d files with the oldest estimates were removed to make room", removed
            )

    def _check_some(self) -> None:
        """Check kept files for a moment; all of them after the start, and once a day."""
        until_s = time.monotonic() + _CHECKING_S
        while time.monotonic() < until_s:
            archive, tier, path = next(self._unchecked, (None, None, None))
            if archive is None or tier is None or path is None:
                self._begin_checks()
                return
            archive.check(tier, path)

    def _begin_checks(self) -> None:
        now_s = time.monotonic()
        if now_s - self._checked_s >= _CHECK_AGAIN_AFTER_S:
            self._checked_s = now_s
            archives = self._archives.values()
            files = [(archive, *each) for archive in archives for each in archive.files()]
            self._unchecked = iter(files)

    def _hold(self) -> None:
        """Lock the folder, unless it is. Raises OSError; ConfigError if another holds it."""
        if self._folder is not None and self._lock is None:
            self._lock = lock_folder(self._folder)
            sweep(self._folder)


def _flush(axis: str, archive: AxisArchive, turn: Turn, *, sync: bool) -> bool:
    try:
        return archive.flush(sync=sync)
    except OSError as error:
        turn.problems.append(f"axis {axis}: {_words(error)}")
        return False


def _words(error: OSError | ConfigError) -> str:
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror} ({error.filename})" if error.filename else error.strerror
    return str(error)


def lock_folder(folder: Path) -> int:
    """Descriptor that locks the folder; ConfigError if another service holds it. OSError.

    It is open for reading only, so that the disk may become read-only.
    """
    made_folder(folder)
    if (folder / UNFINISHED).exists():
        raise ConfigError(
            f"history.folder: {folder}: a restore was interrupted; empty it and restore again"
        )
    lock = os.open(folder / "@lock", os.O_RDONLY | os.O_CREAT | os.O_CLOEXEC, 0o666)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(lock)
        if isinstance(error, BlockingIOError):
            problem = f"history.folder: {folder} is in use by another service"
            raise ConfigError(problem) from None
        raise
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
        ratios_m_per_rad=ratios_m_per_rad,
        place=f"on disk, up to {config.history.budget_mb:g} MB; the oldest estimates go first",
    )


def open_history(config: EdgeConfig, ratios_m_per_rad: dict[str, float]) -> HistoryStore:
    """Open what is kept. Raises ConfigError where the folder is none, or in use."""
    folder = config.history.folder
    if folder is not None and folder.exists() and not folder.is_dir():
        raise ConfigError(f"history.folder: {folder} is not a folder")
    return HistoryStore(config, ratios_m_per_rad)
