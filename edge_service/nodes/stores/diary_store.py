"""Store of the diary: opened when it is first asked for, shared by the nodes of a process."""

import logging
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from ...clock import now_ns
from ...health.events.diary import Diary
from ...health.events.old_journal import read_journal
from ...messages.event import Event, Severity
from ..supervision.heartbeat import Heartbeat

log = logging.getLogger(__name__)
DIARY, OLD_JOURNAL = "@diary.sqlite", "@events.log"
CARE_PERIOD_S = 1.0
_CARE_LIMIT_S = 60.0


class DiaryStore:
    """The diary in a folder; without one it lives in memory."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._future = 0

    @cached_property
    def diary(self) -> Diary:
        """The diary, with what an earlier version kept."""
        diary = Diary(None if self._folder is None else self._folder / DIARY)
        if self._folder is not None:
            _take_over(diary, self._folder / OLD_JOURNAL)
        return diary

    async def run(self, tell: Callable[[Event], None], heart: Heartbeat) -> None:
        """Write what a failing disk did not take, and make the daily copy, until cancelled.

        Args:
            tell: takes events of what fails, and of damage.
        """
        known = _Known()
        while True:
            await heart.next(CARE_PERIOD_S)
            await heart.in_thread(self.diary.care, now_ns() / 1e9, limit_s=_CARE_LIMIT_S)
            self._future = await heart.in_thread(self.diary.future, now_ns())
            for event in known.news(self.diary, self._future, now_ns()):
                tell(event)

    def readings(self) -> dict[str, float]:
        """Events now that are dated after now."""
        return {"future_events": float(self._future)}

    def close(self) -> None:
        """Write what waits, and close."""
        if "diary" in self.__dict__:
            self.diary.close()


@dataclass(slots=True)
class _Known:
    """State of the diary's disk, as last told."""

    problem: str = ""
    damages: int = 0
    future: int = 0

    def news(self, diary: Diary, future: int, now_ns: int) -> Iterator[Event]:
        """Events of what has changed."""
        if diary.problem and not self.problem:
            words = f"the diary cannot be written to disk and is kept in memory: {diary.problem}"
            yield _event("diary_failing", Severity.ERROR, words, now_ns)
        elif self.problem and not diary.problem:
            yield _event("diary_kept", Severity.INFO, "the diary is written to disk again", now_ns)
        for words in diary.damages[self.damages :]:
            yield _event("diary_damaged", Severity.WARNING, words, now_ns)
        if future > self.future:
            words = f"{future} events are dated in the future: the clock was wrong at the time"
            yield _event("diary_from_future", Severity.WARNING, words, now_ns)
        self.future = future
        self.problem, self.damages = diary.problem, len(diary.damages)


def _event(kind: str, severity: Severity, words: str, now_ns: int) -> Event:
    return Event(axis="", kind=kind, severity=severity, message=words, time_ns=now_ns)


def _take_over(diary: Diary, path: Path) -> None:
    """Take the events of an earlier version over, once."""
    if path.is_file():
        with suppress(OSError):  # it stays, and is tried again at the next start
            events = read_journal(path)
            if diary.take_over(events):
                path.replace(path.with_suffix(".taken"))
                log.info("%s: %d events taken over", path, len(events))
