"""Tables of a spool's file, and what is saved of a damaged one."""

import sqlite3
from collections.abc import Iterator
from contextlib import suppress
from uuid import uuid4

from .message import checksum, is_whole

SCHEMA = """
CREATE TABLE IF NOT EXISTS letters (
    number INTEGER PRIMARY KEY AUTOINCREMENT, key TEXT NOT NULL UNIQUE, topic TEXT NOT NULL,
    payload BLOB NOT NULL, checksum INTEGER NOT NULL,
    refusals INTEGER NOT NULL DEFAULT 0, delays INTEGER NOT NULL DEFAULT 0
);
CREATE TABLE IF NOT EXISTS dead (
    number INTEGER PRIMARY KEY AUTOINCREMENT, key TEXT NOT NULL UNIQUE, topic TEXT NOT NULL,
    payload BLOB NOT NULL, checksum INTEGER NOT NULL,
    tries INTEGER NOT NULL, reason TEXT NOT NULL, time_ns INTEGER NOT NULL
);
CREATE TABLE IF NOT EXISTS figures (
    waiting INTEGER NOT NULL, bytes INTEGER NOT NULL, mark INTEGER NOT NULL
);
INSERT INTO figures SELECT 0, 0, 0 WHERE NOT EXISTS (SELECT 1 FROM figures);
CREATE TRIGGER IF NOT EXISTS came AFTER INSERT ON letters BEGIN
    UPDATE figures SET waiting = waiting + 1, bytes = bytes + LENGTH(new.payload);
END;
CREATE TRIGGER IF NOT EXISTS went AFTER DELETE ON letters BEGIN
    UPDATE figures SET waiting = waiting - 1, bytes = bytes - LENGTH(old.payload);
END;
"""
INSERT = "INSERT OR IGNORE INTO letters (key, topic, payload, checksum) VALUES (?, ?, ?, ?)"
BURIED = (
    "INSERT OR IGNORE INTO dead (key, topic, payload, checksum, tries, reason, time_ns) "
    "VALUES (?, ?, ?, ?, ?, ?, ?)"
)
_KEPT = ((INSERT, "letters"), (BURIED, "dead"))
Row = tuple[object, ...]


def new_row(topic: str, payload: bytes) -> tuple[str, str, bytes, int]:
    """Row of a message that has just come."""
    key = uuid4().hex
    return key, topic, payload, checksum(key, topic, payload)


def rescue(damaged: sqlite3.Connection, file: sqlite3.Connection) -> None:
    """Take over the letters that are whole, and all of a file of an older version."""
    for statement, table in _KEPT:
        columns = statement.partition("(")[2].partition(")")[0]
        for row in _rows(damaged, table, columns):
            if is_whole(*row[:4]):
                file.execute(statement, row)
    for topic, payload in _rows(damaged, "messages", "topic, payload"):
        if isinstance(topic, str) and isinstance(payload, bytes):
            file.execute(INSERT, new_row(topic, payload))
    with suppress(sqlite3.Error):
        ((sessions,),) = damaged.execute("PRAGMA user_version").fetchall()
        file.execute(f"PRAGMA user_version = {int(sessions)}")
        ((mark,),) = damaged.execute("SELECT mark FROM figures").fetchall()
        file.execute("UPDATE figures SET mark = ?", (int(mark),))


def _rows(damaged: sqlite3.Connection, table: str, columns: str) -> Iterator[Row]:
    """Rows of a table that can be read, from both ends up to the damage, in their order."""
    found: dict[int, Row] = {}
    for order in ("ASC", "DESC"):
        with suppress(sqlite3.Error):
            for number, *row in damaged.execute(
                f"SELECT number, {columns} FROM {table} ORDER BY number {order}"
            ):
                if number in found:
                    break
                found[number] = tuple(row)
    for number in sorted(found):
        yield found[number]
