"""Changes of a spool's file that are repeated until the disk takes them."""

import logging
import sqlite3
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...kept_database import DatabaseFailedError, KeptDatabase
from .file import SCHEMA, rescue
from .message import SpoolError

log = logging.getLogger(__name__)
MOST_UNWRITTEN = 2000
"""Changes that are kept in memory while the disk takes none."""
Change = tuple[str, Sequence[object]]


class _Undo(Exception):  # noqa: N818
    """Leaves a transaction without a trace."""


class Ledger:
    """A file of SQLite whose readers see every change, whether or not the disk took it.

    What could not be written is written with the next change. Until then it is put on top of what
    the file says whenever that is read; alone where the file cannot even be opened. For one thread.

    Attributes:
        problem: why the disk takes nothing; "" while it does.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = KeptDatabase(path, SCHEMA, rescue)
        self._unwritten: list[Change] = []
        self._told_damages = 0
        self.problem = ""

    @property
    def is_full(self) -> bool:
        """True if no further change can be kept."""
        return len(self._unwritten) >= MOST_UNWRITTEN

    def change(self, changes: Sequence[Change]) -> None:
        """Make changes, all or none; they are on the disk itself afterwards, unless `problem`."""
        self._unwritten += changes
        self.write_again()

    def write_again(self) -> None:
        """Write what could not be written."""
        try:
            with self._file.transaction() as file:
                self._replay(file)
        except DatabaseFailedError as error:
            self.problem = str(error)
        else:
            self._unwritten.clear()
            self.problem = ""
        self._tell_damages()

    def read(self, question: str, *values: object) -> list[Any]:
        """Rows that answer a question. Raises SpoolError if nothing can be read."""
        try:
            try:
                if self._unwritten:
                    return self._on_top(self._file, question, values)
                return self._file.rows(question, *values)
            except DatabaseFailedError as error:
                self.problem = str(error)
                return self._on_top(KeptDatabase(None, SCHEMA, rescue), question, values)
        except DatabaseFailedError as error:
            raise SpoolError(f"{self._path}: cannot hold messages ({error})") from None
        finally:
            self._tell_damages()

    def close(self) -> None:
        """Write what waits and close the file; safe twice."""
        if self._unwritten:
            self.write_again()
        self._file.close()

    def _on_top(self, file: KeptDatabase, question: str, values: Sequence[object]) -> list[Any]:
        """Answer with all changes made, and none of them written."""
        rows: list[Any] = []
        try:
            with file.transaction() as connection:
                connection.execute("PRAGMA cache_spill = OFF")
                self._replay(connection)
                rows = connection.execute(question, values).fetchall()
                raise _Undo
        except _Undo:
            return rows

    def _replay(self, connection: sqlite3.Connection) -> None:
        for statement, values in self._unwritten:
            connection.execute(statement, values)

    def _tell_damages(self) -> None:
        for damage in self._file.damages[self._told_damages :]:
            log.warning("%s", damage)
        self._told_damages = len(self._file.damages)
