"""One alarm (after ISA-18.2): raised, cleared, acknowledged, shelved."""

from dataclasses import dataclass

from ..messages.event import SILENT, AxisCondition, Code, Event, Statement, told
from ..messages.health import Alarm, AlarmKind, Command
from ..messages.interval import rfc3339
from .axis_events import Data, noted
from .inputs import NS_PER_S
from .statements import clock, span

_NAMES = {"rate": "wears fast", "model": "model does not fit", "service": "service part down"}


def moved(time_ns: int | None, step_ns: int) -> int | None:
    """Time as a clock shows it that was set by a step, ns."""
    return None if time_ns is None else time_ns + step_ns


@dataclass(frozen=True, slots=True)
class AlarmRule:
    """Behaviour of one kind of alarm."""

    level: AxisCondition  # of its events while it is active
    raise_delay_s: float  # how long its cause must hold first
    clear_delay_s: float  # how long its cause must be gone
    latched: bool = False  # it stays active until somebody acknowledges it


@dataclass(frozen=True, slots=True)
class LatchSnapshot:
    """Alarm as it is shown, and UNIX time to which it is shelved, ns; None without."""

    alarm: Alarm | None
    shelved_until_ns: int | None
    occurrence: int = 0


class AlarmLatch:
    """State of one alarm of one axis.

    It is shown while it is active, and afterwards until somebody has acknowledged it, each time
    that it is raised. Shelved, it goes on, but its events are for information only.
    """

    def __init__(self, axis: str, kind: AlarmKind, rule: AlarmRule, begun_ns: int = 0) -> None:
        self.rule = rule
        self._axis = axis
        self._kind = kind
        self._alarm: Alarm | None = None
        self._shelved_until_ns: int | None = None
        self._change_since_ns: int | None = None
        self._occurrence = begun_ns // 1_000_000  # ms, so a state that was lost repeats none

    @property
    def active(self) -> bool:
        """Its cause holds, after the delays."""
        return self._alarm is not None and self._alarm.active

    def update(self, cause: bool | None, words: Statement, now_ns: int) -> tuple[Event, ...]:
        """Say whether the cause holds (None: nobody can tell); a latched one holds anew."""
        over: tuple[Event, ...] = ()
        if self._shelved_until_ns is not None and now_ns >= self._shelved_until_ns:
            self._shelved_until_ns = None
            over = (self._event("unshelved", self._told(Code.ALARM_SHELF_OVER), now_ns),)
        if cause is None or (cause is self.active and not (cause and self.rule.latched)):
            self._change_since_ns = None
            return over
        if self._change_since_ns is None:
            self._change_since_ns = now_ns
        delay_s = self.rule.raise_delay_s if cause else self.rule.clear_delay_s
        if now_ns - self._change_since_ns < delay_s * NS_PER_S:
            return over
        self._change_since_ns = None
        return (*over, *(self._raise(words, now_ns) if cause else self._clear(now_ns)))

    def reword(self, words: Statement) -> None:
        """Say better what it is about, while it is shown."""
        if self._alarm is not None:
            self._alarm = self._alarm.model_copy(update=dict(words))

    def refusal(self, command: Command) -> str:
        """Reason for which a command would change nothing, or the wrong thing; else empty."""
        name, alarm = self._kind.value, self._alarm
        if command.action == "unshelve":
            return "" if self._shelved_until_ns is not None else f"alarm {name} is not shelved"
        if command.action != "acknowledge":
            return ""
        if alarm is None:
            return f"there is no alarm {name} to acknowledge"
        if command.occurrence is None:
            return f"alarm {name}: no occurrence was named; now it is {alarm.occurrence}"
        if command.occurrence != alarm.occurrence:
            return f"occurrence {command.occurrence} of alarm {name} is over, or never was"
        by = alarm.acknowledged_by
        return "" if by is None else f"alarm {name} was acknowledged by {by} already"

    def acknowledge(self, user: str, note: str, now_ns: int) -> tuple[Event, ...]:
        """Note that a person has seen it; no event if there was nothing to acknowledge."""
        alarm = self._alarm
        if alarm is None or alarm.acknowledged_by is not None:
            return ()
        self._alarm = alarm.model_copy(update={"acknowledged_by": user, "note": note})
        if self.rule.latched or not alarm.active:
            self._alarm = None
        words = self._told(Code.ALARM_ACKNOWLEDGED, user=user)
        return (self._event("acknowledged", words, now_ns, note=note),)

    def shelve(self, user: str, note: str, duration_s: float, now_ns: int) -> tuple[Event, ...]:
        """Let it call nobody for a while."""
        until_ns = self._shelved_until_ns = now_ns + round(duration_s * NS_PER_S)
        until = {"time": clock(until_ns)}
        words = self._told(Code.ALARM_SHELVED, until, user=user, time=rfc3339(until_ns))
        return (self._event("shelved", words, now_ns, note=note),)

    def unshelve(self, user: str, note: str, now_ns: int) -> tuple[Event, ...]:
        """End the shelving; no event if it was not shelved."""
        if self._shelved_until_ns is None:
            return ()
        self._shelved_until_ns = None
        words = self._told(Code.ALARM_UNSHELVED, user=user)
        return (self._event("unshelved", words, now_ns, note=note),)

    def shown(self, words: Statement = SILENT) -> Alarm | None:
        """Alarm that a person should see, in words as of now; None if there is none."""
        if self._alarm is None:
            return None
        if not self._alarm.active:
            self.reword(self._over())
        elif words.text and not self.rule.latched:
            self.reword(words)
        return self._alarm.model_copy(update={"shelved_until_ns": self._shelved_until_ns})

    def snapshot(self) -> LatchSnapshot:
        """State that outlives the process."""
        return LatchSnapshot(self._alarm, self._shelved_until_ns, self._occurrence)

    def restore(self, snapshot: LatchSnapshot, step_ns: int = 0) -> None:
        """Go on from a snapshot, of a clock that was set by a step since, ns."""
        self._alarm, self._occurrence = snapshot.alarm, snapshot.occurrence
        self._shelved_until_ns = moved(snapshot.shelved_until_ns, step_ns)
        if self._alarm is not None:
            raised_ns = self._alarm.raised_time_ns + step_ns
            cleared_ns = moved(self._alarm.cleared_time_ns, step_ns)
            times = {"raised_time_ns": raised_ns, "cleared_time_ns": cleared_ns}
            self._alarm = self._alarm.model_copy(update=times)

    def _raise(self, words: Statement, now_ns: int) -> tuple[Event, ...]:
        self._occurrence += 1
        self._alarm = Alarm(
            kind=self._kind,
            level=self.rule.level,
            active=True,
            occurrence=self._occurrence,
            raised_time_ns=now_ns,
            **dict(words),
        )
        level = AxisCondition.NORMAL if self._shelved_until_ns else self.rule.level
        return (self._event("raised", words, now_ns, level),)

    def _clear(self, now_ns: int) -> tuple[Event, ...]:
        alarm = self._alarm
        if alarm is None or self.rule.latched:
            return ()
        self._alarm = alarm.model_copy(update={"active": False, "cleared_time_ns": now_ns})
        words = self._over()
        if alarm.acknowledged_by is not None:
            self._alarm = None
        return (self._event("cleared", words, now_ns),)

    def _over(self) -> Statement:
        assert self._alarm is not None
        since_ns, until_ns = self._alarm.raised_time_ns, self._alarm.cleared_time_ns or 0
        words = span(since_ns, until_ns)
        return self._told(Code.ALARM_OVER, words, since=rfc3339(since_ns), until=rfc3339(until_ns))

    def _told(self, code: Code, words: dict[str, str] | None = None, **values: str) -> Statement:
        name = self._kind.value
        named = {"alarm": _NAMES.get(name, name.replace("_", " ")).capitalize()} | (words or {})
        return told(code, named, alarm=name, **values)

    def _event(
        self,
        change: str,
        words: Statement,
        now_ns: int,
        level: AxisCondition = AxisCondition.NORMAL,
        note: str = "",
    ) -> Event:
        data: Data = {"alarm": self._kind.value, "occurrence": self._occurrence}
        data = {**data, "shelved": int(self._shelved_until_ns is not None)}
        data = {**data, "note": note} if note else data
        return noted(self._axis, f"alarm_{change}", words, now_ns, data, level)
