"""The last word on every axis, for whoever presents it."""

from collections.abc import Mapping
from dataclasses import dataclass

from ..messages.estimate import EstimateStatus, PreloadEstimate
from ..messages.event import Event
from ..messages.header import Header
from ..messages.health import AxisCondition, AxisHealth, ComponentHealth
from ..messages.topics import HEALTH, PRELOAD
from .component import ComponentWatch
from .event_log import EventLog
from .fan_out import FanOut
from .history import Bucket, PreloadHistory
from .input_watch import InputWatch
from .settings import AxisLimits


@dataclass(frozen=True, slots=True)
class BoardSettings:
    """Sizes and times of the board.

    Attributes:
        preload_stale_after_s: an estimate older than this is no longer shown.
        health_stale_after_s: the same for the condition.
        component_silent_after_s: a component silent for longer is in error; None to switch off.
        history_span_s: how far back the history reaches, s.
        history_step_s: one estimate is kept per step, s.
        event_capacity: events kept.
        backlog_capacity: events that may wait for one slow reader.
    """

    preload_stale_after_s: float = PRELOAD.stale_after_s
    health_stale_after_s: float = HEALTH.stale_after_s
    component_silent_after_s: float | None = HEALTH.stale_after_s
    history_span_s: float = 86400.0
    history_step_s: float = 1.0
    event_capacity: int = 1000
    backlog_capacity: int = 256


@dataclass(frozen=True, slots=True)
class PreloadReading:
    """What may be shown of the preload of one axis now.

    Attributes:
        estimate: numbers are None unless its status is `estimated` and it is fresh.
        measured_ns: UNIX time of the newest sample behind the last estimate, ns; None if none.
        age_s: time since then, s.
    """

    axis: str
    estimate: PreloadEstimate
    measured_ns: int | None
    age_s: float | None


class _AxisBoard:
    """What is known of one axis."""

    def __init__(self, limits: AxisLimits | None, settings: BoardSettings) -> None:
        self.limits = limits
        self.preload_input = InputWatch(settings.preload_stale_after_s)
        self.health_input = InputWatch(settings.health_stale_after_s)
        self.history = PreloadHistory(settings.history_span_s, settings.history_step_s)
        self.estimate: PreloadEstimate | None = None
        self.health: AxisHealth | None = None


class Board:
    """Last values, history and events of a fixed set of axes.

    Payloads of other axes are ignored and counted, so nobody on the bus can make it grow. It may
    be used from the thread of one event loop only.

    Parameters
    ----------
    axes : Mapping[str, AxisLimits or None]
        The configured axes with their limits (for display only), in the order of display.
    now_ns : int
        UNIX time of the start, ns.
    settings : BoardSettings
        Sizes and times.
    """

    def __init__(
        self,
        axes: Mapping[str, AxisLimits | None],
        now_ns: int,
        settings: BoardSettings | None = None,
    ) -> None:
        settings = settings or BoardSettings()
        self._started_ns = now_ns
        self._axes = {axis: _AxisBoard(limits, settings) for axis, limits in axes.items()}
        self._components = ComponentWatch(settings.component_silent_after_s)
        self.events = EventLog(settings.event_capacity)
        self.readers = FanOut(settings.backlog_capacity)
        self.ignored_payloads = 0

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes."""
        return tuple(self._axes)

    def on_preload(self, axis: str, header: Header, estimate: PreloadEstimate, now_ns: int) -> None:
        """Take an estimate in; one that is older than the last is ignored."""
        board = self._known(axis)
        if board is None or not board.preload_input.accept(header, now_ns):
            return
        board.estimate = estimate
        board.history.append(header.source_time_ns, estimate)
        self.readers.mark(PRELOAD.name, axis)

    def on_health(self, header: Header, health: AxisHealth, now_ns: int) -> None:
        """Take the condition of an axis in; one that is older than the last is ignored."""
        board = self._known(health.axis)
        if board is None or not board.health_input.accept(header, now_ns):
            return
        board.health = health
        self.readers.mark(HEALTH.name, health.axis)

    def on_event(self, event: Event, now_ns: int) -> None:
        """Log an event and hand it to the live readers."""
        if event.axis and self._known(event.axis) is None:
            return
        self.readers.put_event(self.events.append(event, now_ns))

    def on_component(self, report: ComponentHealth, now_ns: int) -> None:
        """Take a component's report in."""
        if report.axis is None or self._known(report.axis) is not None:
            self._components.on_report(report, now_ns)

    def preload(self, axis: str, now_ns: int) -> PreloadReading:
        """What may be shown of the preload of an axis now; KeyError for an unknown axis."""
        board = self._axes[axis]
        header = board.preload_input.header
        return PreloadReading(
            axis=axis,
            estimate=self._readable(board, now_ns),
            measured_ns=None if header is None else header.source_time_ns,
            age_s=board.preload_input.age_s(now_ns),
        )

    def health(self, axis: str, now_ns: int) -> AxisHealth:
        """Condition of an axis now; UNAVAILABLE as soon as it rests on something stale."""
        board = self._axes[axis]
        last = board.health or AxisHealth(
            axis=axis, condition=AxisCondition.UNAVAILABLE, since_time_ns=self._started_ns
        )
        changes: dict[str, object] = {"components": self._components_of(axis, last, now_ns)}
        missing = self._missing(board, now_ns)
        if missing:
            own = last.reasons if last.condition is AxisCondition.UNAVAILABLE else ()
            changes["reasons"] = tuple(dict.fromkeys((*missing, *own)))
        if missing and last.condition is not AxisCondition.UNAVAILABLE:
            changes["condition"] = AxisCondition.UNAVAILABLE
            changes["since_time_ns"] = self._missing_since_ns(board, now_ns)
        return last.model_copy(update=changes)

    def components(self, now_ns: int) -> tuple[ComponentHealth, ...]:
        """Components that serve all axes."""
        reports = self._components.reports(now_ns)
        return tuple(report for report in reports if report.axis is None)

    def limits(self, axis: str) -> AxisLimits | None:
        """Limits of an axis, for display; KeyError for an unknown axis."""
        return self._axes[axis].limits

    def history(self, axis: str, start_s: float, end_s: float, step_s: float) -> tuple[Bucket, ...]:
        """Buckets of the axis' history; see PreloadHistory.buckets."""
        return self._axes[axis].history.buckets(start_s, end_s, step_s)

    def lost_payloads(self, axis: str) -> dict[str, int]:
        """Payloads missing in the sequence, per topic."""
        board = self._axes[axis]
        return {PRELOAD.name: board.preload_input.lost, HEALTH.name: board.health_input.lost}

    def unready(self, now_ns: int) -> tuple[str, ...]:
        """Why the service cannot answer for every axis; empty if it can."""
        if not self._axes:
            return ("no_axis: no axis is configured",)
        return tuple(
            f"{axis}: {reason}"
            for axis, board in self._axes.items()
            for reason in self._missing(board, now_ns)
        )

    def close(self) -> None:
        """End all live streams, so that a server can stop."""
        self.readers.close()

    def _known(self, axis: str) -> _AxisBoard | None:
        board = self._axes.get(axis)
        if board is None:
            self.ignored_payloads += 1
        return board

    @staticmethod
    def _readable(board: _AxisBoard, now_ns: int) -> PreloadEstimate:
        estimate = board.estimate
        missing = _missing_preload(board.preload_input, now_ns)
        if estimate is None or missing is not None:
            return PreloadEstimate(
                time_s=0.0 if estimate is None else estimate.time_s,
                status=EstimateStatus.UNESTIMATED,
                reasons=() if missing is None else (missing,),
            )
        if estimate.status is EstimateStatus.ESTIMATED:
            return estimate
        return PreloadEstimate(
            time_s=estimate.time_s,
            status=estimate.status,
            reasons=estimate.reasons,
            level=estimate.level,
            data_used_s=estimate.data_used_s,
        )

    @staticmethod
    def _missing(board: _AxisBoard, now_ns: int) -> tuple[str, ...]:
        reasons = (
            _missing_preload(board.preload_input, now_ns),
            _missing_health(board.health_input, now_ns),
        )
        return tuple(reason for reason in reasons if reason is not None)

    def _missing_since_ns(self, board: _AxisBoard, now_ns: int) -> int:
        inputs = (board.preload_input, board.health_input)
        stale = (each.stale_since_ns for each in inputs if each.is_stale(now_ns))
        return max(min(stale), self._started_ns)

    def _components_of(
        self, axis: str, health: AxisHealth, now_ns: int
    ) -> tuple[ComponentHealth, ...]:
        own = {report.component: report for report in health.components}
        heard = self._components.reports(now_ns)
        own |= {report.component: report for report in heard if report.axis == axis}
        return tuple(own.values())


def _missing_preload(preload_input: InputWatch, now_ns: int) -> str | None:
    if preload_input.header is None:
        return "no_input: no preload estimate heard yet"
    if preload_input.is_stale(now_ns):
        limit_s = preload_input.stale_after_s
        return f"stale_input: no new preload estimate for more than {limit_s:g} s"
    return None


def _missing_health(health_input: InputWatch, now_ns: int) -> str | None:
    if health_input.header is None:
        return "no_health: the condition was not heard yet"
    if health_input.is_stale(now_ns):
        return f"stale_health: condition not renewed for more than {health_input.stale_after_s:g} s"
    return None
