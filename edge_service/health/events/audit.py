"""Audit log: who changed what, when and from where; entries are chained, and none is removed."""

import hashlib
import json
import sqlite3
from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from ...messages.estimate import Frozen

AUDIT_SCHEMA = """
CREATE TABLE IF NOT EXISTS audit (
    number INTEGER PRIMARY KEY, time_ns INTEGER NOT NULL, body TEXT NOT NULL, chain TEXT NOT NULL
);
CREATE TRIGGER IF NOT EXISTS audit_is_not_changed BEFORE UPDATE ON audit
    BEGIN SELECT RAISE(ABORT, 'the audit log is only appended to'); END;
CREATE TRIGGER IF NOT EXISTS audit_is_not_shortened BEFORE DELETE ON audit
    BEGIN SELECT RAISE(ABORT, 'the audit log is only appended to'); END;
"""
FIRST_CHAIN = "0" * 64
BREAK = "audit_log_damaged"
"""Action of an entry that says what damage has taken from the log."""

BEGUN = "begun"
"""Outcome of an entry from before a change; the entry of its outcome has the same `request`."""


class AuditEntry(Frozen):
    """One change that a person or a program made, or was refused.

    Attributes:
        who: name or token of who asked; what people type until roles exist.
        origin: from where: an address, `bus`, or the service itself.
        action: e.g. `acknowledge`, `PUT /api/v1/recordings/{name}`, `service_started`.
        target: axis or thing that it concerns; empty for the service.
        outcome: what came of it; `begun` before it is done.
        data: more about it; `request` joins both entries of a change.
    """

    time_ns: int
    who: str
    origin: str
    action: str
    target: str = ""
    outcome: str = ""
    data: dict[str, str | float | int | None] = {}


@dataclass(frozen=True, slots=True)
class AuditRecord:
    """An entry as it is kept.

    Attributes:
        chain: SHA-256 of the chain before it, its number and itself.
        problem: why it cannot be trusted; empty if it can.
    """

    number: int
    entry: AuditEntry | None
    chain: str
    problem: str = ""


def append_entries(file: sqlite3.Connection, entries: Iterable[AuditEntry]) -> None:
    """Append entries within a transaction; one that is there already is not doubled."""
    for entry in entries:
        body = entry.model_dump_json()
        same = "SELECT 1 FROM audit WHERE time_ns = ? AND body = ?"
        if file.execute(same, (entry.time_ns, body)).fetchone():
            continue
        last = file.execute("SELECT number, chain FROM audit ORDER BY number DESC LIMIT 1")
        number, chain = last.fetchone() or (0, FIRST_CHAIN)
        append_row(file, number, chain, entry)


def append_row(file: sqlite3.Connection, number: int, chain: str, entry: AuditEntry) -> None:
    """Append an entry after the one of a number and a chain, within a transaction."""
    body = entry.model_dump_json()
    row = (number + 1, entry.time_ns, body, link(chain, number + 1, body))
    file.execute("INSERT INTO audit VALUES (?, ?, ?, ?)", row)


def link(before: str, number: int, body: str) -> str:
    """Chain that an entry ends."""
    return hashlib.sha256(f"{before} {number} {body}".encode()).hexdigest()


def checked(rows: Iterable[tuple[int, int, str, str]], first: int) -> list[AuditRecord]:
    """Records of rows (number, time, body, chain), each checked against the one before it.

    Args:
        first: number of the first record wanted; the row before it is only looked at.
    """
    records, chain, expected = [], FIRST_CHAIN, max(first - 1, 1)
    for number, _time_ns, body, end in rows:
        if number >= first:
            entry, problem = _entry(body), ""
            if number == expected and link(chain, number, body) != end:
                problem = "it is not what was written"
            elif entry is not None and entry.action == BREAK:
                problem = entry.outcome
            elif number != expected:
                problem = f"{number - expected} entries before it are gone"
            records.append(AuditRecord(number, entry, end, problem))
        chain, expected = end, number + 1
    return records


def read_audit(path: Path) -> list[AuditRecord]:
    """All records of a file that a service may be using, checked. Raises ValueError, one line."""
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as file:
            file.text_factory = lambda content: content.decode(errors="replace")
            rows = file.execute("SELECT * FROM audit ORDER BY number").fetchall()
    except sqlite3.Error as error:
        raise ValueError(f"{path}: no audit log can be read ({error})") from None
    return checked(rows, 1)


def last_of(path: Path, action: str) -> AuditEntry | None:
    """The newest entry of an action in a file that a service may be using; None if there is none.

    The chain is not checked. Raises ValueError, one line.
    """
    newest = "SELECT body FROM audit WHERE body LIKE ? ORDER BY number DESC LIMIT 1"
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as file:
            row = file.execute(newest, (f'%"action":"{action}"%',)).fetchone()
    except sqlite3.Error as error:
        raise ValueError(f"{path}: no audit log can be read ({error})") from None
    return None if row is None else _entry(row[0])


def _entry(body: str) -> AuditEntry | None:
    try:
        return AuditEntry.model_validate_json(body)
    except ValidationError:
        return None


def described(record: AuditRecord) -> str:
    """A record as one line of JSON."""
    entry = None if record.entry is None else record.entry.model_dump(mode="json")
    members = {"number": record.number, "entry": entry, "chain": record.chain}
    return json.dumps(members | ({"problem": record.problem} if record.problem else {}))
