"""Store in which the state of the estimators outlives the process."""

import hashlib
import json
import logging
import threading
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

from pydantic import FiniteFloat, TypeAdapter

from ...atomic import DamagedError, read_checked, set_aside, write_checked
from ...config_tables import Table
from ...models.machine import Machine
from .watch_store import axis_folder

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
        taken: intervals since the process began: a larger number is newer, whatever clocks say.
    """

    time_s: float
    source_time_ns: int
    snapshot: dict[str, Any]
    taken: int = 0


@dataclass(frozen=True, slots=True)
class _File:
    """Content of a file: the JSON of the snapshot with its digest, and what it belongs to."""

    schema: Literal["estimate-state/1"]
    axis: str
    machine: str
    time_s: FiniteFloat
    source_time_ns: int
    sha256: str
    state: str


_FILES = TypeAdapter(_File)


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def identity_of(machine: Machine, *tables: Table) -> str:
    """Digest of all that the numbers of a state rest on: machine file and choices."""
    return _digest("\n".join(each.model_dump_json() for each in (machine, *tables)))


def read_kept(path: Path, axis: str, identity: str) -> Kept | None:
    """Axis state kept in a file; None if there is no such file. Raises StateError, OSError."""
    try:
        text = read_checked(path)
    except DamagedError as error:
        raise StateError(str(error), damaged=True) from None
    if text is None:
        return None
    kept, kept_for = _parsed(text, axis)
    if kept_for != identity:
        raise StateError("it was saved with another machine file or estimator")
    return kept


def write_kept(path: Path, axis: str, identity: str, kept: Kept) -> None:
    """Write a state, whole or not at all. Raises OSError."""
    state = json.dumps(kept.snapshot, allow_nan=False)
    content = _File(SCHEMA, axis, identity, kept.time_s, kept.source_time_ns, _digest(state), state)
    write_checked(path, json.dumps(asdict(content), allow_nan=False))


class EstimateStore:
    """The kept states of all axes.

    Args:
        folder: of the history.
        identities: by axis, see `identity_of`.
    """

    def __init__(self, folder: Path, identities: dict[str, str]) -> None:
        self._folder = folder
        self._identities = identities
        self._written: dict[str, int] = {}
        self._lock = threading.Lock()
        self.damaged_files = 0

    def path(self, axis: str) -> Path:
        """File of one axis."""
        return axis_folder(self._folder, axis) / "estimate.json"

    def load(self, axis: str, now_ns: int) -> Kept | None:
        """State that was kept of an axis; None if none was.

        Raises:
            StateError: it is damaged, of another axis or machine file, or too old.
            OSError: it cannot be read.
        """
        kept = read_kept(self.path(axis), axis, self._identities[axis])
        if kept is None:
            return None
        stopped_s = (now_ns - kept.source_time_ns) / 1e9
        if stopped_s > LONGEST_STOP_S:
            raise StateError(f"it is {stopped_s / 86400.0:.0f} days old")
        if stopped_s < -AHEAD_S:
            log.warning("%s: it is from %.0f s in the future", self.path(axis), -stopped_s)
            return replace(kept, source_time_ns=now_ns - round(UNKNOWN_STOP_S * 1e9))
        return kept

    def save(self, kept: dict[str, Kept]) -> None:
        """Write states from any thread, each whole or not at all; an older one never replaces.

        Raises OSError.
        """
        with self._lock:
            for axis, each in kept.items():
                if each.taken >= self._written.get(axis, 0):
                    write_kept(self.path(axis), axis, self._identities[axis], each)
                    self._written[axis] = each.taken

    def forget(self, axis: str, taken: int) -> None:
        """The part is another: nothing of what was known after `taken` intervals holds. OSError.

        A state of that time that another thread is about to write is not written any more.
        """
        with self._lock:
            self._written[axis] = taken + 1
            self.path(axis).unlink(missing_ok=True)

    def set_aside(self, axis: str) -> Path:
        """Keep a damaged file beside its place; returns where. Raises OSError."""
        self.damaged_files += 1
        return set_aside(self.path(axis))


def _parsed(text: str, axis: str) -> tuple[Kept, str]:
    """State and identity of a file. Raises StateError."""
    try:
        content = _FILES.validate_json(text)
        if content.axis != axis:
            raise ValueError(f"{SCHEMA} of axis {content.axis}")
        if _digest(content.state) != content.sha256:
            raise ValueError("its checksum is wrong")
        kept = Kept(content.time_s, content.source_time_ns, json.loads(content.state))
        return kept, content.machine
    except DAMAGED as error:
        raise StateError(f"it cannot be read ({_short(error)})", damaged=True) from None


def _short(error: Exception) -> str:
    lines = str(error).splitlines() or [""]
    return f"{type(error).__name__}: {lines[0][:100]}"
