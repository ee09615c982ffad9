"""SQLite file of a spool: checked when it is opened, set aside when it is damaged."""

import logging
import sqlite3
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from uuid import uuid4

from ...atomic import made_folder, set_aside, sync_folder
from .message import checksum, is_whole

log = logging.getLogger(__name__)
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
INSERT INTO figures SELECT COUNT(*), TOTAL(LENGTH(payload)), 0 FROM letters
    WHERE NOT EXISTS (SELECT 1 FROM figures);
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
_OLDER_LAYOUT = "SELECT topic, payload FROM messages ORDER BY number"
_DAMAGE = {sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB}


def connect(path: Path) -> sqlite3.Connection:
    """Open a spool's file, made if it is missing; a damaged one is set aside, what is whole in it
    goes on in a new one. Raises sqlite3.Error and OSError where nothing can be opened."""
    made_folder(path.parent)
    try:
        return _opened(path)
    except sqlite3.DatabaseError as error:
        if not is_damage(error):
            raise
        return begin_anew(path, str(error))


def connect_memory() -> sqlite3.Connection:
    """Open a spool that is kept in memory only."""
    return _laid_out(sqlite3.connect(":memory:", isolation_level=None))


def begin_anew(path: Path, problem: str) -> sqlite3.Connection:
    """Set a damaged file aside, and open a new one with what is whole in it."""
    aside = set_aside(path)
    for side in ("-wal", "-shm"):
        with suppress(FileNotFoundError):
            path.with_name(path.name + side).replace(f"{aside}{side}")
    connection = _opened(path)
    saved = 0
    with connection:
        connection.execute("BEGIN")
        for statement, row in _whole_rows(aside):
            saved += connection.execute(statement, row).rowcount
        connection.execute("COMMIT")
    log.warning("%s: damaged (%s), kept as %s; %d saved", path, problem, aside.name, saved)
    return connection


def is_damage(error: sqlite3.Error) -> bool:
    """Tell whether the file is no spool, or one no more."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF in _DAMAGE


def _opened(path: Path) -> sqlite3.Connection:
    connection = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
    try:
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA journal_size_limit = 4194304")
        connection.execute("PRAGMA cache_spill = OFF")
        (said,) = connection.execute("PRAGMA quick_check(1)").fetchone()
        if said != "ok":
            damage = sqlite3.DatabaseError(said.splitlines()[-1])
            damage.sqlite_errorcode = sqlite3.SQLITE_CORRUPT
            raise damage
        sync_folder(path.parent)
        return _laid_out(connection)
    except BaseException:
        connection.close()
        raise


def _laid_out(connection: sqlite3.Connection) -> sqlite3.Connection:
    """Tables of a spool, with what an older version left in its own."""
    connection.executescript(f"BEGIN; {SCHEMA} COMMIT;")
    older = "SELECT 1 FROM sqlite_master WHERE name = 'messages'"
    if connection.execute(older).fetchone():
        connection.execute("BEGIN")
        for topic, payload in connection.execute(_OLDER_LAYOUT):
            connection.execute(INSERT, new_row(topic, payload))
        connection.execute("DROP TABLE messages")
        connection.execute("COMMIT")
    return connection


def new_row(topic: str, payload: bytes) -> tuple[str, str, bytes, int]:
    """Row of a message that has just come."""
    key = uuid4().hex
    return key, topic, payload, checksum(key, topic, payload)


def _whole_rows(path: Path) -> Iterator[tuple[str, tuple[object, ...]]]:
    """What a damaged file still holds whole, with the statement that keeps it."""
    with (
        suppress(sqlite3.Error),
        closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as damaged,
    ):
        for statement, table in ((INSERT, "letters"), (BURIED, "dead")):
            for row in _rows(damaged, table, statement.partition("(")[2].partition(")")[0]):
                if is_whole(*row[:4]):
                    yield statement, row


def _rows(damaged: sqlite3.Connection, table: str, columns: str) -> list[tuple[object, ...]]:
    """Rows of a table that can be read, from both ends up to the damage, in their order."""
    found: dict[int, tuple[object, ...]] = {}
    for order in ("ASC", "DESC"):
        with suppress(sqlite3.Error):
            for number, *row in damaged.execute(
                f"SELECT number, {columns} FROM {table} ORDER BY number {order}"
            ):
                if number in found:
                    break
                found[number] = tuple(row)
    return [found[number] for number in sorted(found)]
