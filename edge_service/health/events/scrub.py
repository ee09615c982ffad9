"""Scrub of the diary: every row is read once after the start and once a day, a few at a time."""

from collections.abc import Callable

from ...kept_database import DatabaseFailedError, KeptDatabase
from . import tables
from .audit import BREAK, AuditRecord, checked

_ROWS = 1000
_PERIOD_S = 86400.0


class Scrub:
    """Looks for damage that no question would meet: entries that nobody asks for, or cannot find.

    Args:
        on_entry: told the number of an event that is not what was written.
        on_damage: told of other damage, in a line.
        on_audit: told of what is wrong with the audit log, in a line.
    """

    def __init__(
        self,
        on_entry: Callable[[int], None],
        on_damage: Callable[[str], None],
        on_audit: Callable[[str], None],
    ) -> None:
        self._on_entry, self._on_damage, self._on_audit = on_entry, on_damage, on_audit
        self._event = self._record = 0
        self._ended_s: float | None = None
        self._known: set[int] = set()

    def go_on(self, file: KeptDatabase, now_s: float) -> None:
        """Look at the next rows; a file that cannot be read now is looked at later."""
        if self._ended_s is not None and abs(now_s - self._ended_s) < _PERIOD_S:
            return
        try:
            more = [self._events(file), self._records(file)]
        except DatabaseFailedError:
            return
        self._ended_s = None if any(more) else now_s
        if not any(more):
            self._event = self._record = 0

    def _events(self, file: KeptDatabase) -> bool:
        rows = file.rows(tables.ROWS, self._event, _ROWS)
        for number, body, digest, *place in rows:
            self._event = number
            logged = tables.read(number, body, digest)
            if logged is None:
                self._on_entry(number)
            elif tuple(place) != tables.placed(logged):
                self._on_damage(f"entry {number} could not be found; it can again")
                with file.transaction() as changed:
                    tables.place(changed, logged)
        return len(rows) == _ROWS

    def _records(self, file: KeptDatabase) -> bool:
        rows = file.rows(tables.RECORDS, self._record, _ROWS)
        for record in checked(rows, self._record + 1):
            self._record = record.number
            if record.problem and record.number not in self._known:
                self._known.add(record.number)
                self._note(record)
        return len(rows) == _ROWS

    def _note(self, record: AuditRecord) -> None:
        """Tell of an entry; what a break in the log says was told when it was made."""
        words = f"entry {record.number} of the audit log: {record.problem}"
        self._on_audit(words)
        if record.entry is None or record.entry.action != BREAK:
            self._on_damage(words)
