"""Letters that an output still has to deliver: a cursor in the table of events, and no queue."""

import sqlite3
from collections.abc import Collection
from contextlib import suppress
from typing import NamedTuple

from ...clock import now_ns
from .events import SCHEMA as EVENTS
from .events import EventLog, StoredEvent, stored_event
from .store import Store, StoreFailedError

SCHEMA = """
CREATE TABLE IF NOT EXISTS outputs (name TEXT PRIMARY KEY, cursor INTEGER NOT NULL);
CREATE TABLE IF NOT EXISTS dead_letters (
    output TEXT NOT NULL, event_id INTEGER NOT NULL, time_ns INTEGER NOT NULL,
    reason TEXT NOT NULL, requeued INTEGER NOT NULL DEFAULT 0,
    PRIMARY KEY (output, event_id)
);
"""
KEPT_NS = 30 * 86_400 * 10**9
"""After so long an event is delivered no more, and a dead letter is gone."""
_WAITING = """
FROM events WHERE (id > :cursor OR id IN (
    SELECT event_id FROM dead_letters WHERE output = :output AND requeued
)) AND id > :oldest {kinds}
"""


class Counts(NamedTuple):
    """Letters of an output."""

    waiting: int
    dead: int
    oldest_ns: int | None  # UNIX time of the oldest one that waits, ns; None if none does


class Outbox:
    """Letters of one output. A new output begins with the events that come after its first use.

    Every method raises StoreFailedError.

    Args:
        kinds: kinds of events that the output delivers; None: all.
        log: of this process; what a failing disk leaves in its memory is delivered as well.
    """

    def __init__(
        self,
        store: Store,
        output: str,
        kinds: Collection[str] | None = None,
        log: EventLog | None = None,
    ) -> None:
        self._store, self._output, self._log, self._kinds = store, output, log, kinds
        self._unwritten: set[int] = set()
        names = {f"kind{number}": kind for number, kind in enumerate(kinds or ())}
        marks = ", ".join(f":{name}" for name in names)
        self._waiting = _WAITING.format(kinds="" if kinds is None else f"AND kind IN ({marks})")
        self._named = names | {"output": output}
        store.define(EVENTS)
        store.define(SCHEMA)

    def waiting(self, limit: int) -> list[StoredEvent]:
        """Events to deliver, oldest first."""
        cursor = max([self._cursor(), *self._unwritten])

        def work(file: sqlite3.Connection) -> list[StoredEvent]:
            statement = f"SELECT id, body, digest {self._waiting} ORDER BY id LIMIT :limit"
            values = self._named | {"cursor": cursor, "oldest": _oldest_id(), "limit": limit}
            rows = file.execute(statement, values)
            return [each for row in rows if (each := stored_event(*row)) is not None]

        found = {each.id: each for each in self._store.read(work)}
        for each in self._log.held() if self._log is not None else ():
            if each.id > cursor and (self._kinds is None or each.event.kind in self._kinds):
                found[each.id] = each
        return [found[number] for number in sorted(found.keys() - self._unwritten)][:limit]

    def delivered(self, event_id: int) -> None:
        """Pass over an event that was delivered; a disk that takes nothing does not double it."""
        self._unwritten.add(event_id)

        def work(file: sqlite3.Connection) -> None:
            for number in self._unwritten:
                letter = (self._output, number)
                file.execute("DELETE FROM dead_letters WHERE output = ? AND event_id = ?", letter)
            self._advance(file, max(self._unwritten))

        with suppress(StoreFailedError):  # the next one writes it
            self._store.write(work)
            self._unwritten.clear()

    def refused(self, event_id: int, reason: str) -> None:
        """Pass over an event that its receiver will never take: a dead letter, kept 30 days."""

        def work(file: sqlite3.Connection) -> None:
            row = (self._output, event_id, now_ns(), reason)
            file.execute("INSERT OR REPLACE INTO dead_letters VALUES (?, ?, ?, ?, 0)", row)
            old = "DELETE FROM dead_letters WHERE output = ? AND time_ns < ?"
            file.execute(old, (self._output, now_ns() - KEPT_NS))
            self._advance(file, event_id)

        self._store.write(work)

    def requeue(self) -> int:
        """Let all dead letters wait again; returns their number."""
        statement = "UPDATE dead_letters SET requeued = 1 WHERE output = ? AND NOT requeued"
        return self._store.write(lambda file: file.execute(statement, (self._output,)).rowcount)

    def drop(self) -> int:
        """Remove all dead letters; returns their number."""
        statement = "DELETE FROM dead_letters WHERE output = ? AND NOT requeued"
        return self._store.write(lambda file: file.execute(statement, (self._output,)).rowcount)

    def counts(self) -> Counts:
        """Letters that wait and dead ones."""
        cursor = self._cursor()

        def work(file: sqlite3.Connection) -> Counts:
            statement = f"SELECT COUNT(*), MIN(time_ns) {self._waiting}"
            values = self._named | {"cursor": cursor, "oldest": _oldest_id()}
            waiting, oldest_ns = file.execute(statement, values).fetchone()
            dead = "SELECT COUNT(*) FROM dead_letters WHERE output = ? AND NOT requeued"
            (count,) = file.execute(dead, (self._output,)).fetchone()
            return Counts(waiting, count, oldest_ns)

        return self._store.read(work)

    def _cursor(self) -> int:
        """Newest event that was passed over; that of a new output is the newest there is."""
        known = "SELECT cursor FROM outputs WHERE name = ?"
        row = self._store.read(lambda file: file.execute(known, (self._output,)).fetchone())
        return int(row[0]) if row else self._store.write(self._begin)

    def _begin(self, file: sqlite3.Connection) -> int:
        newest = "INSERT OR IGNORE INTO outputs SELECT ?, COALESCE(MAX(id), 0) FROM events"
        file.execute(newest, (self._output,))
        known = "SELECT cursor FROM outputs WHERE name = ?"
        (cursor,) = file.execute(known, (self._output,)).fetchone()
        return int(cursor)

    def _advance(self, file: sqlite3.Connection, event_id: int) -> None:
        self._begin(file)
        advance = "UPDATE outputs SET cursor = MAX(cursor, ?) WHERE name = ?"
        file.execute(advance, (event_id, self._output))


def _oldest_id() -> int:
    """Number above which events are young enough to be delivered: numbers are times in us."""
    return (now_ns() - KEPT_NS) // 1000
