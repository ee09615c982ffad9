"""Tables of the diary: statements, check of every row, and what a damaged file still holds."""

import hashlib
import math
import sqlite3
from contextlib import suppress
from typing import Any

from pydantic import ValidationError

from ...clock import FUTURE_S, is_future
from ...messages.event import Event
from .audit import AUDIT_SCHEMA
from .kinds import room_of
from .log import LoggedEvent

SCHEMA = f"""
CREATE TABLE IF NOT EXISTS events (
    id INTEGER PRIMARY KEY, axis TEXT NOT NULL, room TEXT NOT NULL, time_ns INTEGER NOT NULL,
    body TEXT NOT NULL, digest TEXT NOT NULL
);
CREATE INDEX IF NOT EXISTS events_of_room ON events (axis, room);
CREATE INDEX IF NOT EXISTS events_of_time ON events (time_ns);
CREATE TABLE IF NOT EXISTS dropped (id INTEGER NOT NULL);
{AUDIT_SCHEMA}"""
_EVENTS = "SELECT id, body, digest FROM events"
NEWEST = f"{_EVENTS} ORDER BY id DESC LIMIT 1"
AFTER = f"{_EVENTS} WHERE id > ? ORDER BY id LIMIT ?"
BETWEEN = f"""{_EVENTS} NOT INDEXED
WHERE axis IN ('', ?) AND time_ns >= ? AND time_ns < ? ORDER BY id DESC LIMIT ?"""
NEWEST_OF_ROOM = f"{_EVENTS} WHERE axis = ? AND room = ? ORDER BY id DESC LIMIT 1"
DROPPED = "SELECT MAX(id) FROM dropped"
RECORDS = "SELECT * FROM audit WHERE number >= ? ORDER BY number LIMIT ?"
DATED_AFTER = "SELECT COUNT(*) FROM events WHERE time_ns > ?"
LAST_RECORD = "SELECT number FROM audit ORDER BY number DESC LIMIT 1"
ROWS = "SELECT id, body, digest, axis, room, time_ns FROM events WHERE id > ? ORDER BY id LIMIT ?"
_NEVER_NS = 2**63 - 1
_SURPLUS = """DELETE FROM events WHERE id IN (
    SELECT id FROM events WHERE axis = ? AND room = ?
    ORDER BY time_ns > ?, id DESC LIMIT -1 OFFSET ?
) RETURNING id"""


def write(file: sqlite3.Connection, logged: LoggedEvent) -> LoggedEvent:
    """Write an event within a transaction; with its number if it was there already."""
    event = logged.event
    body = event.model_dump_json()
    same = "SELECT id FROM events WHERE time_ns = ? AND body = ?"
    there = file.execute(same, (event.time_ns, body)).fetchone()
    if there is not None:
        return LoggedEvent(there[0], event)
    (last,) = file.execute("SELECT MAX(id) FROM events").fetchone()
    number = logged.id if last is None else max(logged.id, last + 1)
    put(file, number, event, body)
    return LoggedEvent(number, event)


def put(file: sqlite3.Connection, number: int, event: Event, body: str) -> None:
    """Write a row under a number, unless that is taken."""
    row = (number, *placed(LoggedEvent(number, event)), body, _digest(number, body))
    file.execute("INSERT OR IGNORE INTO events VALUES (?, ?, ?, ?, ?, ?)", row)


def read(number: int, body: Any, digest: Any) -> LoggedEvent | None:
    """Event of a row; None if the row is not what was written."""
    if digest != _digest(number, body):
        return None
    try:
        return LoggedEvent(number, Event.model_validate_json(body))
    except ValidationError:
        return None


def placed(logged: LoggedEvent) -> tuple[str, str, int]:
    """Values by which an event is found: axis, room, time."""
    event = logged.event
    return event.axis, room_of(event.kind)[0], event.time_ns


def place(file: sqlite3.Connection, logged: LoggedEvent) -> None:
    """Let an event be found again."""
    change = "UPDATE events SET axis = ?, room = ?, time_ns = ? WHERE id = ?"
    file.execute(change, (*placed(logged), logged.id))


def future_ns(now_ns: int) -> int:
    """UNIX time from which on events are dated after now, ns."""
    return now_ns + round(FUTURE_S * 1e9) if is_future(math.inf, now_ns / 1e9) else _NEVER_NS


def shrink(file: sqlite3.Connection, axis: str, room: str, most: int, future_ns: int) -> None:
    """Remove the events of a room beyond so many: from the future, then the oldest; note which."""
    surplus = file.execute(_SURPLUS, (axis, room, future_ns, most))
    gone = [number for (number,) in surplus]
    if gone:
        file.execute("DELETE FROM dropped WHERE id <= ?", (max(gone),))
        file.execute("INSERT INTO dropped VALUES (?)", (max(gone),))


def rescue(old: sqlite3.Connection, new: sqlite3.Connection) -> None:
    """Take over every row that is whole, from both ends up to what cannot be read."""
    new.execute("BEGIN")
    for order in ("", " DESC"):
        with suppress(sqlite3.Error):
            for row in old.execute(f"{_EVENTS} ORDER BY id{order}"):
                found = read(*row)
                if found is not None:
                    put(new, found.id, found.event, row[1])
        with suppress(sqlite3.Error):
            rows = old.execute(f"SELECT * FROM audit ORDER BY number{order}")
            new.executemany("INSERT OR IGNORE INTO audit VALUES (?, ?, ?, ?)", rows)
    with suppress(sqlite3.Error):
        new.executemany("INSERT INTO dropped VALUES (?)", old.execute("SELECT id FROM dropped"))
    new.execute("COMMIT")


def _digest(number: int, body: object) -> str:
    return hashlib.sha256(f"{number} {body}".encode()).hexdigest()[:16]
