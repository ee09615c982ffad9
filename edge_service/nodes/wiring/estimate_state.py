"""State of an estimator that outlives the process: what it belongs to, and how old it may be."""

import hashlib
import json
import logging
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

from pydantic import FiniteFloat, TypeAdapter

from ...atomic import DamagedError, read_checked, write_checked
from ...config_tables import Table
from ...models.machine import Machine

log = logging.getLogger(__name__)
SCHEMA: Literal["estimate-state/1"] = "estimate-state/1"
LONGEST_STOP_S = 30 * 86400.0
"""After a longer stop nothing is left of what was known."""
AHEAD_S = 60.0
"""A state this far in the future comes from a clock that was wrong then or is wrong now."""
UNKNOWN_STOP_S = 86400.0
"""Time for which such a state counts as left alone; nobody knows the true one."""
DAMAGED = (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError)


class StateError(Exception):
    """Reason for not going on from a kept state; `damaged` if it is none at all."""

    def __init__(self, reason: str, *, damaged: bool = False) -> None:
        super().__init__(reason)
        self.damaged = damaged


@dataclass(frozen=True, slots=True)
class Kept:
    """An estimator's snapshot with the end of the last interval that it has taken.

    Attributes:
        time_s: on the axis' clock.
        source_time_ns: UNIX time.
    """

    time_s: float
    source_time_ns: int
    snapshot: dict[str, Any]

    def document(self, axis: str, identity: str) -> dict[str, Any]:
        """Document of the state of an axis. Raises ValueError where JSON cannot hold it."""
        state = json.dumps(self.snapshot, allow_nan=False)
        times = (self.time_s, self.source_time_ns)
        return asdict(_Document(SCHEMA, axis, identity, *times, _digest(state), state))

    @classmethod
    def of(cls, document: object, axis: str, identity: str) -> "Kept":
        """State of a document. Raises StateError."""
        try:
            content = _DOCUMENTS.validate_python(document)
            if content.axis != axis:
                raise ValueError(f"{SCHEMA} of axis {content.axis}")
            if _digest(content.state) != content.sha256:
                raise ValueError("its checksum is wrong")
            kept = cls(content.time_s, content.source_time_ns, json.loads(content.state))
        except DAMAGED as error:
            raise StateError(f"it cannot be read ({_short(error)})", damaged=True) from None
        if content.machine != identity:
            raise StateError("it was saved with another machine file or estimator")
        return kept

    def as_of(self, now_ns: int, replaced_ns: int = 0) -> "Kept":
        """The state for an estimate that goes on now. Raises StateError if it is of no more use.

        Args:
            replaced_ns: UNIX time at which the part was replaced, ns; 0 if it never was.
        """
        stopped_s = (now_ns - self.source_time_ns) / 1e9
        if stopped_s > LONGEST_STOP_S:
            raise StateError(f"it is {stopped_s / 86400.0:.0f} days old")
        kept = self
        if stopped_s < -AHEAD_S:
            log.warning("the state of an estimate is from %.0f s in the future", -stopped_s)
            kept = replace(self, source_time_ns=now_ns - round(UNKNOWN_STOP_S * 1e9))
        if kept.source_time_ns < replaced_ns <= now_ns:
            raise StateError("it belongs to a part that has since been replaced")
        return kept


@dataclass(frozen=True, slots=True)
class _Document:
    """The JSON of the snapshot with its digest, and what it belongs to."""

    schema: Literal["estimate-state/1"]
    axis: str
    machine: str
    time_s: FiniteFloat
    source_time_ns: int
    sha256: str
    state: str


_DOCUMENTS = TypeAdapter(_Document)


def identity_of(machine: Machine, *tables: Table) -> str:
    """Digest of all that the numbers of a state rest on: machine file and choices."""
    return _digest("\n".join(each.model_dump_json() for each in (machine, *tables)))


def read_kept(path: Path, axis: str, identity: str) -> Kept | None:
    """State kept in a file; None if there is no such file. Raises StateError, OSError."""
    try:
        text = read_checked(path)
        return None if text is None else Kept.of(json.loads(text), axis, identity)
    except (DamagedError, ValueError, RecursionError) as error:
        raise StateError(f"it cannot be read ({_short(error)})", damaged=True) from None


def write_kept(path: Path, axis: str, identity: str, kept: Kept) -> None:
    """Write a state, whole or not at all. Raises OSError."""
    write_checked(path, json.dumps(kept.document(axis, identity), allow_nan=False))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _short(error: Exception) -> str:
    lines = str(error).splitlines() or [""]
    return f"{type(error).__name__}: {lines[0][:100]}"
