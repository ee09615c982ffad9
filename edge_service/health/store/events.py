"""Events: numbered, on the disk before anybody is told, each kind with its own room."""

import logging
import sqlite3
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from pydantic import ValidationError

from ...messages.event import Event
from ...messages.interval import EXACT
from .store import SCHEMA as STATES
from .store import State, Store, StoreFailedError, digest, put_state

log = logging.getLogger(__name__)
SCHEMA = """
CREATE TABLE IF NOT EXISTS events (
    id INTEGER PRIMARY KEY, time_ns INTEGER NOT NULL, axis TEXT NOT NULL, kind TEXT NOT NULL,
    body TEXT NOT NULL, digest INTEGER NOT NULL
);
CREATE INDEX IF NOT EXISTS events_by_kind ON events (kind, axis, id);
CREATE INDEX IF NOT EXISTS events_by_time ON events (time_ns);
CREATE TABLE IF NOT EXISTS dropped_events (id INTEGER PRIMARY KEY);
"""
MOST_CHATTER, MOST_KEPT = 20_000, 100_000
"""Events of a kind that are kept of an axis: of what happens all the time, and of the rest."""
CHATTER = ("status_changed", "component_changed", "data_fault")
KINDS = (
    "alarm_raised",
    "alarm_cleared",
    "alarm_acknowledged",
    "alarm_shelved",
    "alarm_unshelved",
    "condition_changed",
    *CHATTER,
    "note",
    "part_replaced",
    "preload_rose",
    "model_disagrees",
    "model_agrees",
    "recording_kept",
    "clock_changed",
    "estimator_reset",
    "tested",
    "store_damaged",
    "store_failing",
    "store_recovered",
    "service_started",
    "command",
)
"""Every kind of event of the service."""
_NS_PER_US = 1000
_LATEST_US = 2**52
"""A clock that shows more gives no ids: they stay below 2**53, which JSON readers keep exactly."""
_GREATEST = 2**63 - 1
_MOST_WAITING = 20_000
_SURPLUS = """DELETE FROM events WHERE id IN (
    SELECT id FROM events WHERE kind = ? AND axis = ? ORDER BY id DESC LIMIT -1 OFFSET ?
) RETURNING id"""


@dataclass(frozen=True, slots=True)
class StoredEvent:
    """An event with the number under which readers know it."""

    id: int
    event: Event


class EventLog:
    """Events of a service, for any thread, and the states of the axes that they led to.

    What the disk does not take waits in memory, in bounded number, and is written with the next
    `save`. An event that is there already is not doubled. One that cannot be written at all is set
    aside and counted, and holds up no other.
    """

    def __init__(self, store: Store) -> None:
        self.store = store
        store.define(SCHEMA)
        store.define(STATES)
        self._lock, self._saving = threading.Lock(), threading.Lock()
        self._waiting: dict[tuple[int, str, str, str], StoredEvent] = {}
        self._states: dict[tuple[str, str], State] = {}
        self._last_id = 0
        self._damaged_ids: set[int] = set()
        self.lost = self.set_aside = 0
        """Events that found no place in memory, and events that cannot be written."""

    def put(
        self, events: Iterable[Event], now_ns: int, states: Iterable[State] = ()
    ) -> list[StoredEvent]:
        """Number events, and keep them in memory with states until the next `save`."""
        with self._lock:
            for state in states:
                self._states[state.name, state.axis] = state
            return [self._number(event, now_ns) for event in events]

    def save(self) -> dict[int, int]:
        """Write all that waits, in one transaction; the numbers under which events are kept now.

        Raises StoreFailedError: all of it goes on waiting.
        """
        with self._saving:
            with self._lock:
                waiting, states = list(self._waiting.items()), dict(self._states)
            if not waiting and not states:
                return {}
            try:
                numbers = self._write([each for _, each in waiting], list(states.values()))
            except StoreFailedError:
                self._bound()
                raise
            with self._lock:
                for key, _ in waiting:
                    del self._waiting[key]
                for place, state in states.items():
                    if self._states.get(place) is state:
                        del self._states[place]
            return numbers

    def add(self, events: Iterable[Event], now_ns: int) -> list[StoredEvent]:
        """Keep events at once; on the disk when it returns. Raises StoreFailedError."""
        put = self.put(events, now_ns)
        numbers = self.save()
        return [StoredEvent(numbers.get(each.id, each.id), each.event) for each in put]

    def held(self) -> list[StoredEvent]:
        """Events that a failing disk leaves in memory, oldest first."""
        with self._lock:
            return list(self._waiting.values()) if self.store.problem else []

    @property
    def waiting(self) -> int:
        """Events that are not on the disk yet."""
        return len(self._waiting)

    def last_id(self) -> int:
        """Number of the newest event; 0 before the first. Raises StoreFailedError."""
        newest = "SELECT COALESCE(MAX(id), 0) FROM events"
        (last,) = self.store.read(lambda file: file.execute(newest).fetchone())
        return max(int(last), self._last_id)

    def after(self, last_id: int, most: int) -> list[StoredEvent]:
        """First `most` events with a higher number, oldest first. Raises StoreFailedError."""
        condition, values = "id > ? ORDER BY id LIMIT ?", (min(last_id, _GREATEST), most)
        return self._found(condition, values, lambda each: each.id > last_id)[:most]

    def page(
        self,
        most: int,
        axis: str | None = None,
        kinds: Iterable[str] = (),
        start_ns: int = 0,
        end_ns: int = _GREATEST,
        before_id: int = _GREATEST,
    ) -> list[StoredEvent]:
        """Newest events in [start_ns, end_ns), newest first. Raises StoreFailedError.

        Args:
            axis: its events and those of the service; None: of all axes.
            kinds: wanted kinds; empty: all.
            before_id: events with lower numbers are wanted.
        """
        wanted, axes = frozenset(kinds), () if axis is None else ("", axis)

        def fits(each: StoredEvent) -> bool:
            event = each.event
            is_wanted = (not wanted or event.kind in wanted) and (not axes or event.axis in axes)
            return is_wanted and start_ns <= event.time_ns < end_ns and each.id < before_id

        condition = "time_ns >= ? AND time_ns < ? AND id < ?"
        for column, among in (("kind", wanted), ("axis", axes)):
            if among:
                condition += f" AND {column} IN ({', '.join('?' * len(among))})"
        limits = [min(each, _GREATEST) for each in (max(start_ns, 0), end_ns, before_id)]
        values = (*limits, *wanted, *axes, most)
        return self._found(f"{condition} ORDER BY id DESC LIMIT ?", values, fits)[::-1][:most]

    def holds_all_after(self, last_id: int) -> bool:
        """Return whether no later event had to make room. Raises StoreFailedError."""
        dropped = "SELECT MAX(id) FROM dropped_events"
        (newest,) = self.store.read(lambda file: file.execute(dropped).fetchone())
        return newest is None or last_id >= newest

    def counters(self) -> dict[str, int]:
        """Counts of what waits, and of what was lost, set aside or damaged since the start."""
        return {
            "events_waiting": self.waiting,
            "events_lost": self.lost,
            "events_set_aside": self.set_aside,
            "events_damaged": len(self._damaged_ids),
            "damaged_files": len(self.store.damages),
        }

    def _number(self, event: Event, now_ns: int) -> StoredEvent:
        key = event.time_ns, event.axis, event.kind, event.text
        if key not in self._waiting:
            now_us = now_ns // _NS_PER_US
            self._last_id = max(self._last_id + 1, now_us if now_us < _LATEST_US else 0)
            self._waiting[key] = StoredEvent(self._last_id, event)
        return self._waiting[key]

    def _write(self, waiting: list[StoredEvent], states: list[State]) -> dict[int, int]:
        """Write all at once, or each alone where one of them cannot be written at all."""

        def work(file: sqlite3.Connection) -> dict[int, int]:
            for state in states:
                put_state(file, state)
            numbers = append_events(file, waiting)
            for room, axis in {(room_of(each.event.kind), each.event.axis) for each in waiting}:
                _prune(file, room, axis)
            return numbers

        try:
            return self.store.write(work)
        except (ArithmeticError, ValueError, TypeError, sqlite3.Error) as error:
            if len(waiting) + len(states) == 1:
                self.set_aside += 1
                what = waiting[0].event if waiting else f"state of axis {states[0].axis}"
                log.warning("cannot be kept, and is set aside (%s): %s", error, what)
                return {}
        alone = [self._write([each], []) for each in waiting]
        alone += [self._write([], [each]) for each in states]
        return {before: after for each in alone for before, after in each.items()}

    def _bound(self) -> None:
        """Keep what waits within bounds: what happens all the time goes first."""
        with self._lock:
            while len(self._waiting) > _MOST_WAITING:
                often = (key for key, each in self._waiting.items() if is_chatter(each.event.kind))
                del self._waiting[next(often, next(iter(self._waiting)))]
                self.lost += 1

    def _found(
        self, condition: str, values: Sequence[object], fits: Callable[[StoredEvent], bool]
    ) -> list[StoredEvent]:
        """Events of the file and fitting ones that wait for it, by number."""
        statement = f"SELECT id, body, digest FROM events WHERE {condition}"
        rows = self.store.read(lambda file: file.execute(statement, values).fetchall())
        with self._lock:
            found = {each.id: each for each in self._waiting.values() if fits(each)}
        for row in rows:
            stored = stored_event(*row)
            if stored is not None:
                found[stored.id] = stored
            elif row[0] not in self._damaged_ids:
                self._damaged_ids.add(row[0])
                self.store.damages.append(f"event {row[0]} is damaged and left out")
        return [found[number] for number in sorted(found)]


def room_of(kind: str) -> str:
    """Room of a kind: its own, or that of all unknown kinds."""
    return kind if kind in KINDS else "other"


def is_chatter(kind: str) -> bool:
    """Return whether an event is of a kind so frequent that none waits for it."""
    return kind in CHATTER or kind not in KINDS


def append_events(file: sqlite3.Connection, events: Iterable[StoredEvent]) -> dict[int, int]:
    """Keep events within a transaction; the numbers that they have now, by those proposed.

    One that is there already keeps its number; a number that is taken becomes a greater one.
    """
    (last,) = file.execute("SELECT COALESCE(MAX(id), 0) FROM events").fetchone()
    numbers = {}
    for each in events:
        event, body = each.event, each.event.model_dump_json(context=EXACT)
        same = "SELECT id FROM events WHERE time_ns = ? AND body = ?"
        there = file.execute(same, (event.time_ns, body)).fetchone()
        if there is None:
            last = max(last + 1, each.id)
            place = (last, event.time_ns, event.axis, room_of(event.kind))
            insert = "INSERT INTO events VALUES (?, ?, ?, ?, ?, ?)"
            file.execute(insert, (*place, body, digest(last, body)))
        numbers[each.id] = last if there is None else int(there[0])
    return numbers


def stored_event(number: int, body: str, checksum: int) -> StoredEvent | None:
    """Event of a row; None if the row is not what was written."""
    if checksum != digest(number, body):
        return None
    try:
        return StoredEvent(number, Event.model_validate_json(body))
    except ValidationError:
        return None


def _prune(file: sqlite3.Connection, room: str, axis: str) -> None:
    most = MOST_CHATTER if is_chatter(room) else MOST_KEPT
    gone = [number for (number,) in file.execute(_SURPLUS, (room, axis, most))]
    if gone:
        file.execute("DELETE FROM dropped_events WHERE id <= ?", (max(gone),))
        file.execute("INSERT OR IGNORE INTO dropped_events VALUES (?)", (max(gone),))
