"""Changes of a spool's file that are repeated until the disk takes them."""

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from .file import begin_anew, connect, connect_memory, is_damage
from .message import SpoolError

MOST_UNWRITTEN = 2000
"""Changes that are kept in memory while the disk takes none."""
Change = tuple[str, Sequence[object]]


class Ledger:
    """A file of SQLite whose readers see every change, whether or not the disk took it.

    What could not be written is written with the next change. Until then it is put on top of what
    the file says whenever that is read; alone where the file cannot even be opened. For one thread.

    Attributes:
        problem: why the disk takes nothing; "" while it does.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: sqlite3.Connection | None = None
        self._unwritten: list[Change] = []
        self.problem = ""

    @property
    def is_full(self) -> bool:
        """Whether no further change can be kept."""
        return len(self._unwritten) >= MOST_UNWRITTEN

    def change(self, changes: Sequence[Change], *, durable: bool = False) -> None:
        """Make changes, all or none; `durable` ones are on the disk itself afterwards."""
        self._unwritten += changes
        self._write(durable=durable)

    def write_again(self) -> None:
        """Try once more to write what could not be written."""
        if self._unwritten or self.problem:
            self._write(durable=True)

    def read(self, question: str, *values: object) -> list[Any]:
        """Rows that answer a question. Raises SpoolError if nothing can be read."""
        for answer in (self._from_file, self._from_file, self._from_memory):
            try:
                return answer(question, values)
            except (sqlite3.Error, OSError) as error:
                self._mend(error)
        raise SpoolError(f"{self._path}: cannot hold messages ({self.problem})")

    def close(self) -> None:
        """Write what waits and close the file; safe twice."""
        if self._unwritten:
            self._write(durable=True)
        if self._file is not None:
            self._file.close()
            self._file = None

    def _write(self, *, durable: bool) -> None:
        try:
            file = self._opened()
            if self._unwritten:
                file.execute(f"PRAGMA synchronous = {'FULL' if durable else 'NORMAL'}")
                self._replay(file)
                file.execute("COMMIT")
        except (sqlite3.Error, OSError) as error:
            self._mend(error)
        else:
            self._unwritten.clear()
            self.problem = ""

    def _from_file(self, question: str, values: Sequence[object]) -> list[Any]:
        file = self._opened()
        if not self._unwritten:
            return file.execute(question, values).fetchall()
        self._replay(file)
        try:
            return file.execute(question, values).fetchall()
        finally:
            _give_up(file)

    def _from_memory(self, question: str, values: Sequence[object]) -> list[Any]:
        with closing(connect_memory()) as memory:
            self._replay(memory)
            return memory.execute(question, values).fetchall()

    def _replay(self, connection: sqlite3.Connection) -> None:
        _give_up(connection)
        connection.execute("BEGIN IMMEDIATE")
        for statement, values in self._unwritten:
            connection.execute(statement, values)

    def _opened(self) -> sqlite3.Connection:
        if self._file is None:
            self._file = connect(self._path)
        return self._file

    def _mend(self, error: Exception) -> None:
        """Note what was wrong; begin anew where the file is damaged."""
        self.problem = str(error)
        if self._file is None:
            return
        _give_up(self._file)
        if isinstance(error, sqlite3.Error) and is_damage(error):
            self._file.close()
            self._file = None
            try:
                self._file = begin_anew(self._path, str(error))
            except (sqlite3.Error, OSError) as another:
                self.problem = str(another)


def _give_up(connection: sqlite3.Connection) -> None:
    if connection.in_transaction:
        connection.execute("ROLLBACK")
