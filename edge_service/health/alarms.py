"""Alarms of one axis, their causes and their words, which hold while active and after."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

from ..messages.command import Command
from ..messages.estimate import EstimateStatus, PreloadEstimate
from ..messages.event import SILENT, AxisCondition, Code, Event, Statement, told
from ..messages.health import (
    Alarm,
    AlarmKind,
    AxisHealth,
    ComponentHealth,
    ComponentStatus,
    ConsistencyState,
    PreloadFall,
)
from ..messages.interval import Interval, rfc3339
from ..messages.trend import Trend, TrendStatus
from .alarm_latch import AlarmLatch, AlarmRule, LatchSnapshot, clock
from .inputs import NS_PER_S, moved
from .model_watch.consistency import CHANNEL_WORDS

H_PER_RATE = 1000.0
_SPANS = ((H_PER_RATE, "1000_h"), (24.0, "day"), (1.0, "hour"), (1.0 / 60.0, "minute"))


def limit_words(health: AxisHealth, value_percent: float | None, fresh: float | None) -> Statement:
    """Preload against its limits, in percent of the fresh screw's; empty before the first value.

    Args:
        health: The condition with its reasons.
        value_percent: The last value known, percent of the load rating.
        fresh: The fresh screw's preload, percent of the load rating.
    """
    if health.condition in (AxisCondition.WARNING, AxisCondition.FAULT) and health.reasons:
        return health.below or Statement(text=health.reasons[0].partition(": ")[2])
    if value_percent is None or not fresh:
        return SILENT
    known = health.condition is not AxisCondition.UNAVAILABLE
    percent = 100.0 * value_percent / fresh
    return told(Code.PRELOAD_BACK if known else Code.PRELOAD_LAST_KNOWN, percent=percent)


def rate_words(trend: Trend | None, loss: float) -> Statement:
    """Loss of preload, percent of the fresh screw's per 1000 h."""
    if trend is None or trend.status is not TrendStatus.FALLING:
        return told(Code.PRELOAD_FELL_LATELY)
    hours, per = _readable_span(loss)
    words = {"per": f"per {per.replace('_', ' ')}"}
    return told(Code.PRELOAD_FALLING, words, loss=loss * hours / H_PER_RATE, per=per)


def drop_words(fall: PreloadFall) -> Statement:
    """Sudden fall of the preload."""
    return told(
        Code.PRELOAD_FELL_SUDDENLY,
        {"time": clock(fall.time_ns)},
        before=fall.from_percent,
        after=fall.to_percent,
        time=rfc3339(fall.time_ns),
    )


def _readable_span(percent_per_1000_h: float) -> tuple[float, str]:
    """Longest time in which less than everything is lost, h, with its code."""
    short = [span for span in _SPANS if percent_per_1000_h * span[0] < 100.0 * H_PER_RATE]
    return (short or _SPANS[-1:])[0]


DOWN = "tasks_down"
"""Reading of a component: how many of its tasks do not work."""


class Parts:
    """The parts that an axis rests on."""

    def __init__(self) -> None:
        self._down: dict[tuple[str, str | None], Statement] = {}

    def on_component(self, report: ComponentHealth) -> bool:
        """Take a report in; True if it changes what is down."""
        key = (report.component, report.axis)
        before = self._down.get(key)
        if is_down(report):
            self._down[key] = _down_words(report)
        elif report.status is not ComponentStatus.STARTING:
            self._down.pop(key, None)
        return (before is None) is (key in self._down)

    def cause(self) -> tuple[bool, Statement]:
        """A part is down, or none; the first of them in words."""
        return bool(self._down), next(iter(self._down.values()), SILENT)


def _down_words(report: ComponentHealth) -> Statement:
    """A part that does not work; its own words for the reason are in English alone."""
    words = {"component": report.component.capitalize(), "reason": report.reason.rstrip(".")}
    return told(Code.PART_DOWN, words, component=report.component.removesuffix("_process"))


def is_down(report: ComponentHealth) -> bool:
    """Tell whether a component, or a task of it, does not work."""
    if report.status in (ComponentStatus.STOPPING, ComponentStatus.STOPPED):
        return False
    given_up = report.status is ComponentStatus.PERMANENT_ERROR
    return given_up or report.readings.get(DOWN, 0.0) > 0.0


_NIS_MEMORY = 0.98
_MODEL_NIS = 6.0
"""Mean squared normalised innovation from which the model does not fit; 1 if it does."""
_SUDDEN_S, _CLEAR_DELAY_S = 10.0, 5.0
_START_S = 30
"""So long after a start nobody misses data that were never heard."""
_BEGINNING_S = 20.0
"""So much motion an estimator needs to learn in which state it finds an axis."""
_BEYOND_DOUBT = 2.5
"""Times the 90 % interval of a rate, 4.1 sigma: it is looked at all day."""
_DATA_CODES = ("no_input", "stale_input", "no_data")


@dataclass(frozen=True, slots=True)
class AlarmSettings:
    """Limits of the alarms.

    Attributes:
        rate_percent_per_1000_h: loss of preload per 1000 h that is too fast, percent of the
            commissioned preload.
        sudden_drop_percent: a loss within 10 s that is sudden, the same unit.
        data_lost_after_s: how long data may be missing.
    """

    rate_percent_per_1000_h: float = 20.0
    sudden_drop_percent: float = 15.0
    data_lost_after_s: float = 5.0


class SuddenDrop:
    """Detector of a fall of the preload, beyond doubt, by more than a limit within a short time."""

    def __init__(self, limit_percent: float, within_s: float) -> None:
        self._limit_percent = limit_percent
        self.within_ns = round(within_s * NS_PER_S)
        self._best: deque[tuple[int, float, float]] = deque()
        """Time, low bound and value of those that nothing later exceeds, the greatest first."""

    def update(self, time_ns: int, low: float, value: float, high: float) -> float | None:
        """Take an estimate in; the value before it, percent of the rating, if it fell suddenly."""
        while self._best and not 0 <= time_ns - self._best[0][0] <= self.within_ns:
            self._best.popleft()
        best = self._best[0] if self._best else None
        while self._best and self._best[-1][2] < value:
            self._best.pop()
        self._best.append((time_ns, low, value))
        if best is None or best[2] - value < self._limit_percent or high >= best[1]:
            return None
        return best[2]

    def move(self, step_ns: int) -> None:
        """The clock was set by a step, ns."""
        self._best = deque((at + step_ns, low, value) for at, low, value in self._best)


class AxisAlarms:
    """The alarms of one axis.

    Args:
        fresh_percent: The commissioned preload, percent of the load rating; without it limits have
            no meaning.
    """

    def __init__(
        self, axis: str, fresh_percent: float | None, settings: AlarmSettings, now_ns: int
    ) -> None:
        self._settings = settings
        self._patient_until_ns = now_ns + _START_S * NS_PER_S
        self._fresh = fresh_percent
        slow = (0.0, _CLEAR_DELAY_S)
        lost = (settings.data_lost_after_s, 1.0)
        rules = {
            AlarmKind.PRELOAD_LOW: AlarmRule(AxisCondition.WARNING, *slow),
            AlarmKind.PRELOAD_LOST: AlarmRule(AxisCondition.FAULT, *slow),
            AlarmKind.RATE: AlarmRule(AxisCondition.WARNING, *slow),
            AlarmKind.SUDDEN_DROP: AlarmRule(AxisCondition.FAULT, 0.0, 0.0, latched=True),
            AlarmKind.MODEL: AlarmRule(AxisCondition.WARNING, 5.0, _CLEAR_DELAY_S),
            AlarmKind.DATA_LOST: AlarmRule(AxisCondition.UNAVAILABLE, *lost),
            AlarmKind.SERVICE: AlarmRule(AxisCondition.WARNING, 0.0, _CLEAR_DELAY_S),
        }
        self._latches = {kind: AlarmLatch(axis, kind, rule, now_ns) for kind, rule in rules.items()}
        share = 0.0 if fresh_percent is None else fresh_percent / 100.0
        self._drop = SuddenDrop(settings.sudden_drop_percent * share, _SUDDEN_S)
        self._parts = Parts()
        self._fallen_ns: int | None = None
        self._percent: float | None = None
        self.fall: PreloadFall | None = None
        self._nis = 1.0
        self._status: EstimateStatus | None = None
        self._used_s = 0.0

    def on_preload(self, estimate: PreloadEstimate, time_ns: int, now_ns: int) -> tuple[Event, ...]:
        """Look at an estimate for what must not wait."""
        self._status = estimate.status
        is_new = estimate.data_used_s != self._used_s  # an axis at rest repeats its last error
        self._used_s = estimate.data_used_s
        if estimate.status is not EstimateStatus.ESTIMATED:
            return ()
        if estimate.nis is not None and is_new and self._used_s >= _BEGINNING_S:
            self._nis = _NIS_MEMORY * self._nis + (1.0 - _NIS_MEMORY) * min(estimate.nis, 100.0)
        low, value, high = estimate.low, estimate.preload_percent, estimate.high
        if self._fresh is None or low is None or value is None or high is None:
            return ()
        self._percent = value
        if self._used_s < _BEGINNING_S:
            return ()  # what is found out about an axis is no fall
        before = self._drop.update(time_ns, low, value, high)
        if before is None:
            return ()
        latch, before_ns = self._latches[AlarmKind.SUDDEN_DROP], self._fallen_ns
        self._fallen_ns = time_ns
        again = before_ns is None or abs(time_ns - before_ns) > self._drop.within_ns
        words = self._note_fall(before, value, now_ns, again or self.fall is None)
        if again:
            return latch.update(True, words, now_ns)
        latch.reword(words)  # the same fall, further down: the estimates need a second for it
        return ()

    def _note_fall(self, before: float, value: float, now_ns: int, again: bool) -> Statement:
        """Remember a fall, or how far the last one went on, and put it into words."""
        share = 100.0 / (self._fresh or 100.0)
        last = None if again else self.fall
        self.fall = PreloadFall(
            from_percent=share * before if last is None else last.from_percent,
            to_percent=share * value,
            time_ns=now_ns if last is None else last.time_ns,
        )
        return drop_words(self.fall)

    def on_component(self, report: ComponentHealth) -> bool:
        """Take the report of a part in; True if that may raise or clear an alarm."""
        return self._parts.on_component(report)

    def tick(self, health: AxisHealth, trend: Trend | None, now_ns: int) -> tuple[Event, ...]:
        """Let time pass, with the condition and the trend as of now."""
        events: list[Event] = []
        for kind, (cause, words) in self._causes(health, trend, now_ns).items():
            events += self._latches[kind].update(cause, words, now_ns)
        return tuple(events)

    def _causes(
        self, health: AxisHealth, trend: Trend | None, now_ns: int
    ) -> dict[AlarmKind, tuple[bool | None, Statement]]:
        return {
            **self._limits(health),
            AlarmKind.RATE: self._rate(trend),
            AlarmKind.SUDDEN_DROP: (None, SILENT),
            AlarmKind.MODEL: self._model(health),
            AlarmKind.DATA_LOST: self._data_lost(health, now_ns),
            AlarmKind.SERVICE: self._parts.cause(),
        }

    def refusal(self, command: Command) -> str:
        """Reason for which a command would change nothing; empty if it would."""
        if command.action not in ("acknowledge", "shelve", "unshelve"):
            return ""
        if command.alarm is None:
            return f"{command.action} names no alarm"
        return self._latches[command.alarm].refusal(command)

    def on_command(self, command: Command, now_ns: int) -> tuple[Event, ...]:
        """Acknowledge, shelve or unshelve."""
        if command.alarm is None or command.action not in ("acknowledge", "shelve", "unshelve"):
            return ()
        latch = self._latches[command.alarm]
        if command.action == "shelve":
            return latch.shelve(command.user, command.note, command.duration_s, now_ns)
        if command.action == "unshelve":
            return latch.unshelve(command.user, command.note, now_ns)
        seen = latch.acknowledge(command.user, command.note, now_ns)
        if command.alarm is AlarmKind.PRELOAD_LOST and latch.active:  # which hides the low one
            low = self._latches[AlarmKind.PRELOAD_LOW]
            seen += low.acknowledge(command.user, command.note, now_ns)
        return seen

    def move(self, step_ns: int) -> None:
        """The clock was set by a step, ns."""
        self._patient_until_ns += step_ns
        self._fallen_ns = moved(self._fallen_ns, step_ns)
        if self.fall is not None:
            self.fall = self.fall.model_copy(update={"time_ns": self.fall.time_ns + step_ns})
        self._drop.move(step_ns)
        for latch in self._latches.values():
            latch.move(step_ns)

    def shown(self, health: AxisHealth, trend: Trend | None, now_ns: int) -> tuple[Alarm, ...]:
        """Alarms that a person should see, the gravest first, in words as of now."""
        for kind, (_, words) in self._causes(health, trend, now_ns).items():
            self._latches[kind].follow(words)
        alarms = [alarm for latch in self._latches.values() if (alarm := latch.shown())]
        if self._latches[AlarmKind.PRELOAD_LOST].active:  # one cause, one acknowledgement
            alarms = [alarm for alarm in alarms if alarm.kind is not AlarmKind.PRELOAD_LOW]
        return tuple(sorted(alarms, key=lambda a: (a.active, a.level.urgency), reverse=True))

    def snapshot(self) -> dict[str, LatchSnapshot]:
        """State of each kind of alarm."""
        return {kind.value: latch.snapshot() for kind, latch in self._latches.items()}

    def restore(
        self,
        snapshot: Mapping[str, LatchSnapshot],
        fall: PreloadFall | None = None,
        step_ns: int = 0,
    ) -> None:
        """Go on from a snapshot, of a clock that was set by a step since, ns."""
        if fall is not None:
            self.fall = fall.model_copy(update={"time_ns": fall.time_ns + step_ns})
        for kind, latch in self._latches.items():
            if kind.value in snapshot:
                latch.restore(snapshot[kind.value])
                latch.move(step_ns)

    def _limits(self, health: AxisHealth) -> dict[AlarmKind, tuple[bool | None, Statement]]:
        known = health.condition is not AxisCondition.UNAVAILABLE
        words = limit_words(health, self._percent, self._fresh)
        low, fault = (health.condition is AxisCondition[each] for each in ("WARNING", "FAULT"))
        return {
            AlarmKind.PRELOAD_LOW: (low or (None if fault else False) if known else None, words),
            AlarmKind.PRELOAD_LOST: (fault if known else None, words),
        }

    def _rate(self, trend: Trend | None) -> tuple[bool | None, Statement]:
        if trend is None or trend.rate_percent_per_h is None or self._fresh is None:
            return None, rate_words(None, 0.0)
        share = -100.0 * H_PER_RATE / self._fresh
        rate = trend.rate_percent_per_h
        loss = rate.value * share
        sure = slowest_loss(rate) * share
        limit = self._settings.rate_percent_per_1000_h
        words = rate_words(trend, loss)
        if sure > limit:
            return True, words
        return (False if loss < 0.9 * limit else None), words

    def _data_lost(self, health: AxisHealth, now_ns: int) -> tuple[bool | None, Statement]:
        if self._status is None and now_ns < self._patient_until_ns:
            return None, SILENT
        return _data_lost(health)

    def _model(self, health: AxisHealth) -> tuple[bool | None, Statement]:
        if _data_lost(health)[0]:
            return None, SILENT
        limit = _MODEL_NIS
        consistency = health.consistency
        if consistency is not None and consistency.state is ConsistencyState.DISAGREES:
            channel = consistency.channel or ""
            words = {"watched": CHANNEL_WORDS.get(channel, channel)}
            return True, told(Code.AXIS_CHANGED, words, watched=channel)
        if self._status is EstimateStatus.INVALID and self._used_s < _BEGINNING_S:
            return None, SILENT
        if self._status is EstimateStatus.INVALID:
            return True, told(Code.MODEL_DISAGREES)
        fit = told(Code.MODEL_MISFIT, times=self._nis)
        if self._nis > limit:
            return True, fit
        return (False if self._nis < 0.8 * limit else None), fit


def slowest_loss(rate: Interval) -> float:
    """Upper end of a rate beyond doubt, in its unit: negative where a loss is certain."""
    return rate.value + _BEYOND_DOUBT * (rate.high - rate.value)


def _data_lost(health: AxisHealth) -> tuple[bool | None, Statement]:
    if health.condition is not AxisCondition.UNAVAILABLE:
        return False, SILENT
    for reason in health.reasons:
        code, _, sentence = reason.partition(": ")
        if code in _DATA_CODES:
            return True, told(Code.DATA_LOST, {"reason": sentence}, reason=code)
    return False, SILENT
