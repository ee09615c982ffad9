"""Events: numbered, on the disk before anybody is told, each kind with its own room."""

import sqlite3
from collections.abc import Iterable
from dataclasses import dataclass
from zlib import crc32

from pydantic import ValidationError

from ...messages.event import Event

SCHEMA = """
CREATE TABLE IF NOT EXISTS events (
    id INTEGER PRIMARY KEY, time_ns INTEGER NOT NULL, axis TEXT NOT NULL, kind TEXT NOT NULL,
    body TEXT NOT NULL, digest INTEGER NOT NULL
);
CREATE INDEX IF NOT EXISTS events_by_kind ON events (kind, axis, id);
CREATE INDEX IF NOT EXISTS events_by_time ON events (time_ns);
"""
_NS_PER_US = 1000
_LATEST_US = 2**52
"""A clock that shows more gives no ids: they stay below 2**53, which JSON readers keep exactly."""


@dataclass(frozen=True, slots=True)
class StoredEvent:
    """An event with the number under which readers know it."""

    id: int
    event: Event


def append_events(
    file: sqlite3.Connection, events: Iterable[Event], now_ns: int
) -> list[StoredEvent]:
    """Number and keep events within a transaction; one that is there already keeps its number.

    Numbers grow, also across restarts and files: they start at the time in microseconds.
    """
    (last,) = file.execute("SELECT COALESCE(MAX(id), 0) FROM events").fetchone()
    now_us = now_ns // _NS_PER_US
    stored = []
    for event in events:
        body = event.model_dump_json()
        same = "SELECT id FROM events WHERE time_ns = ? AND body = ?"
        there = file.execute(same, (event.time_ns, body)).fetchone()
        if there is None:
            last = max(last + 1, now_us if now_us < _LATEST_US else 0)
            row = (last, event.time_ns, event.axis, event.kind, body, _digest(last, body))
            file.execute("INSERT INTO events VALUES (?, ?, ?, ?, ?, ?)", row)
        stored.append(StoredEvent(last if there is None else there[0], event))
    return stored


def stored_event(number: int, body: str, digest: int) -> StoredEvent | None:
    """Event of a row; None if the row is not what was written."""
    if digest != _digest(number, body):
        return None
    try:
        return StoredEvent(number, Event.model_validate_json(body))
    except ValidationError:
        return None


def _digest(number: int, body: str) -> int:
    return crc32(f"{number} {body}".encode())
