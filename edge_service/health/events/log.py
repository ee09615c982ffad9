"""The last events, numbered so that a reader can go on where it stopped."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

from ...messages.event import Event

_NS_PER_US = 1000


@dataclass(frozen=True, slots=True)
class LoggedEvent:
    """An event with the number under which readers know it."""

    id: int
    event: Event


class EventLog:
    """Bounded log; ids grow, also across restarts, since they start at the time in microseconds.

    They stay below 2**53, so every JSON reader keeps them exactly.
    """

    def __init__(self, capacity: int, known: Iterable[LoggedEvent] = ()) -> None:
        self._events: deque[LoggedEvent] = deque(known, maxlen=capacity)
        self._dropped_id = 0
        self.last_id = self._events[-1].id if self._events else 0

    def append(self, event: Event, now_ns: int) -> LoggedEvent:
        """Number an event and keep it; the oldest makes room."""
        self.last_id = max(self.last_id + 1, now_ns // _NS_PER_US)
        if len(self._events) == self._events.maxlen:
            self._dropped_id = self._events[0].id
        logged = LoggedEvent(self.last_id, event)
        self._events.append(logged)
        return logged

    def after(self, last_id: int) -> tuple[LoggedEvent, ...]:
        """Events with a higher id than `last_id`, oldest first."""
        return tuple(logged for logged in self._events if logged.id > last_id)

    def holds_all_after(self, last_id: int) -> bool:
        """Tell whether nothing after `last_id` was dropped from the log since its start."""
        return last_id >= self._dropped_id

    def between(self, start_ns: int, end_ns: int, axis: str) -> tuple[LoggedEvent, ...]:
        """Events of an axis, or of the service, that happened in [start_ns, end_ns)."""
        return tuple(
            logged
            for logged in self._events
            if start_ns <= logged.event.time_ns < end_ns and logged.event.axis in ("", axis)
        )
