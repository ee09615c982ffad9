"""Messages on disk until somebody has taken them."""

import asyncio
import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

_SCHEMA = """
CREATE TABLE IF NOT EXISTS messages (
    number INTEGER PRIMARY KEY AUTOINCREMENT, topic TEXT NOT NULL, payload BLOB NOT NULL
)
"""
_SESSIONS = 1 << 30
"""Number at which the numbers of connections begin anew; the file has 31 bits for them."""
_NEWEST = "SELECT MAX(number), topic, payload FROM messages GROUP BY topic"


class SpoolError(Exception):
    """The file cannot be used; the text is one line."""


@dataclass(frozen=True, slots=True)
class Message:
    """One message; `number` rises in the order in which they came."""

    number: int
    topic: str
    payload: bytes


class Spool:
    """A queue in an SQLite file. What was put in survives the process; the oldest go if it is full.

    Args:
        path: of the file; its folder is made.
        most: messages that it holds.

    Raises:
        SpoolError: the file cannot be opened, or is something else; later, that it cannot be read
            or written any more.
    """

    def __init__(self, path: Path, most: int) -> None:
        self._most = most
        self.dropped = 0
        """Messages that had to go because the spool or the disk was full."""
        self.newest: dict[str, Message] = {}
        """The newest message of each topic, taken or not, as far back as is known."""
        self._arrived = asyncio.Event()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = sqlite3.connect(path, isolation_level=None)
            self._file.execute("PRAGMA journal_mode = WAL")
            self._file.execute("PRAGMA synchronous = NORMAL")
            self._file.execute(_SCHEMA)
            (self._waiting,) = self._file.execute("SELECT COUNT(*) FROM messages").fetchone()
            for row in self._file.execute(_NEWEST):
                self.newest[row[1]] = Message(*row)
        except (sqlite3.Error, OSError) as error:
            raise SpoolError(f"{path}: cannot hold messages ({error})") from None

    def __len__(self) -> int:
        return int(self._waiting)

    def put(self, topic: str, payload: bytes) -> None:
        """Append a message; it is dropped, and counted, where the disk takes nothing."""
        try:
            added = self._ask("INSERT INTO messages (topic, payload) VALUES (?, ?)", topic, payload)
        except SpoolError:
            self.dropped += 1
            return
        self.newest[topic] = Message(added.lastrowid or 0, topic, payload)
        self._waiting += 1
        if self._waiting > self._most:
            self._drop(self._waiting - self._most)
        self._arrived.set()

    def oldest(self, count: int) -> list[Message]:
        """The messages that are to go first."""
        rows = self._ask(
            "SELECT number, topic, payload FROM messages ORDER BY number LIMIT ?", count
        )
        return [Message(*row) for row in rows]

    def remove(self, messages: Sequence[Message]) -> None:
        """Forget messages that have been taken."""
        for each in messages:
            done = self._ask("DELETE FROM messages WHERE number = ?", each.number)
            self._waiting -= done.rowcount

    @property
    def sessions(self) -> int:
        """Connections that have been counted, also before a restart."""
        (number,) = self._ask("PRAGMA user_version").fetchone()
        return int(number)

    def count_session(self) -> None:
        """Count a connection that was made."""
        self._ask(f"PRAGMA user_version = {(self.sessions + 1) % _SESSIONS}")

    async def wait(self) -> None:
        """Wait until there is a message."""
        while self._waiting == 0:
            self._arrived.clear()
            await self._arrived.wait()

    def close(self) -> None:
        """Close the file; safe twice."""
        self._file.close()

    def _drop(self, count: int) -> None:
        done = self._ask(
            "DELETE FROM messages WHERE number IN "
            "(SELECT number FROM messages ORDER BY number LIMIT ?)",
            count,
        )
        self._waiting -= done.rowcount
        self.dropped += done.rowcount

    def _ask(self, statement: str, *parameters: object) -> sqlite3.Cursor:
        try:
            return self._file.execute(statement, parameters)
        except sqlite3.Error as error:
            raise SpoolError(f"the buffer fails: {error}") from None
