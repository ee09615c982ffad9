"""Data faults of one axis: how often each kind was seen, and which are present now."""

from ...messages.event import Event, Severity
from ...messages.features import FAULT_WORDS, UNUSABLE, Fault
from ...messages.sentence import Code, told
from .input_watch import NS_PER_S


class DataFaults:
    """Counts of faulty intervals per kind, with an event when a kind appears and when it is over.

    A kind that comes and goes within `clear_after_s` is one fault, hence one event.
    """

    def __init__(self, axis: str, clear_after_s: float) -> None:
        self._axis = axis
        self._clear_after_ns = round(clear_after_s * NS_PER_S)
        self._last_seen_ns: dict[Fault, int] = {}
        self.counts: dict[str, int] = {}

    def count(self, fault: Fault, now_ns: int) -> tuple[Event, ...]:
        """Count the faults of one interval."""
        events = []
        for kind in fault:
            name = fault_name(kind)
            self.counts[name] = self.counts.get(name, 0) + 1
            if kind not in self._last_seen_ns:
                events.append(self._event(kind, "present", now_ns))
            self._last_seen_ns[kind] = now_ns
        return (*events, *self.tick(now_ns))

    def tick(self, now_ns: int) -> tuple[Event, ...]:
        """Events of the faults that are over by now."""
        over = [
            kind
            for kind, seen_ns in self._last_seen_ns.items()
            if now_ns - seen_ns > self._clear_after_ns
        ]
        for kind in over:
            del self._last_seen_ns[kind]
        return tuple(self._event(kind, "over", now_ns) for kind in over)

    def move(self, step_ns: int) -> None:
        """The clock was set by a step, ns."""
        self._last_seen_ns = {kind: at + step_ns for kind, at in self._last_seen_ns.items()}

    def _event(self, kind: Fault, state: str, now_ns: int) -> Event:
        serious = state == "present" and bool(kind & UNUSABLE)
        name = fault_name(kind)
        sentences = {"fault": FAULT_WORDS[kind]}
        words = (
            told(Code.DATA_FAULT, sentences, fault=name)
            if state == "present"
            else told(Code.DATA_FAULT_OVER, sentences, fault=name)
        )
        return Event(
            axis=self._axis,
            kind="data_fault",
            severity=Severity.WARNING if serious else Severity.INFO,
            message=words.text,
            sentence=words.sentence,
            time_ns=now_ns,
            data={"fault": name, "state": state, "count": self.counts[name]},
        )


def fault_name(kind: Fault) -> str:
    """Name of one kind of fault in messages: `time_backwards`, ..."""
    return str(kind.name).lower()
