"""Diary: events, numbered and on the disk before anybody is told, and the audit log beside them."""

import logging
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from ...kept_database import DatabaseFailedError, KeptDatabase
from ...messages.event import Event
from . import tables
from .audit import AuditEntry, AuditRecord, append_entries, checked
from .audit_head import AuditHead, newest_of
from .kinds import is_chatter, room_of
from .log import LoggedEvent
from .scrub import Scrub

log = logging.getLogger(__name__)
_NS_PER_US = 1000
_LATEST_US = 2**52
"""A clock that shows more gives no ids: they must stay below 2**53 whatever it does."""
_MOST_UNSAVED = 20_000
_PRUNE_EVERY = 500
_IN_MEMORY = 20
"""By so much fewer events are kept where they live in memory."""
_Key = tuple[int, str, str, str]


class Diary:
    """Events of a service, for any thread; without a path they live in memory.

    Ids grow, also across restarts, since they start at the time in microseconds; they stay below
    2**53, so every JSON reader keeps them exactly. What the disk does not take waits in memory and
    is written as soon as it does. An event that is there already is not doubled.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._file = KeptDatabase(path, tables.SCHEMA, tables.rescue)
        self._name = "the diary" if path is None else str(path)
        self._shared = _IN_MEMORY if path is None else 1
        self._lock = threading.Lock()
        self._unsaved: dict[_Key, LoggedEvent] = {}
        self._entries: list[AuditEntry] = []
        self._since_pruned: Counter[tuple[str, str]] = Counter()
        self._damaged_ids: set[int] = set()
        self._told_damages = self.lost = self._now_ns = 0
        self.damages: list[str] = []
        """Damages, a line each: entries that are left out, files that were set aside."""
        self._scrub = Scrub(self._note_entry, self._note_in_file, self._note_audit)
        head = None if path is None else path.with_name(f"{path.stem}.head.json")
        self._head, self._mended = AuditHead(head, self.note_damage), -1
        self.problem = ""
        """Reason for which events cannot be kept now; empty if they are."""
        self.audit_problem = ""
        """Entries that are gone from the audit log, or changed; empty as far as was looked at."""
        self.last_id = max((each.id for each in self._read(tables.NEWEST)), default=0)

    def add(
        self, events: Iterable[Event], now_ns: int, entries: Iterable[AuditEntry] = ()
    ) -> tuple[LoggedEvent, ...]:
        """Number and keep events and entries of the audit log; on the disk unless `problem`."""
        with self._lock:
            self._now_ns = now_ns
            added = [self._numbered(event, now_ns) for event in events]
            self._entries.extend(entries)
            saved = self._save()
            return tuple(saved.get(_key(each.event), each) for each in added)

    def take_over(self, events: Sequence[LoggedEvent]) -> bool:
        """Keep events of another file under their own numbers; tell whether they are kept now."""

        def write() -> None:
            with self._file.transaction() as file:
                for each in events:
                    tables.put(file, each.id, each.event, each.event.model_dump_json())

        with self._lock:
            taken = self._attempt(write)
            self.last_id = max((self.last_id, *(each.id for each in events)))
        return taken

    def care(self, now_s: float) -> None:
        """Write what waits, and make the daily copy; to be called every second or so."""
        with self._lock:
            self._now_ns = int(now_s * 1e9)
            if self._unsaved or self._entries or self.problem or self._is_unmended:
                self._save()
            if not self.problem:
                self._attempt(lambda: self._file.copy(now_s))
            self._scrub.go_on(self._file, now_s)

    def after(self, last_id: int, most: int) -> tuple[LoggedEvent, ...]:
        """The first `most` events with a higher id than `last_id`, oldest first."""
        found = self._read(tables.AFTER, last_id, most)
        return self._with_unsaved(found, lambda each: each.id > last_id)[:most]

    def between(self, start_ns: int, end_ns: int, axis: str, most: int) -> tuple[LoggedEvent, ...]:
        """The newest events of an axis, or of the service, in [start_ns, end_ns), oldest first."""
        found = self._read(tables.BETWEEN, axis, start_ns, end_ns, most)

        def wanted(each: LoggedEvent) -> bool:
            return each.event.axis in ("", axis) and start_ns <= each.event.time_ns < end_ns

        return self._with_unsaved(found, wanted)[-most:]

    def newest(self, axis: str, kind: str) -> LoggedEvent | None:
        """The newest event of a kind; None if none is known."""
        found = self._read(tables.NEWEST_OF_ROOM, axis, room_of(kind)[0])

        def wanted(each: LoggedEvent) -> bool:
            return (each.event.axis, each.event.kind) == (axis, kind)

        return next(reversed(self._with_unsaved(filter(wanted, found), wanted)), None)

    def future(self, now_ns: int) -> int:
        """Number of events that are dated after now."""
        after_ns = tables.future_ns(now_ns)
        rows = self._rows(tables.DATED_AFTER, after_ns)
        return int(rows[0][0]) if rows else 0

    def holds_all_after(self, last_id: int) -> bool:
        """Tell whether no event with a higher id than `last_id` had to make room."""
        rows = self._rows(tables.DROPPED)
        return not rows or rows[0][0] is None or last_id >= rows[0][0]

    def records(self, first: int, most: int) -> list[AuditRecord]:
        """The audit log from number `first` on, at most so many, checked."""
        rows = self._rows(tables.RECORDS, max(first - 1, 1), most + 1)
        return checked(rows, first)[:most]

    @property
    def entries(self) -> int:
        """Number of the newest entry of the audit log."""
        rows = self._rows(tables.LAST_RECORD)
        return int(rows[0][0]) if rows else 0

    def counters(self) -> dict[str, int]:
        """Counts of what waits, and of what was lost or damaged since the start."""
        return {
            "diary_unsaved": len(self._unsaved) + len(self._entries),
            "diary_lost": self.lost,
            "diary_damaged_entries": len(self._damaged_ids),
            "diary_damaged_files": len(self._file.damages),
        }

    def close(self) -> None:
        """Write what waits and close; safe twice."""
        with self._lock:
            if self._unsaved or self._entries:
                self._save()
            self._file.close()

    def _numbered(self, event: Event, now_ns: int) -> LoggedEvent:
        key = _key(event)
        if key not in self._unsaved:
            now_us = now_ns // _NS_PER_US
            self.last_id = max(self.last_id + 1, now_us if now_us < _LATEST_US else 0)
            self._unsaved[key] = LoggedEvent(self.last_id, event)
        return self._unsaved[key]

    @property
    def _is_unmended(self) -> bool:
        return self._file.rescues != self._mended

    def _save(self) -> dict[_Key, LoggedEvent]:
        """Write what waits; what was written, with the numbers under which it is kept."""
        saved: dict[_Key, LoggedEvent] = {}

        def write() -> None:
            with self._file.transaction() as file:
                was_rescued = self._file.rescues > max(self._mended, 0)
                gone = self._head.mend(file, was_rescued, self._now_ns)
                saved.update({key: tables.write(file, each) for key, each in self._unsaved.items()})
                append_entries(file, self._entries)
                newest = newest_of(file)
            self._head.follow(newest)
            self._mended = self._file.rescues
            if gone:
                self._note_audit(gone)
                self.note_damage(f"{self._name}: of the audit log {gone}")

        if not self._attempt(write):
            self._bound()
            return {}
        self._unsaved.clear()
        self._entries.clear()
        self.last_id = max((self.last_id, *(each.id for each in saved.values())))
        self._prune(saved.values())
        return saved

    def _bound(self) -> None:
        """Keep what waits within bounds: what happens all the time goes first."""
        while len(self._unsaved) > _MOST_UNSAVED:
            chatter = (key for key, each in self._unsaved.items() if is_chatter(each.event.kind))
            del self._unsaved[next(chatter, next(iter(self._unsaved)))]
            self.lost += 1

    def _prune(self, saved: Iterable[LoggedEvent]) -> None:
        self._since_pruned.update((each.event.axis, room_of(each.event.kind)[0]) for each in saved)
        for (axis, room), count in list(self._since_pruned.items()):
            if count >= _PRUNE_EVERY and self._attempt(partial(self._shrink, axis, room)):
                del self._since_pruned[axis, room]

    def _shrink(self, axis: str, room: str) -> None:
        with self._file.transaction() as file:
            most = room_of(room)[1] // self._shared
            tables.shrink(file, axis, room, most, tables.future_ns(self._now_ns))

    def _attempt(self, work: Callable[[], None]) -> bool:
        """Do work on the file; a failure is logged once, and the same until it succeeds again."""
        try:
            work()
        except DatabaseFailedError as error:
            if not self.problem:
                log.warning("the diary cannot be kept: %s", error)
            self.problem = str(error)
            return False
        if self.problem:
            log.info("the diary is written to disk again")
        self.problem = ""
        self._tell_damages()
        return True

    def _tell_damages(self) -> None:
        for damage in self._file.damages[self._told_damages :]:
            self.note_damage(damage)
        self._told_damages = len(self._file.damages)

    def _note_in_file(self, words: str) -> None:
        self.note_damage(f"{self._name}: {words}")

    def note_damage(self, words: str) -> None:
        """Say once what was damaged."""
        log.warning("%s", words)
        self.damages.append(words)

    def _note_audit(self, words: str) -> None:
        self.audit_problem = self.audit_problem or words

    def _rows(self, statement: str, *parameters: object) -> list[tuple[Any, ...]]:
        """Rows that can be read now."""
        try:
            return self._file.rows(statement, *parameters)
        except DatabaseFailedError as error:
            log.warning("the diary cannot be read: %s", error)
            return []

    def _read(self, statement: str, *parameters: object) -> Iterator[LoggedEvent]:
        for row in self._rows(statement, *parameters):
            logged = tables.read(*row)
            if logged is not None:
                yield logged
            else:
                self._note_entry(row[0])

    def _note_entry(self, number: int) -> None:
        if number not in self._damaged_ids:
            self._damaged_ids.add(number)
            self.note_damage(f"{self._name}: entry {number} is damaged and left out")

    def _with_unsaved(
        self, found: Iterable[LoggedEvent], wanted: Callable[[LoggedEvent], bool]
    ) -> tuple[LoggedEvent, ...]:
        waiting = filter(wanted, list(self._unsaved.values()))
        return tuple(sorted({each.id: each for each in (*found, *waiting)}.values(), key=_number))


def _number(logged: LoggedEvent) -> int:
    return logged.id


def _key(event: Event) -> _Key:
    return event.time_ns, event.axis, event.kind, event.message
