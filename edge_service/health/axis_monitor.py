"""Monitor of one axis: condition, alarms, trend, use and consistency."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

from pydantic import TypeAdapter, ValidationError

from ..config_tables import AlarmsConfig
from ..messages.codec import Header
from ..messages.estimate import EstimateStatus, PreloadEstimate
from ..messages.event import Event
from ..messages.features import FeatureBlock
from ..messages.health import (
    AxisHealth,
    Command,
    ComponentHealth,
    Consistency,
    Outcome,
    PreloadFall,
)
from ..messages.interval import Frozen
from ..messages.trend import Trend, Use
from .alarm_latch import LatchSnapshot
from .alarms import AxisAlarms
from .axis_events import consistency_changed, log_entry, preload_rose, recording_kept
from .condition import ConditionMonitor, limits_of
from .consistency import ConsistencyWatch, LearnedChannel
from .inputs import NS_PER_S
from .statements import consistent
from .wear.friction import FrictionClasses, FrictionWatch
from .wear.trend import PreloadHistory, PreloadSteps, as_of, preload_trend
from .wear.usage import ScrewGeometry, UsageCounter

SNAPSHOT_SCHEMA: Literal["axis-watch/1"] = "axis-watch/1"
MOST_ANSWERED = 100
"""Commands of an axis that are known again; the oldest go."""
_SHORTEST_PERIOD_S, _LONGEST_PERIOD_S = 20.0, 600.0
_PERIOD_SHARE = 0.02
_RISES = 20
"""So many estimates in a row must lie above what was known before a rise is one."""


class AnsweredCommand(Frozen):
    """A command with a key, and its outcome; both are kept with the state that it led to.

    Attributes:
        sha256: of all of the command but its key and where it came from.
    """

    key: str
    sha256: str
    accepted: bool
    message: str


@dataclass(frozen=True, slots=True, eq=False)
class AxisSnapshot:
    """State that must outlive the process; what has a default, older versions' files lack."""

    schema: Literal["axis-watch/1"]
    axis: str
    alarms: dict[str, LatchSnapshot]
    use: Use
    friction: FrictionClasses
    series: PreloadSteps
    consistency: dict[str, LearnedChannel] | None = None
    saved_ns: int = 0  # UNIX time up to which it is known, ns
    answered: tuple[AnsweredCommand, ...] = ()
    fall: PreloadFall | None = None


_SNAPSHOTS = TypeAdapter(AxisSnapshot)


class AxisMonitor:
    """Monitor of one axis; every call returns the events that it caused."""

    def __init__(
        self,
        axis: str,
        fresh_percent: float | None,
        geometry: ScrewGeometry,
        settings: AlarmsConfig,
        now_ns: int,
    ) -> None:
        self.axis = axis
        self._fresh_percent = fresh_percent
        self._now_ns = now_ns
        self._limits = limits_of(settings, fresh_percent)
        self._condition = ConditionMonitor(axis, self._limits, now_ns)
        self._alarms = AxisAlarms(axis, fresh_percent, settings, now_ns)
        self._answered: dict[str, AnsweredCommand] = {}
        self._use = UsageCounter(geometry, now_ns)
        self._friction = FrictionWatch()
        self._consistency = ConsistencyWatch(geometry.ratio_m_per_rad)
        self._heard = (now_ns, 0.0)
        self._since_ns: int | None = None
        self._recording: str | None = None
        self._series = PreloadHistory()
        self._trend: Trend | None = None
        self._trend_ns, self._trend_period_s = 0, _SHORTEST_PERIOD_S
        self._rise_percent = settings.sudden_drop_percent / 100.0 * (fresh_percent or 1.0)
        self._rises = 0

    def on_preload(self, header: Header, latest: PreloadEstimate, now_ns: int) -> tuple[Event, ...]:
        events = self._condition.on_preload(header, latest, now_ns)
        sudden = self._alarms.on_preload(latest, header.source_time_ns, now_ns)
        if sudden:
            self._restart_trend()  # what comes now is another state
            self._friction.restart_newest()
        elif latest.status is EstimateStatus.ESTIMATED:
            events = (*events, *self._note_wear(latest, now_ns))
        return (*events, *sudden, *(self._look_at_alarms(now_ns) if events else ()))

    def on_feature(self, header: Header, block: FeatureBlock, now_ns: int) -> tuple[Event, ...]:
        self._use.add(block)
        self._friction.add(block)
        self._heard = (header.source_time_ns, block.time_s)
        noted: tuple[Event, ...] = ()
        if (change := self._consistency.add(block)) is not None:
            if change.disagrees:
                self._recording = None
                ago_ns = round(NS_PER_S * max(block.time_s - change.since_s, 0.0))
                self._since_ns = max(header.source_time_ns - ago_ns, 0)
            event = consistency_changed(self.axis, change, self._since_ns or now_ns, now_ns)
            noted = (event, *self._look_at_alarms(now_ns))
        return (*self._condition.on_feature(header, block, now_ns), *noted)

    def on_component(self, report: ComponentHealth, now_ns: int) -> tuple[Event, ...]:
        """Take a report in of a component of this axis, or of one that serves all axes."""
        changed = report.axis in (None, self.axis) and self._alarms.on_component(report)
        alarms = self._look_at_alarms(now_ns) if changed else ()
        return (*self._condition.on_component(report, now_ns), *alarms)

    def answered(self, command: Command) -> Outcome | None:
        """Outcome of a command that was asked before with the same key; None if it is new."""
        known = self._answered.get(command.key)
        if known is None:
            return None
        if known.sha256 != _digest(command):
            words = "this key was given to another command"
            return Outcome(accepted=False, message=words, reused=True)
        return Outcome(accepted=known.accepted, message=known.message)

    def obey(self, command: Command, now_ns: int) -> tuple[Outcome, tuple[Event, ...]]:
        """Do what a person asks, or refuse what would change nothing."""
        refusal = ""
        if command.action in ("acknowledge", "shelve", "unshelve"):
            refusal = self._alarms.refusal(command)
        asked = {"who": command.user, "origin": command.origin or "bus"}
        events = () if refusal else self.on_command(command, now_ns)
        events = tuple(event.model_copy(update=asked) for event in events)
        message = refusal or next((event.text for event in events), "")
        outcome = Outcome(accepted=not refusal, message=message)
        if command.key:
            self._answered[command.key] = AnsweredCommand(
                key=command.key, sha256=_digest(command), accepted=not refusal, message=message
            )
        while len(self._answered) > MOST_ANSWERED:
            del self._answered[next(iter(self._answered))]
        return outcome, events

    def on_command(self, command: Command, now_ns: int) -> tuple[Event, ...]:
        """Do what a person asks."""
        if command.action == "part_replaced":
            self._use.restart(now_ns)
            self._friction.restart()
            self._consistency.restart()
            self._restart_trend()
        if command.action in ("part_replaced", "note"):
            seen = self._alarms.on_command(command, now_ns)
            return (log_entry(self.axis, command, now_ns), *seen)
        if command.action == "recorded":
            self._recording = command.note
            return (recording_kept(self.axis, command.note, now_ns),)
        return self._alarms.on_command(command, now_ns)

    def tick(self, now_ns: int) -> tuple[Event, ...]:
        """Let time pass."""
        self._now_ns = now_ns
        return (*self._condition.tick(now_ns), *self._look_at_alarms(now_ns))

    def health(self, now_ns: int) -> AxisHealth:
        """Condition of the axis with everything beside it, as of now."""
        health = self._judged(now_ns)
        more = {
            "alarms": self._alarms.shown(health, now_ns),
            "fall": self._alarms.fall,
            "use": self._use.use(),
            "friction": self._friction.curve(),
        }
        return consistent(health.model_copy(update=more), self._condition.estimate)

    def trend_is_due(self, now_ns: int) -> bool:
        """There is something new to report."""
        return abs(now_ns - self._trend_ns) >= self._trend_period_s * NS_PER_S

    def trend_work(self) -> Callable[[], Trend]:
        """Work that makes the trend of what is known now: some ten milliseconds, for any thread."""
        limits, points = self._limits, self._series.points()
        ahead = {"warning": limits.warning_percent, "fault": limits.fault_percent} if limits else {}
        span_s = float(points[0][-1] - points[0][0]) if points[0].size else 0.0
        period_s = min(max(_PERIOD_SHARE * span_s, _SHORTEST_PERIOD_S), _LONGEST_PERIOD_S)
        self._trend_period_s = period_s
        return partial(preload_trend, *points, ahead, self._fresh_percent)

    def take_trend(self, trend: Trend, now_ns: int) -> None:
        """Show a trend that `trend_work` made."""
        self._trend, self._trend_ns = trend, now_ns

    def snapshot(self) -> dict[str, Any]:
        """State that must outlive the process, for JSON."""
        snapshot = AxisSnapshot(
            schema=SNAPSHOT_SCHEMA,
            axis=self.axis,
            alarms=self._alarms.snapshot(),
            use=self._use.use(),
            friction=self._friction.snapshot(),
            series=self._series.snapshot(),
            consistency=self._consistency.snapshot(),
            saved_ns=self._now_ns,
            answered=tuple(self._answered.values()),
            fall=self._alarms.fall,
        )
        document: dict[str, Any] = _SNAPSHOTS.dump_python(snapshot, mode="json")
        return document

    def restore(self, document: object, step_ns: int = 0) -> None:
        """Go on from a snapshot; one of the future is of a clock that was set since.

        Args:
            step_ns: by which the clock was set since, as far as that is known, ns.

        Raises ValueError, and then this monitor is of no more use.
        """
        try:
            snapshot = _SNAPSHOTS.validate_python(document)
            if snapshot.axis != self.axis:
                raise ValueError(f"{SNAPSHOT_SCHEMA} of axis {snapshot.axis}, not {self.axis}")
            step_ns = min(self._now_ns - snapshot.saved_ns, step_ns)
            self._alarms.restore(snapshot.alarms, snapshot.fall, step_ns)
            self._answered = {each.key: each for each in snapshot.answered}
            self._use.restore(snapshot.use, step_ns)
            self._friction.restore(snapshot.friction)
            self._series.restore(snapshot.series)
            self._series.move(step_ns / NS_PER_S)
            if snapshot.consistency is not None:
                self._consistency.restore(snapshot.consistency)
            self.health(self._heard[0])  # numbers of the right shape may still mean nothing
            json.dumps(self.snapshot(), allow_nan=False)
            self.trend_work()()
        except ValidationError as error:
            (first, *_) = error.errors(include_url=False)
            place = ".".join(map(str, first["loc"]))
            raise ValueError(f"no {SNAPSHOT_SCHEMA}: {place}: {first['msg']}") from None
        except (ArithmeticError, LookupError, TypeError, AttributeError) as error:
            raise ValueError(f"no {SNAPSHOT_SCHEMA}: {type(error).__name__}: {error}") from None

    def _note_wear(self, estimate: PreloadEstimate, now_ns: int) -> tuple[Event, ...]:
        percent, low, high = estimate.preload_percent, estimate.low, estimate.high
        fresh = self._fresh_percent
        if percent is None or low is None or high is None or fresh is None:
            return ()
        known = self._series.newest()
        rose = known is not None and percent - known > self._rise_percent and low > known
        self._rises = self._rises + 1 if rose else 0
        if rose and self._rises < _RISES:
            return ()  # not yet sure: keep it out of the trend
        events: tuple[Event, ...] = ()
        if rose and known is not None:
            share = 100.0 / fresh
            events = (preload_rose(self.axis, share * known, share * percent, now_ns),)
            self._restart_trend()
        half_width = 0.5 * (high - low)
        self._series.add(now_ns / NS_PER_S, percent, half_width, self._use.distance_m)
        return events

    def _look_at_alarms(self, now_ns: int) -> tuple[Event, ...]:
        return self._alarms.tick(self._judged(now_ns), now_ns)

    def _judged(self, now_ns: int) -> AxisHealth:
        shown: Consistency = self._consistency.shown()
        if shown.channel is not None:
            since = {"since_time_ns": self._since_ns, "recording": self._recording}
            shown = shown.model_copy(update=since)
        more = {"consistency": shown, "trend": self._trend and as_of(self._trend, now_ns)}
        return self._condition.health(now_ns).model_copy(update=more)

    def _restart_trend(self) -> None:
        self._series.clear()
        self._trend, self._trend_ns, self._rises = None, 0, 0


def _digest(command: Command) -> str:
    return hashlib.sha256(command.model_dump_json(exclude={"key", "origin"}).encode()).hexdigest()
