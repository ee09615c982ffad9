"""Head of the audit log, kept in a file beside the diary: what was cut off at the end is seen."""

import logging
import sqlite3
from collections.abc import Callable
from pathlib import Path

from pydantic import ValidationError

from ...atomic import DamagedError, read_checked, set_aside, write_checked
from ...messages.estimate import Frozen
from .audit import BREAK, FIRST_CHAIN, AuditEntry, append_row

log = logging.getLogger(__name__)
_NEWEST = "SELECT number, chain FROM audit ORDER BY number DESC LIMIT 1"
_AT = "SELECT chain FROM audit WHERE number = ?"


class Head(Frozen):
    """Number and chain of the newest entry."""

    number: int
    chain: str


def newest_of(file: sqlite3.Connection) -> Head:
    """Head of the audit log in a file."""
    row = file.execute(_NEWEST).fetchone()
    return Head(number=row[0], chain=row[1]) if row else Head(number=0, chain=FIRST_CHAIN)


class AuditHead:
    """The head as it was last written.

    Args:
        path: of the file; None: nothing is kept.
        on_damage: told of a damaged file, in a line.
    """

    def __init__(self, path: Path | None, on_damage: Callable[[str], None]) -> None:
        self._path, self._on_damage = path, on_damage
        self._known: Head | None = None
        self._is_read = path is None

    def mend(self, file: sqlite3.Connection, was_rescued: bool, now_ns: int) -> str:
        """Append, within a transaction, an entry that says what is gone at the end, if anything.

        Args:
            was_rescued: the file was damaged, and holds what could be saved.

        Returns:
            What is gone, or may be; empty if nothing is.

        Raises:
            OSError: the head cannot be read now.
        """
        if not self._is_read:
            self._known = self._read()
            self._is_read = True
        after, gone = _difference(file, self._known, was_rescued)
        if gone:
            entry = AuditEntry(
                time_ns=now_ns, who="edge-service", origin="service", action=BREAK, outcome=gone
            )
            append_row(file, after.number, after.chain, entry)
        return gone

    def follow(self, newest: Head) -> None:
        """Write the head, unless it is known; what fails is tried again with the next entry."""
        if self._path is None or newest == self._known:
            return
        try:
            write_checked(self._path, newest.model_dump_json())
        except OSError as error:
            log.warning("%s: cannot be written (%s)", self._path, error.strerror)
        else:
            self._known = newest

    def _read(self) -> Head | None:
        """Head that is kept; None if none is, or it is damaged. Raises OSError."""
        assert self._path is not None
        try:
            content = read_checked(self._path)
            return None if content is None else Head.model_validate_json(content)
        except DamagedError as error:
            words = str(error)
        except ValidationError:
            words = "it is not what was written"
        self._on_damage(f"{self._path}: {words}; kept as {set_aside(self._path).name}")
        return None


def _difference(
    file: sqlite3.Connection, known: Head | None, was_rescued: bool
) -> tuple[Head, str]:
    """Head after which the log goes on, and what is gone before."""
    newest = newest_of(file)
    if known is None:
        return newest, f"entries after {newest.number} may be gone" if was_rescued else ""
    if newest.number < known.number:
        return known, f"the entries {newest.number + 1} to {known.number} are gone"
    if known.number and file.execute(_AT, (known.number,)).fetchone() != (known.chain,):
        return newest, f"entry {known.number} is not what was written"
    return newest, ""
