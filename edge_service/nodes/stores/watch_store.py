"""Store in which the state of alarms, trends and use outlives the process."""

import json
import logging
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from ...atomic import DamagedError, read_checked, set_aside, write_checked
from ...health.axis_monitor import AxisMonitor
from ...messages.event import Event

log = logging.getLogger(__name__)
_EVENTS = TypeAdapter(tuple[Event, ...])
_MEMBER = "events"


def axis_folder(folder: Path, axis: str) -> Path:
    """Folder of one axis; tools that know Hive partitions read the axis from its name."""
    return folder / f"axis={axis}"


def snapshot_path(folder: Path, axis: str) -> Path:
    """File of one axis."""
    return axis_folder(folder, axis) / "watch.json"


@dataclass(frozen=True, slots=True)
class State:
    """Snapshot of an axis' monitor; `order` grows from one to the next."""

    axis: str
    order: int
    snapshot: dict[str, Any]


class WatchStore:
    """States of all axes; without a folder nothing is kept."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        self._written: dict[str, int] = {}
        self.damages: list[tuple[str, str]] = []
        """Axis, and what became of its damaged file."""
        self.problem = ""
        """Reason for which states cannot be kept now; empty if they are."""

    def load(self, axis: str, make: Callable[[], AxisMonitor]) -> AxisMonitor:
        """The monitor of an axis as it was, or a new one: then a damaged file is set aside."""
        monitor = make()
        try:
            content = self._content(axis)
            if content is not None:
                monitor.restore(json.loads(content))
            return monitor
        except OSError as error:
            self.problem = f"{error.filename}: {error.strerror}"
            log.warning("%s: the axis starts over", self.problem)
        except (DamagedError, ValueError, RecursionError) as error:
            self._set_aside(axis, str(error))
        return make()

    def announced(self, axis: str) -> tuple[Event, ...]:
        """The events that were kept together with the state: a crash may have hidden them."""
        try:
            document = json.loads(self._content(axis) or "null")
            return _EVENTS.validate_python(document[_MEMBER]) if isinstance(document, dict) else ()
        except (OSError, DamagedError, ValidationError, ValueError, LookupError, RecursionError):
            return ()

    def save(self, states: Iterable[State], events: Iterable[Event] = ()) -> str:
        """Write the newest state of each axis, whole or not at all; returns the problem, if any.

        An older state never replaces a newer one. The events that led to a state are kept with it.
        """
        newest = {state.axis: state for state in sorted(states, key=lambda each: each.order)}
        with self._lock:
            problems = [self._write(state, events) for state in newest.values()]
            problem = "; ".join(filter(None, problems))
            if problem and not self.problem:
                log.warning("%s", problem)
            self.problem = problem
            return problem

    def _write(self, state: State, events: Iterable[Event]) -> str:
        if self._folder is None or state.order <= self._written.get(state.axis, -1):
            return ""
        own = tuple(event for event in events if event.axis == state.axis)
        document = state.snapshot | {_MEMBER: _EVENTS.dump_python(own, mode="json")}
        try:
            content = json.dumps(document, allow_nan=False)
            write_checked(snapshot_path(self._folder, state.axis), content)
        except (OSError, ValueError) as error:
            return f"axis {state.axis}: its state cannot be kept ({error})"
        self._written[state.axis] = state.order
        return ""

    def _content(self, axis: str) -> str | None:
        """JSON text that is kept of an axis; None if there is none."""
        return None if self._folder is None else read_checked(snapshot_path(self._folder, axis))

    def _set_aside(self, axis: str, reason: str) -> None:
        path = snapshot_path(self._folder or Path(), axis)
        try:
            aside = f"kept as {set_aside(path).name}"
        except OSError as error:
            aside = f"cannot be set aside ({error.strerror})"
        log.warning("%s: %s; %s", path, reason, aside)
        words = f"alarms, trend and use start over: {path.name} is damaged, {aside}"
        self.damages.append((axis, words))
