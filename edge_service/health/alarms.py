"""Alarms of one axis: their causes, and their words, which hold while active and after."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

from ..config_tables import AlarmsConfig
from ..messages.estimate import EstimateStatus, PreloadEstimate
from ..messages.event import SILENT, AxisCondition, Code, Event, Statement, told
from ..messages.health import (
    Alarm,
    AlarmKind,
    AxisHealth,
    Command,
    ComponentHealth,
    ComponentStatus,
    ConsistencyState,
    PreloadFall,
)
from ..messages.interval import Interval, rfc3339
from ..messages.topics import PRELOAD
from ..messages.trend import Trend, TrendStatus
from .alarm_latch import AlarmLatch, AlarmRule, LatchSnapshot
from .components import is_down
from .consistency import CHANNEL_WORDS
from .inputs import NS_PER_S
from .statements import clock, condition_words, is_in_doubt, limit_words

_SPANS_H = {"year": 8766.0, "day": 24.0, "hour": 1.0, "minute": 1.0 / 60.0}
_NIS_MEMORY = 0.98
_MODEL_NIS = 6.0
"""Mean squared normalised innovation from which the model does not fit; 1 if it does."""
_SURELY_LOST = 0.9
"""Probability of a loss from which on it explains that the axis is not as it was learned."""
_SUDDEN_S, _CLEAR_DELAY_S, _DOUBTED_S = 10.0, 5.0, 20.0
_START_S = 30
"""So long after a start, and after a first estimate that comes late, nobody misses data."""
_BEGINNING_S = 20.0
"""So much motion an estimator needs to learn in which state it finds an axis."""
_BEYOND_DOUBT = 2.5
"""Times the interval of a rate, 4 sigma or 5: it is looked at all day."""
_DATA_CODES = ("no_input", "stale_input", "no_data")
_SLOW, _AS_THE_CONDITION = (0.0, _CLEAR_DELAY_S), (0.0, 0.0)
_RULES = {
    AlarmKind.PRELOAD_LOW: AlarmRule(AxisCondition.WARNING, *_AS_THE_CONDITION),
    AlarmKind.PRELOAD_LOST: AlarmRule(AxisCondition.FAULT, *_AS_THE_CONDITION),
    AlarmKind.RATE: AlarmRule(AxisCondition.WARNING, *_SLOW),
    AlarmKind.SUDDEN_DROP: AlarmRule(AxisCondition.FAULT, 0.0, 0.0, latched=True),
    AlarmKind.MODEL: AlarmRule(AxisCondition.WARNING, 5.0, 0.0),
    AlarmKind.SERVICE: AlarmRule(AxisCondition.WARNING, *_SLOW),
}
_Cause = tuple[bool | None, Statement]


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


@dataclass(slots=True)
class _Fit:
    status: EstimateStatus | None = None
    used_s: float = 0.0  # motion that the newest estimate rests on, s
    nis: float = 1.0  # mean squared normalised innovation lately
    lost: float = 0.0  # probability that preload is lost, and not friction alone

    def update(self, estimate: PreloadEstimate) -> None:
        """Take an estimate in; an axis at rest repeats its last error, which counts once."""
        is_new, self.used_s = estimate.data_used_s != self.used_s, estimate.data_used_s
        self.status = estimate.status
        self.lost = estimate.fault_probability.get("preload_loss", 0.0)
        if estimate.nis is not None and is_new and self.is_settled:
            self.nis = _NIS_MEMORY * self.nis + (1.0 - _NIS_MEMORY) * min(estimate.nis, 100.0)

    @property
    def is_settled(self) -> bool:
        """The estimator knows in which state it has found the axis."""
        return self.used_s >= _BEGINNING_S


class AxisAlarms:
    """The alarms of one axis.

    Args:
        fresh_percent: The commissioned preload, percent of the load rating; without it limits have
            no meaning.

    Attributes:
        fall: the last sudden fall since a part was replaced.
    """

    def __init__(
        self, axis: str, fresh_percent: float | None, settings: AlarmsConfig, now_ns: int
    ) -> None:
        self._rate_limit = settings.rate_percent_per_1000_h
        self._patient_until_ns = now_ns + _START_S * NS_PER_S
        self._fresh = fresh_percent
        lost = AlarmRule(AxisCondition.UNAVAILABLE, settings.data_lost_after_s, 1.0)
        rules = {kind: _RULES.get(kind, lost) for kind in AlarmKind}
        self._latches = {kind: AlarmLatch(axis, kind, rule, now_ns) for kind, rule in rules.items()}
        share = 0.0 if fresh_percent is None else fresh_percent / 100.0
        self._drop = SuddenDrop(settings.sudden_drop_percent * share, _SUDDEN_S)
        self._down: dict[tuple[str, str | None], Statement] = {}
        self._fallen_ns: int | None = None
        self._falling_ns: int | None = None
        self.fall: PreloadFall | None = None
        self._fit = _Fit()

    def on_preload(self, estimate: PreloadEstimate, time_ns: int, now_ns: int) -> tuple[Event, ...]:
        """Look at an estimate for what must not wait."""
        if self._fit.status is None:
            waited = now_ns - time_ns > PRELOAD.stale_after_s * NS_PER_S  # for the kernels
            self._patient_until_ns = now_ns + waited * _START_S * NS_PER_S
        self._fit.update(estimate)
        low, value, high = estimate.low, estimate.preload_percent, estimate.high
        if self._fresh is None or low is None or value is None or high is None:
            return ()
        if estimate.status is not EstimateStatus.ESTIMATED or not self._fit.is_settled:
            return ()  # what is found out about an axis is no fall
        before = self._drop.update(time_ns, low, value, high)
        if before is None:
            return ()
        last_ns, self._fallen_ns = self._fallen_ns, time_ns
        again = last_ns is None or abs(time_ns - last_ns) > self._drop.within_ns
        share = 100.0 / self._fresh
        if again or self.fall is None:
            self.fall = PreloadFall(
                from_percent=share * before, to_percent=share * value, time_ns=now_ns
            )
        else:  # the same fall, further down: the estimates need a second for it
            self.fall = self.fall.model_copy(update={"to_percent": share * value})
        latch, fall = self._latches[AlarmKind.SUDDEN_DROP], self.fall
        words = told(
            Code.PRELOAD_FELL_SUDDENLY,
            {"time": clock(fall.time_ns)},
            before=fall.from_percent,
            after=fall.to_percent,
            time=rfc3339(fall.time_ns),
        )
        if again:
            return latch.update(True, words, now_ns)
        latch.reword(words)
        return ()

    def on_component(self, report: ComponentHealth) -> bool:
        """Take the report of a part in; True if that may raise or clear an alarm."""
        key = (report.component, report.axis)
        before = self._down.get(key)
        if is_down(report):
            part, reason = report.component, report.reason.rstrip(".")  # its own words
            words = {"component": part.capitalize(), "reason": reason}
            part = part.removesuffix("_process")
            self._down[key] = told(Code.PART_DOWN, words, component=part)
        elif report.status is not ComponentStatus.STARTING:
            self._down.pop(key, None)
        return (before is None) is (key in self._down)

    def tick(self, health: AxisHealth, now_ns: int) -> tuple[Event, ...]:
        """Let time pass, with the condition and the trend as of now."""
        events: list[Event] = []
        for kind, (cause, words) in self._causes(health, now_ns).items():
            events += self._latches[kind].update(cause, words, now_ns)
        return tuple(events)

    def refusal(self, command: Command) -> str:
        """Reason for which a command would change nothing; empty if it would."""
        if command.alarm is None:
            return f"{command.action} names no alarm"
        return self._latches[command.alarm].refusal(command)

    def on_command(self, command: Command, now_ns: int) -> tuple[Event, ...]:
        """Acknowledge, shelve or unshelve; a fall is that of the part that was replaced."""
        if command.action == "part_replaced":
            self.fall, drop = None, self._latches[AlarmKind.SUDDEN_DROP]
            return drop.acknowledge(command.user, command.note, now_ns)
        if command.alarm is None:
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

    def shown(self, health: AxisHealth, now_ns: int) -> tuple[Alarm, ...]:
        """Alarms that a person should see, the gravest first, in words as of now."""
        causes = self._causes(health, now_ns)
        found = (self._latches[kind].shown(words) for kind, (_, words) in causes.items())
        is_lost = self._latches[AlarmKind.PRELOAD_LOST].active  # one cause, one acknowledgement
        hidden = AlarmKind.PRELOAD_LOW if is_lost else None
        alarms = [alarm for alarm in found if alarm is not None and alarm.kind is not hidden]
        return tuple(sorted(alarms, key=lambda a: (a.active, a.level.urgency), reverse=True))

    def snapshot(self) -> dict[str, LatchSnapshot]:
        """State of each kind of alarm."""
        return {kind.value: latch.snapshot() for kind, latch in self._latches.items()}

    def restore(
        self, snapshot: Mapping[str, LatchSnapshot], fall: PreloadFall | None, step_ns: int
    ) -> None:
        """Go on from a snapshot, of a clock that was set by a step since, ns."""
        if fall is not None:
            self.fall = fall.model_copy(update={"time_ns": fall.time_ns + step_ns})
        for kind, latch in self._latches.items():
            if kind.value in snapshot:
                latch.restore(snapshot[kind.value], step_ns)

    def _causes(self, health: AxisHealth, now_ns: int) -> dict[AlarmKind, _Cause]:
        """State of the cause of each kind (None: nobody can tell), with its words."""
        known = health.condition is not AxisCondition.UNAVAILABLE
        low = health.condition is AxisCondition.WARNING
        lost = health.condition is AxisCondition.FAULT
        low_words, lost_words = (
            limit_words(health, self._latches[kind].shown() or SILENT)
            for kind in (AlarmKind.PRELOAD_LOW, AlarmKind.PRELOAD_LOST)
        )
        return {
            AlarmKind.PRELOAD_LOW: (None if lost or not known else low, low_words),
            AlarmKind.PRELOAD_LOST: (lost if known else None, lost_words),
            AlarmKind.RATE: self._rate(health.trend),
            AlarmKind.SUDDEN_DROP: (None, SILENT),
            AlarmKind.MODEL: self._model(health, now_ns, known),
            AlarmKind.DATA_LOST: self._data_lost(health, now_ns),
            AlarmKind.SERVICE: (bool(self._down), next(iter(self._down.values()), SILENT)),
        }

    def _rate(self, trend: Trend | None) -> _Cause:
        if trend is not None and trend.status in (TrendStatus.FALLING, TrendStatus.FELL):
            self._falling_ns = trend.until_time_ns
        words, at_ns = SILENT, self._falling_ns
        if at_ns is not None:
            words = told(Code.PRELOAD_FELL_LATELY, {"time": clock(at_ns)}, time=rfc3339(at_ns))
        if trend is None or trend.rate_percent_per_h is None or self._fresh is None:
            return None, words
        share, rate = -100.0 / self._fresh, trend.rate_percent_per_h
        loss_per_h, limit_per_h = rate.value * share, self._rate_limit / 1000.0
        if trend.status is TrendStatus.FALLING:
            words = _rate_words(loss_per_h)
        if slowest_loss(rate) * share > limit_per_h:
            return True, words
        is_over = trend.status is TrendStatus.FELL or loss_per_h < 0.9 * limit_per_h
        return False if is_over else None, words

    def _data_lost(self, health: AxisHealth, now_ns: int) -> _Cause:
        is_missed = True if now_ns >= self._patient_until_ns else None
        return (is_missed, condition_words(health)) if _lacks_data(health) else (False, SILENT)

    def _model(self, health: AxisHealth, now_ns: int, known: bool) -> _Cause:
        if _lacks_data(health):
            return None, SILENT
        consistency = health.consistency
        is_lost = health.condition is AxisCondition.FAULT and not is_in_doubt(health)
        if is_lost and self._fit.lost >= _SURELY_LOST:
            consistency = None  # play and softness are what a lost preload brings
        if consistency is not None and consistency.state is ConsistencyState.DISAGREES:
            return True, _changed_words(consistency.channel or "")
        if self._fit.status is EstimateStatus.INVALID:
            is_lasting = not known and now_ns - health.since_time_ns >= _DOUBTED_S * NS_PER_S
            is_known = is_lasting and self._fit.is_settled  # a force makes it doubted for less
            return (True, told(Code.MODEL_DISAGREES)) if is_known else (None, SILENT)
        if self._fit.nis > _MODEL_NIS:
            return True, _changed_words("torque_nm")
        return (False if self._fit.nis < 0.8 * _MODEL_NIS else None), _changed_words("torque_nm")


def slowest_loss(rate: Interval) -> float:
    """Upper end of a rate beyond doubt, in its unit: negative where a loss is certain."""
    return rate.value + _BEYOND_DOUBT * (rate.high - rate.value)


def _lacks_data(health: AxisHealth) -> bool:
    codes = {reason.partition(":")[0] for reason in health.reasons}
    return health.condition is AxisCondition.UNAVAILABLE and not codes.isdisjoint(_DATA_CODES)


def _rate_words(loss_per_h: float) -> Statement:
    """Loss in percent over the longest time in which less than everything is lost."""
    short = (per for per, hours in _SPANS_H.items() if loss_per_h * hours < 100.0)
    per = next(short, "minute")
    rate = loss_per_h * _SPANS_H[per]
    return told(Code.PRELOAD_FALLING, {"per": f"per {per}"}, rate=rate, per=per)


def _changed_words(of: str) -> Statement:
    return told(Code.AXIS_CHANGED, {"watched": CHANNEL_WORDS.get(of, of)}, watched=of)
