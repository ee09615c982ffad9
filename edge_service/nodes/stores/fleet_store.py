"""Store of a fleet node: machines that are known, and what their logs say of the past."""

import json
import logging
import sqlite3
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

from ...health.fleet.backfill import Caught
from ...kept_database import KeptDatabase
from ...messages.fleet import Cursor, HistoryPoint, HistoryQuestion, Hole, KnownMachine
from ...messages.plant import LoggedReport

log = logging.getLogger(__name__)
FILE = "fleet.sqlite"
_SCHEMA = """
CREATE TABLE IF NOT EXISTS machine (id INTEGER PRIMARY KEY, site TEXT NOT NULL,
    machine TEXT NOT NULL, axes TEXT NOT NULL, heard_ns INTEGER NOT NULL,
    removed_ns INTEGER NOT NULL, log TEXT, number INTEGER, UNIQUE (site, machine));
CREATE TABLE IF NOT EXISTS log (id INTEGER PRIMARY KEY, machine INTEGER NOT NULL,
    name TEXT NOT NULL, UNIQUE (machine, name));
CREATE TABLE IF NOT EXISTS point (log INTEGER NOT NULL, axis TEXT NOT NULL,
    number INTEGER NOT NULL, time_ns INTEGER NOT NULL, condition TEXT NOT NULL, percent REAL,
    low REAL, high REAL, fresh REAL, PRIMARY KEY (log, axis, number)) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS point_time ON point (time_ns);
CREATE TABLE IF NOT EXISTS hole (log INTEGER NOT NULL, first INTEGER NOT NULL,
    last INTEGER NOT NULL, PRIMARY KEY (log, first)) WITHOUT ROWID;
"""
_TABLES = ("machine", "log", "point", "hole")
_KNOW = """INSERT INTO machine (site, machine, axes, heard_ns, removed_ns, log, number)
VALUES (?, ?, ?, ?, ?, ?, ?) ON CONFLICT (site, machine) DO UPDATE SET axes = excluded.axes,
heard_ns = MAX(heard_ns, excluded.heard_ns), removed_ns = MAX(removed_ns, excluded.removed_ns)"""
_KNOWN = "SELECT site, machine, axes, heard_ns, removed_ns, log, number FROM machine"
_PAST = """SELECT log.name, point.number, time_ns, condition, percent, low, high, fresh
FROM point JOIN log ON log.id = point.log JOIN machine ON machine.id = log.machine
WHERE site = ? AND machine.machine = ? AND axis = ? AND time_ns >= ?
ORDER BY time_ns DESC, point.number DESC LIMIT ?"""
_HOLES = """SELECT log.name, first, last FROM hole JOIN log ON log.id = hole.log
JOIN machine ON machine.id = log.machine WHERE site = ? AND machine.machine = ?
ORDER BY hole.log, first LIMIT 1000"""
_SIZE = """SELECT (page_count - freelist_count) * page_size
FROM pragma_page_count, pragma_freelist_count, pragma_page_size"""
_LOOK_EVERY = 100
_LEAVE = 0.9
"""Share of the budget down to which the oldest go."""


class FleetStore:
    """Store in one file, for one thread at a time.

    Args:
        path: of the file; None keeps it in memory.
        most_bytes: of history that is kept.
    """

    def __init__(self, path: Path | None, most_bytes: float) -> None:
        self._file = KeptDatabase(path, _SCHEMA, _rescue)
        self._most_bytes = most_bytes
        self._since_looked = 0
        self.dropped = 0
        """Points that went since the budget was used up."""

    def known(self) -> list[KnownMachine]:
        """Machines that were ever known. Raises DatabaseFailedError."""
        return [
            KnownMachine(
                site=site,
                machine=machine,
                axes=tuple(json.loads(axes)),
                heard_ns=heard_ns,
                removed_ns=removed_ns,
                cursor=None if name is None else Cursor(log=name, number=number),
            )
            for site, machine, axes, heard_ns, removed_ns, name, number in self._file.rows(_KNOWN)
        ]

    def know(self, machines: Iterable[KnownMachine]) -> None:
        """Keep that these machines are known. Raises DatabaseFailedError."""
        with self._file.transaction() as file:
            for each in machines:
                self._know(file, each)

    def keep(self, caught: Sequence[tuple[KnownMachine, Caught]]) -> None:
        """Keep what was caught up, each with its cursor, whole or not at all.

        Raises DatabaseFailedError.
        """
        with self._file.transaction() as file:
            for machine, more in caught:
                self._know(file, machine)
                self._add(file, machine.name, more)
        self._since_looked += len(caught)
        if self._since_looked >= _LOOK_EVERY:
            self._since_looked = 0
            self.prune()

    def past(self, question: HistoryQuestion) -> tuple[list[HistoryPoint], list[Hole]]:
        """Kept past of one axis, the oldest first. Raises DatabaseFailedError."""
        site, machine, axis = question.site, question.machine, question.axis
        found = self._file.rows(_PAST, site, machine, axis, question.since_ns, question.most)
        names = ("log", "number", "time_ns", "condition", "preload_percent", "low", "high")
        columns = (*names, "fresh_percent")
        points = [
            HistoryPoint.model_validate(dict(zip(columns, row, strict=True)))
            for row in reversed(found)
        ]
        holes = [
            Hole(log=name, first=first, last=last)
            for name, first, last in self._file.rows(_HOLES, site, machine)
        ]
        return points, holes

    def size_bytes(self) -> int:
        """Size of what is kept. Raises DatabaseFailedError."""
        return int(self._file.rows(_SIZE)[0][0])

    def prune(self) -> None:
        """Let the oldest go if there is more than the budget. Raises DatabaseFailedError."""
        size = self.size_bytes()
        if size <= self._most_bytes:
            return
        with self._file.transaction() as file:
            ((count,),) = file.execute("SELECT COUNT(*) FROM point").fetchall()
            excess = int(count * (1.0 - _LEAVE * self._most_bytes / size)) + 1
            oldest = "SELECT time_ns FROM point ORDER BY time_ns LIMIT 1 OFFSET ?"
            bound = file.execute(oldest, (min(excess, max(count - 1, 0)),)).fetchall()
            if bound:
                gone = file.execute("DELETE FROM point WHERE time_ns < ?", bound[0])
                self.dropped += gone.rowcount

    def copy(self, now_s: float) -> None:
        """Make the daily copy if it is due. Raises DatabaseFailedError."""
        self._file.copy(now_s)

    def damages(self) -> list[str]:
        """Damaged files that were set aside, a line each."""
        return self._file.damages

    def close(self) -> None:
        """Close the file; safe twice."""
        self._file.close()

    def _know(self, file: sqlite3.Connection, machine: KnownMachine) -> None:
        cursor = machine.cursor
        place = (None, None) if cursor is None else (cursor.log, cursor.number)
        times = (machine.heard_ns, machine.removed_ns)
        file.execute(_KNOW, (*machine.name, json.dumps(machine.axes), *times, *place))

    def _add(self, file: sqlite3.Connection, name: tuple[str, str], more: Caught) -> None:
        one = "SELECT id FROM machine WHERE site = ? AND machine = ?"
        ((machine,),) = file.execute(one, name).fetchall()
        file.execute(
            "UPDATE machine SET log = ?, number = ? WHERE id = ?",
            (more.cursor.log, more.cursor.number, machine),
        )
        file.execute(
            "INSERT OR IGNORE INTO log (machine, name) VALUES (?, ?)", (machine, more.cursor.log)
        )
        one = "SELECT id FROM log WHERE machine = ? AND name = ?"
        ((log_id,),) = file.execute(one, (machine, more.cursor.log)).fetchall()
        file.executemany(
            "INSERT OR IGNORE INTO point VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (row for each in more.reports for row in _rows(log_id, each)),
        )
        file.executemany(
            "INSERT OR IGNORE INTO hole VALUES (?, ?, ?)",
            ((log_id, hole.first, hole.last) for hole in more.holes),
        )


def _rows(log_id: int, logged: LoggedReport) -> list[tuple[object, ...]]:
    """Rows of one report, one for each axis."""
    return [
        (
            log_id,
            axis.axis,
            logged.number,
            logged.report.time_ns,
            axis.condition.value,
            axis.preload_percent,
            axis.low,
            axis.high,
            axis.fresh_percent,
        )
        for axis in logged.report.axes
    ]


def _rescue(old: sqlite3.Connection, new: sqlite3.Connection) -> None:
    """Take over every row that is whole; what was not saved is fetched again."""
    new.execute("BEGIN")
    for table in _TABLES:
        with suppress(sqlite3.Error):
            for row in old.execute(f"SELECT * FROM {table}"):
                places = ", ".join("?" * len(row))
                with suppress(sqlite3.Error):
                    new.execute(f"INSERT OR IGNORE INTO {table} VALUES ({places})", row)
    new.execute("UPDATE machine SET log = NULL, number = NULL")
    new.execute("COMMIT")
