"""Log of the reports of one machine: numbered 1, 2, 3 ... on the disk, for a plant to catch up."""

import json
import logging
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from uuid import uuid4
from zlib import crc32

from ...kept_database import DatabaseFailedError, KeptDatabase
from ...messages.plant import LogQuestion, LogState, MachineReport

log = logging.getLogger(__name__)
FILE = "@plant.sqlite"
MOST_ANSWER_BYTES = 1_000_000
"""Reports in one answer, but for the first, which is answered whatever its length."""
_ROW_BYTES = 50
_SCHEMA = """
CREATE TABLE IF NOT EXISTS log (name TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS reports (number INTEGER PRIMARY KEY, crc INTEGER NOT NULL,
    content BLOB NOT NULL);
"""
_STATE = "SELECT MIN(number), MAX(number) FROM reports"
_BYTES = f"SELECT COALESCE(SUM(LENGTH(content) + {_ROW_BYTES}), 0) FROM reports"
_OLDEST = f"SELECT number, LENGTH(content) + {_ROW_BYTES} FROM reports ORDER BY number LIMIT ?"
_AFTER = "SELECT number, crc, content FROM reports WHERE number > ? ORDER BY number LIMIT ?"
_STEP = 16


class ReportLog:
    """Log in one file, for one thread at a time.

    Args:
        path: of the file, which is made if there is none.
        most_bytes: of reports that are kept; the oldest go first.
    """

    def __init__(self, path: Path, most_bytes: int) -> None:
        self._path, self._most_bytes = path, most_bytes
        self._file = KeptDatabase(path, _SCHEMA, _begin_anew)
        self._bytes = 0
        self._state: LogState | None = None
        self._told = 0
        self.damaged = 0
        """Reports that were found damaged, and are left out of answers."""
        self.news: list[str] = []
        """Logs that were begun anew because the one before was damaged or is gone, a line each."""

    def state(self) -> LogState:
        """Name and numbers of the log now. Raises DatabaseFailedError."""
        with self._file.transaction() as file:
            found, total = self._found(file)
        self._settle(found, total)
        return found

    def append(self, report: MachineReport) -> LogState:
        """Keep a report under the next number; on the disk on return. DatabaseFailedError."""
        content = report.model_dump_json().encode()
        with self._file.transaction() as file:
            found, total = self._found(file)
            number = found.last + 1
            file.execute("INSERT INTO reports VALUES (?, ?, ?)", (number, crc32(content), content))
            total += len(content) + _ROW_BYTES
            first, total = self._pruned(file, found.first, number, total)
        state = found.model_copy(update={"first": first, "last": number})
        self._settle(state, total)
        return state

    def answer(self, question: LogQuestion) -> bytes:
        """Answer in JSON, a `LogAnswer`; of another log no report. Raises DatabaseFailedError."""
        name = self.state().log
        reports = self._whole(question.after, question.most) if question.log == name else ()
        told = ", ".join(f'{{"number": {number}, "report": {said}}}' for number, said in reports)
        return f'{{"log": {json.dumps(name)}, "reports": [{told}]}}'.encode()

    def _whole(self, after: int, most: int) -> Iterator[tuple[int, str]]:
        """Reports after a number that are as they were written, as long as they are short."""
        size, left = 0, most
        while left > 0:
            rows = self._file.rows(_AFTER, after, min(left, _STEP))
            for number, crc, content in rows:
                size += len(content)
                if size > MOST_ANSWER_BYTES and size > len(content):
                    return
                if crc32(content) == crc:
                    yield number, content.decode()
                else:
                    self.damaged += 1
                    log.warning("%s: report %d is damaged and left out", self._path, number)
                after = number
            left = left - _STEP if len(rows) == _STEP else 0

    def close(self) -> None:
        """Close the file; safe twice."""
        self._file.close()

    def _found(self, file: sqlite3.Connection) -> tuple[LogState, int]:
        """Name and numbers of the log as the file has them, and the bytes of its reports."""
        row = file.execute("SELECT name FROM log").fetchone()
        if row is None:
            row = (uuid4().hex,)
            file.execute("INSERT INTO log VALUES (?)", row)
        first, last = file.execute(_STATE).fetchone()
        found = LogState(log=str(row[0]), first=first or 1, last=last or 0)
        total = self._bytes
        if self._state is None or found.log != self._state.log:
            (total,) = file.execute(_BYTES).fetchone()
        return found, total

    def _settle(self, found: LogState, total: int) -> None:
        """Remember what is on the disk, and say if it is not the log that was known."""
        news = self._file.damages[self._told :]
        self._told += len(news)
        if self._state is not None and found.log != self._state.log and not news:
            news = [f"{self._path}: it is gone; a new log is begun"]
        for words in news:
            log.warning("%s", words)
        self.news.extend(news)
        self._state, self._bytes = found, total

    def _pruned(
        self, file: sqlite3.Connection, first: int, last: int, total: int
    ) -> tuple[int, int]:
        """Number of the oldest report, and their bytes, after the oldest made room."""
        while total > self._most_bytes and first < last:
            for number, size in file.execute(_OLDEST, (_STEP,)).fetchall():
                if total <= self._most_bytes or number == last:
                    break
                total, first = total - size, number + 1
            file.execute("DELETE FROM reports WHERE number < ?", (first,))
        return first, total


def _begin_anew(_old: sqlite3.Connection, _new: sqlite3.Connection) -> None:
    """Take over nothing: with a hole in the numbers nobody could tell what is missing."""


__all__ = ["FILE", "DatabaseFailedError", "ReportLog"]
