"""Everything that is known and asked about one axis: judge, alarms, trend, use."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from ..messages.alarm import Command
from ..messages.estimate import EstimateStatus, PreloadEstimate
from ..messages.event import Event, Severity
from ..messages.features import FeatureBlock
from ..messages.header import Header
from ..messages.health import AxisHealth, ComponentHealth
from ..messages.outlook import Trend
from .alarm_bench import AlarmBench, AlarmSettings
from .friction_watch import FrictionWatch
from .input_watch import NS_PER_S
from .judge import HealthJudge
from .outlook import trend_of
from .settings import HealthSettings
from .use_meter import ScrewGeometry, UseMeter
from .wear_series import WearSeries

SNAPSHOT_SCHEMA = "axis-watch/1"
_SHORTEST_PERIOD_S, _LONGEST_PERIOD_S = 5.0, 600.0
_PERIOD_SHARE = 0.02
_RISES = 20
"""So many estimates in a row must lie above what was known before a rise is one."""


@dataclass(frozen=True, slots=True)
class AxisFacts:
    """What the machine file tells of one axis.

    Attributes:
        fresh_percent: preload of the fresh screw, percent of the load rating; None if unknown.
    """

    axis: str
    fresh_percent: float | None
    geometry: ScrewGeometry


class AxisWatch:
    """Watches one axis; every call returns the events that it caused."""

    def __init__(
        self, facts: AxisFacts, settings: HealthSettings, alarms: AlarmSettings, now_ns: int
    ) -> None:
        self.axis = facts.axis
        self._judge = HealthJudge(facts.axis, facts.fresh_percent, settings, now_ns)
        self._alarms = AlarmBench(facts.axis, facts.fresh_percent, alarms, now_ns)
        limits = settings.limits(facts.fresh_percent)
        self._limits_percent = (
            {}
            if limits is None
            else {"warning": limits.warning_percent, "fault": limits.fault_percent}
        )
        self._use = UseMeter(facts.geometry, now_ns)
        self._friction = FrictionWatch()
        self._series = WearSeries()
        self._trend: Trend | None = None
        self._trend_ns = 0
        self._rise_percent = alarms.sudden_drop_percent / 100.0 * (facts.fresh_percent or 1.0)
        self._rises = 0

    def on_preload(
        self, header: Header, estimate: PreloadEstimate, now_ns: int
    ) -> tuple[Event, ...]:
        """Take an estimate in."""
        events = self._judge.on_preload(header, estimate, now_ns)
        sudden = self._alarms.on_preload(estimate, header.source_time_ns, now_ns)
        if sudden:
            self._series.clear()  # what comes now is another state: its trend begins anew
            self._friction.restart_newest()
            self._trend = None
            self._trend_ns = 0
        elif estimate.status is EstimateStatus.ESTIMATED:
            events = (*events, *self._note_wear(header.source_time_ns, estimate, now_ns))
        return (*events, *sudden, *(self._look_at_alarms(now_ns) if events else ()))

    def on_feature(self, header: Header, block: FeatureBlock, now_ns: int) -> tuple[Event, ...]:
        """Take an interval in."""
        self._use.add(block)
        self._friction.add(block)
        return self._judge.on_feature(header, block, now_ns)

    def on_component(self, report: ComponentHealth, now_ns: int) -> tuple[Event, ...]:
        """Take a component's report in."""
        return self._judge.on_component(report, now_ns)

    def on_command(self, command: Command, now_ns: int) -> tuple[Event, ...]:
        """Do what a person asks."""
        if command.action == "part_replaced":
            self._restart(now_ns)
        if command.action in ("part_replaced", "note"):
            return (_log_entry(self.axis, command, now_ns),)
        return self._alarms.on_command(command, now_ns)

    def tick(self, now_ns: int) -> tuple[Event, ...]:
        """Let time pass."""
        return (*self._judge.tick(now_ns), *self._look_at_alarms(now_ns))

    def health(self, now_ns: int) -> AxisHealth:
        """Condition of the axis with everything beside it, as of now."""
        return self._judge.health(now_ns).model_copy(
            update={
                "alarms": self._alarms.shown(),
                "trend": self._trend,
                "use": self._use.use(),
                "friction": self._friction.curve(),
            }
        )

    def trend_is_due(self, now_ns: int) -> bool:
        """Whether there is something new to tell."""
        time_s = self._series.points()[0]
        span_s = float(time_s[-1] - time_s[0]) if time_s.size else 0.0
        period_s = min(max(_PERIOD_SHARE * span_s, _SHORTEST_PERIOD_S), _LONGEST_PERIOD_S)
        return abs(now_ns - self._trend_ns) >= period_s * NS_PER_S

    def trend_work(self) -> Callable[[], Trend]:
        """What makes the trend of what is known now: some ten milliseconds, for any thread."""
        return partial(trend_of, *self._series.points(), self._limits_percent)

    def take_trend(self, trend: Trend, now_ns: int) -> None:
        """Show a trend that `trend_work` made."""
        self._trend, self._trend_ns = trend, now_ns

    def snapshot(self) -> dict[str, Any]:
        """Everything that must outlive the process, for JSON."""
        return {
            "schema": SNAPSHOT_SCHEMA,
            "axis": self.axis,
            "alarms": self._alarms.snapshot(),
            "use": self._use.snapshot(),
            "friction": self._friction.snapshot(),
            "series": self._series.snapshot(),
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go on from a snapshot; ValueError if it is none."""
        if snapshot.get("schema") != SNAPSHOT_SCHEMA or snapshot.get("axis") != self.axis:
            raise ValueError(f"no {SNAPSHOT_SCHEMA} of axis {self.axis}")
        try:
            self._alarms.restore(snapshot["alarms"])
            self._use.restore(snapshot["use"])
            self._friction.restore(snapshot["friction"])
            self._series.restore(snapshot["series"])
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"a damaged {SNAPSHOT_SCHEMA}: {error}") from error

    def _note_wear(self, time_ns: int, estimate: PreloadEstimate, now_ns: int) -> tuple[Event, ...]:
        percent, low, high = estimate.preload_percent, estimate.low, estimate.high
        if percent is None or low is None or high is None:
            return ()
        known = self._series.newest()
        rose = known is not None and percent - known > self._rise_percent and low > known
        self._rises = self._rises + 1 if rose else 0
        if rose and self._rises < _RISES:
            return ()  # not yet sure: keep it out of the trend
        events: tuple[Event, ...] = ()
        if rose and known is not None:
            events = (_rise_event(self.axis, known, percent, now_ns),)
            self._series.clear()
            self._trend, self._trend_ns, self._rises = None, 0, 0
        half_width = 0.5 * (high - low)
        self._series.add(time_ns / NS_PER_S, percent, half_width, self._use.distance_m)
        return events

    def _look_at_alarms(self, now_ns: int) -> tuple[Event, ...]:
        return self._alarms.tick(self._judge.health(now_ns), self._trend, now_ns)

    def _restart(self, now_ns: int) -> None:
        self._use.restart(now_ns)
        self._friction.restart()
        self._series.clear()
        self._trend = None


def _rise_event(axis: str, before: float, percent: float, now_ns: int) -> Event:
    return Event(
        axis=axis,
        kind="preload_rose",
        severity=Severity.INFO,
        message=(
            f"preload rose from {before:.2f} to {percent:.2f} %, which wear cannot do: its trend "
            "begins anew; if a part was replaced, note it"
        ),
        time_ns=now_ns,
        data={"from_percent": before, "to_percent": percent},
    )


def _log_entry(axis: str, command: Command, now_ns: int) -> Event:
    replaced = command.action == "part_replaced"
    words = command.note or ("part replaced" if replaced else "")
    return Event(
        axis=axis,
        kind="part_replaced" if replaced else "note",
        severity=Severity.INFO,
        message=f"{words} ({command.user})",
        time_ns=now_ns,
        data={"user": command.user},
    )
