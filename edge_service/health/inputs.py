"""Age of the last message, and the faults of the data in it."""

from typing import Generic

from ..messages.codec import Header, T
from ..messages.event import AxisCondition, Code, Event, told
from ..messages.features import FAULT_WORDS, UNUSABLE, Fault

NS_PER_S = 1_000_000_000
_FAULT_CLEAR_NS = 5 * NS_PER_S
"""A data fault is over when it was not seen for this long."""


class Heard(Generic[T]):
    """Last payload of one topic of one axis, and its freshness; the bus has judged the order.

    Two times count, and the older one decides: the newest sample's (`source_time_ns`), so that old
    data that arrive late are old, and the arrival's, so that a source whose clock runs ahead goes
    stale too. A reader's clock that was set back makes the input stale until the next payload.
    """

    def __init__(self, stale_after_s: float) -> None:
        self.stale_after_s = stale_after_s
        self._stale_after_ns = round(stale_after_s * NS_PER_S)
        self._arrival_ns = 0
        self.header: Header | None = None
        self.payload: T | None = None

    def hear(self, header: Header, payload: T, now_ns: int) -> None:
        self.header, self.payload, self._arrival_ns = header, payload, now_ns

    def age_s(self, now_ns: int) -> float | None:
        """Time since the newest sample, s; None if nothing was heard."""
        if self.header is None:
            return None
        return max(now_ns - self.header.source_time_ns, now_ns - self._arrival_ns, 0) / NS_PER_S

    def is_stale(self, now_ns: int) -> bool:
        """No payload may still be read as present."""
        if self.header is None or abs(now_ns - self._arrival_ns) > self._stale_after_ns:
            return True
        return now_ns - self.header.source_time_ns > self._stale_after_ns

    def measured_ns(self, now_ns: int) -> int | None:
        """UNIX time of the newest sample, ns; None before the first, or of a clock set back."""
        at_ns = None if self.header is None else self.header.source_time_ns
        return None if at_ns and at_ns > now_ns and self.is_stale(now_ns) else at_ns

    @property
    def stale_since_ns(self) -> int:
        """UNIX time in ns at which the last payload becomes stale; 0 if nothing was heard."""
        if self.header is None:
            return 0
        return min(self.header.source_time_ns, self._arrival_ns) + self._stale_after_ns


class DataFaults:
    """Counts of faulty intervals per kind, with an event when a kind appears and when it is over.

    A kind that comes and goes within 5 s is one fault, hence one event.
    """

    def __init__(self, axis: str) -> None:
        self._axis = axis
        self._last_seen_ns: dict[Fault, int] = {}
        self.counts: dict[str, int] = {}

    def count(self, fault: Fault, now_ns: int) -> tuple[Event, ...]:
        events = []
        for kind in fault:
            name = fault_name(kind)
            self.counts[name] = self.counts.get(name, 0) + 1
            if kind not in self._last_seen_ns:
                events.append(self._event(kind, now_ns, is_present=True))
            self._last_seen_ns[kind] = now_ns
        return (*events, *self.tick(now_ns))

    def tick(self, now_ns: int) -> tuple[Event, ...]:
        """Events of the faults that are over by now."""
        seen = self._last_seen_ns.items()
        over = [kind for kind, seen_ns in seen if now_ns - seen_ns > _FAULT_CLEAR_NS]
        for kind in over:
            del self._last_seen_ns[kind]
        return tuple(self._event(kind, now_ns, is_present=False) for kind in over)

    def _event(self, kind: Fault, now_ns: int, *, is_present: bool) -> Event:
        name, serious = fault_name(kind), is_present and bool(kind & UNUSABLE)
        code = Code.DATA_FAULT if is_present else Code.DATA_FAULT_OVER
        state = "present" if is_present else "over"
        return Event(
            axis=self._axis,
            kind="data_fault",
            level=AxisCondition.WARNING if serious else AxisCondition.NORMAL,
            **dict(told(code, {"fault": FAULT_WORDS[kind]}, fault=name)),
            time_ns=now_ns,
            data={"fault": name, "state": state, "count": self.counts[name]},
        )


def fault_name(kind: Fault) -> str:
    """Name of one kind of fault in messages: `time_backwards`, ..."""
    return str(kind.name).lower()
