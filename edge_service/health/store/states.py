"""States that outlive the process: one row for each name and axis."""

import json
import sqlite3
from dataclasses import dataclass
from typing import Any
from zlib import crc32

from .store import Store, damaged_name

SCHEMA = """
CREATE TABLE IF NOT EXISTS states (
    name TEXT NOT NULL, axis TEXT NOT NULL, body TEXT NOT NULL, digest INTEGER NOT NULL,
    PRIMARY KEY (name, axis)
);
"""


class DamagedStateError(Exception):
    """Reason why a kept state is not what was written."""


@dataclass(frozen=True, slots=True)
class State:
    """State of one part of an axis, as JSON text; None: it is gone."""

    name: str
    axis: str
    body: str | None

    @classmethod
    def of(cls, name: str, axis: str, document: object) -> "State":
        """State of a document. Raises ValueError where JSON cannot hold it."""
        return cls(name, axis, json.dumps(document, allow_nan=False))


def put_state(file: sqlite3.Connection, state: State) -> None:
    """Write a state within a transaction, in the place of an older one."""
    if state.body is None:
        gone = "DELETE FROM states WHERE name = ? AND axis = ?"
        file.execute(gone, (state.name, state.axis))
        return
    row = (state.name, state.axis, state.body, _digest(state))
    file.execute("INSERT OR REPLACE INTO states VALUES (?, ?, ?, ?)", row)


def load_state(store: Store, name: str, axis: str) -> Any:
    """Document of a state; None if there is none. Raises DamagedStateError, StoreFailedError."""
    store.define(SCHEMA)
    wanted = "SELECT body, digest FROM states WHERE name = ? AND axis = ?"
    row = store.read(lambda file: file.execute(wanted, (name, axis)).fetchone())
    if row is None:
        return None
    if row[1] != _digest(State(name, axis, row[0])):
        raise DamagedStateError("its checksum is wrong")
    try:
        return json.loads(row[0])
    except (ValueError, RecursionError) as error:
        raise DamagedStateError(str(error)) from None


def set_state_aside(store: Store, name: str, axis: str) -> str:
    """Keep a damaged state under another name; returns that. Raises StoreFailedError."""
    aside = damaged_name(name)
    renamed = "UPDATE OR REPLACE states SET name = ? WHERE name = ? AND axis = ?"
    store.write(lambda file: file.execute(renamed, (aside, name, axis)))
    return aside


def _digest(state: State) -> int:
    return crc32(f"{state.name} {state.axis} {state.body}".encode())
