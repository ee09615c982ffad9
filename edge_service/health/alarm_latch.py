"""One alarm (after ISA-18.2): raised, cleared, acknowledged, shelved."""

from dataclasses import dataclass
from datetime import datetime

from ..messages.command import Command
from ..messages.event import AxisCondition, Code, Event, Statement, told
from ..messages.health import Alarm, AlarmKind
from .inputs import NS_PER_S, moved

_NS_PER_MS = 1_000_000


@dataclass(frozen=True, slots=True)
class AlarmRule:
    """Behaviour of one kind of alarm.

    Attributes:
        level: of its events while it is active.
        raise_delay_s: how long its cause must hold first.
        clear_delay_s: how long its cause must be gone.
        latched: it stays active until somebody acknowledges it.
    """

    level: AxisCondition
    raise_delay_s: float
    clear_delay_s: float
    latched: bool = False


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
        self._occurrence = begun_ns // _NS_PER_MS  # so a state that was lost repeats none

    @property
    def active(self) -> bool:
        """Return whether its cause holds, after the delays."""
        return self._alarm is not None and self._alarm.active

    def update(self, cause: bool | None, words: Statement, now_ns: int) -> tuple[Event, ...]:
        """Say whether the cause holds (None: nobody can tell, the state stays)."""
        over = self._end_of_shelf(now_ns)
        self.follow(words)
        if cause is None or cause is self.active:
            self._change_since_ns = None
            return over
        if self._change_since_ns is None:
            self._change_since_ns = now_ns
        delay_s = self.rule.raise_delay_s if cause else self.rule.clear_delay_s
        if now_ns - self._change_since_ns < delay_s * NS_PER_S:
            return over
        self._change_since_ns = None
        return (*over, *(self._raise(words, now_ns) if cause else self._clear(now_ns)))

    def follow(self, words: Statement) -> None:
        """Let the words follow the value, while it is active."""
        if self.active and words.text and not self.rule.latched:
            self.reword(words)

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
        if self.rule.latched and alarm.active:
            self._alarm = self._alarm.model_copy(update=self._over(now_ns))
        if not self._alarm.active:
            self._alarm = None
        words = told(Code.ALARM_ACKNOWLEDGED, self._words, alarm=self._kind.value, user=user)
        return (self._event("acknowledged", AxisCondition.NORMAL, words, now_ns, note),)

    def shelve(self, user: str, note: str, duration_s: float, now_ns: int) -> tuple[Event, ...]:
        """Let it call nobody for a while."""
        self._shelved_until_ns = now_ns + round(duration_s * NS_PER_S)
        hours = duration_s / 3600.0
        name = self._kind.value
        words = (
            told(Code.ALARM_SHELVED_H, self._words, alarm=name, hours=hours, user=user)
            if hours >= 1.0
            else told(
                Code.ALARM_SHELVED_MIN, self._words, alarm=name, minutes=60.0 * hours, user=user
            )
        )
        return (self._event("shelved", AxisCondition.NORMAL, words, now_ns, note),)

    def unshelve(self, user: str, note: str, now_ns: int) -> tuple[Event, ...]:
        """End the shelving; no event if it was not shelved."""
        if self._shelved_until_ns is None:
            return ()
        self._shelved_until_ns = None
        words = told(Code.ALARM_UNSHELVED, self._words, alarm=self._kind.value, user=user)
        return (self._event("unshelved", AxisCondition.NORMAL, words, now_ns, note),)

    def shown(self) -> Alarm | None:
        """Alarm that a person should see; None if there is none."""
        if self._alarm is None:
            return None
        return self._alarm.model_copy(update={"shelved_until_ns": self._shelved_until_ns})

    def move(self, step_ns: int) -> None:
        """The clock was set by a step, ns."""
        self._shelved_until_ns = moved(self._shelved_until_ns, step_ns)
        self._change_since_ns = moved(self._change_since_ns, step_ns)
        if self._alarm is not None:
            times = {
                "raised_time_ns": self._alarm.raised_time_ns + step_ns,
                "cleared_time_ns": moved(self._alarm.cleared_time_ns, step_ns),
            }
            self._alarm = self._alarm.model_copy(update=times)

    def snapshot(self) -> LatchSnapshot:
        """State that outlives the process."""
        return LatchSnapshot(self._alarm, self._shelved_until_ns, self._occurrence)

    def restore(self, snapshot: LatchSnapshot) -> None:
        """Go on from a snapshot."""
        self._alarm, self._shelved_until_ns = snapshot.alarm, snapshot.shelved_until_ns
        self._occurrence = snapshot.occurrence

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
        return (self._event("raised", level, words, now_ns),)

    def _clear(self, now_ns: int) -> tuple[Event, ...]:
        if self._alarm is None or self.rule.latched:
            return ()
        cleared = self._alarm.model_copy(update=self._over(now_ns))
        self._alarm = None if cleared.acknowledged_by is not None else cleared
        words = told(Code.ALARM_CLEARED, self._words, alarm=self._kind.value)
        return (self._event("cleared", AxisCondition.NORMAL, words, now_ns),)

    def _over(self, now_ns: int) -> dict[str, object]:
        words = "" if self._alarm is None else self._alarm.text
        return {"active": False, "cleared_time_ns": now_ns, "text": f"no longer active: {words}"}

    def _end_of_shelf(self, now_ns: int) -> tuple[Event, ...]:
        if self._shelved_until_ns is None or now_ns < self._shelved_until_ns:
            return ()
        self._shelved_until_ns = None
        words = told(Code.ALARM_SHELF_OVER, self._words, alarm=self._kind.value)
        return (self._event("unshelved", AxisCondition.NORMAL, words, now_ns),)

    @property
    def _words(self) -> dict[str, str]:
        return {"alarm": self._kind.value.replace("_", " ")}

    def _event(
        self, change: str, level: AxisCondition, words: Statement, now_ns: int, note: str = ""
    ) -> Event:
        return Event(
            axis=self._axis,
            kind=f"alarm_{change}",
            level=level,
            code=words.code,
            text=words.text + (f": {note}" if note else ""),
            values=words.values,
            time_ns=now_ns,
            data={
                "alarm": self._kind.value,
                "occurrence": self._occurrence,
                "shelved": int(self._shelved_until_ns is not None),
            }
            | ({"note": note} if note else {}),
        )


def clock(time_ns: int) -> str:
    """Time of day in this computer's zone, with the date."""
    return f"{datetime.fromtimestamp(time_ns / 1e9).astimezone():%H:%M on %Y-%m-%d}"
