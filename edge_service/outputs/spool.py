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
        SpoolError: the file cannot be opened, or is something else.
    """

    def __init__(self, path: Path, most: int) -> None:
        self._most = most
        self.dropped = 0
        """Messages that had to go because the spool was full."""
        self._arrived = asyncio.Event()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = sqlite3.connect(path, isolation_level=None)
            self._file.execute("PRAGMA journal_mode = WAL")
            self._file.execute("PRAGMA synchronous = NORMAL")
            self._file.execute(_SCHEMA)
            (self._waiting,) = self._file.execute("SELECT COUNT(*) FROM messages").fetchone()
        except (sqlite3.Error, OSError) as error:
            raise SpoolError(f"{path}: cannot hold messages ({error})") from None

    def __len__(self) -> int:
        return int(self._waiting)

    def put(self, topic: str, payload: bytes) -> None:
        """Append a message."""
        self._file.execute("INSERT INTO messages (topic, payload) VALUES (?, ?)", (topic, payload))
        self._waiting += 1
        if self._waiting > self._most:
            self._drop(self._waiting - self._most)
        self._arrived.set()

    def oldest(self, count: int) -> list[Message]:
        """The messages that are to go first."""
        rows = self._file.execute(
            "SELECT number, topic, payload FROM messages ORDER BY number LIMIT ?", (count,)
        )
        return [Message(*row) for row in rows]

    def remove(self, messages: Sequence[Message]) -> None:
        """Forget messages that have been taken."""
        done = self._file.executemany(
            "DELETE FROM messages WHERE number = ?", [(each.number,) for each in messages]
        )
        self._waiting -= done.rowcount

    async def wait(self) -> None:
        """Until there is a message."""
        while self._waiting == 0:
            self._arrived.clear()
            await self._arrived.wait()

    def close(self) -> None:
        """Close the file; safe twice."""
        self._file.close()

    def _drop(self, count: int) -> None:
        done = self._file.execute(
            "DELETE FROM messages WHERE number IN "
            "(SELECT number FROM messages ORDER BY number LIMIT ?)",
            (count,),
        )
        self._waiting -= done.rowcount
        self.dropped += done.rowcount
