"""Condition of one axis, its data faults and components, and events of their changes."""

from ..messages.codec import Header
from ..messages.estimate import EstimateStatus, PreloadEstimate
from ..messages.event import AxisCondition, Code, Event, Statement, told
from ..messages.features import FeatureBlock
from ..messages.health import AxisHealth, ComponentHealth
from ..messages.topics import FEAT, HEALTH, PRELOAD
from .components import ComponentWatch
from .inputs import DataFaults, InputWatch, moved
from .limits import GRACE_NS, HealthSettings, LimitTracker, PreloadBounds

FAULT_CLEAR_S = 5.0
"""A data fault is over when it was not seen for this long."""
_NO_NUMBER = {
    EstimateStatus.UNESTIMATED: "no_number: the data cannot tell the preload yet",
    EstimateStatus.INSUFFICIENT_EXCITATION: "no_number: recent motion cannot tell the preload",
    EstimateStatus.INVALID: "no_number: model and data disagree, or the data are faulty",
}
_Verdict = tuple[AxisCondition, tuple[str, ...]]


class ConditionMonitor:
    """Monitor of one axis from its inputs; every call returns the events that it caused.

    The condition is UNAVAILABLE without input, with stale input, while no number came for
    10 s, where no limit is known, and until the first numbers have lasted for 0.3 s.

    Args:
        axis: Name of the axis.
        fresh_preload_percent: Preload of the fresh screw in percent of the dynamic load rating;
            None if not known.
        settings: Limits.
        now_ns: UNIX time of the start, ns.
    """

    def __init__(
        self,
        axis: str,
        fresh_preload_percent: float | None,
        settings: HealthSettings,
        now_ns: int,
    ) -> None:
        self.axis = axis
        limits = settings.limits(fresh_preload_percent)
        self._limits = None if limits is None else LimitTracker(limits)
        self._shown_limits = None if limits is None else limits.shown
        self._preload_input = InputWatch(PRELOAD.stale_after_s)
        self._feature_input = InputWatch(FEAT.stale_after_s)
        self._components = ComponentWatch(HEALTH.stale_after_s)
        self._data_faults = DataFaults(axis, FAULT_CLEAR_S)
        self.estimate: PreloadEstimate | None = None
        self._estimated_ns: int | None = None
        self._condition = AxisCondition.UNAVAILABLE
        self._since_ns = now_ns

    def on_preload(
        self, header: Header, estimate: PreloadEstimate, now_ns: int
    ) -> tuple[Event, ...]:
        """Take an estimate in; one that is older than the last is ignored."""
        if not self._preload_input.accept(header, now_ns):
            return ()
        before, self.estimate = self.estimate, estimate
        if estimate.status is EstimateStatus.ESTIMATED:
            self._estimated_ns = now_ns
            bounds = _bounds(estimate)
            if self._limits is not None and bounds is not None:
                self._limits.update(bounds, header.source_time_ns)
        return (*self._status_events(before, estimate, now_ns), *self.tick(now_ns))

    def on_feature(self, header: Header, block: FeatureBlock, now_ns: int) -> tuple[Event, ...]:
        """Count the data faults of an interval; one that is older than the last is ignored."""
        if not self._feature_input.accept(header, now_ns):
            return ()
        return self._data_faults.count(block.fault, now_ns)

    def on_component(self, report: ComponentHealth, now_ns: int) -> tuple[Event, ...]:
        """Take a component's report in; those of other axes are ignored."""
        if report.axis != self.axis:
            return ()
        return self._components.on_report(report, now_ns)

    def tick(self, now_ns: int) -> tuple[Event, ...]:
        """Let time pass: what went stale or is over by now."""
        before = self._condition
        condition, reasons = self._verdict(now_ns)
        events = (*self._data_faults.tick(now_ns), *self._components.tick(now_ns))
        if condition is before:
            return events
        self._condition = condition
        self._since_ns = now_ns
        if condition is AxisCondition.UNAVAILABLE and self._limits is not None:
            self._limits.restart()
        return (self._condition_event(before, condition, reasons, now_ns), *events)

    def move(self, step_ns: int) -> None:
        """The clock was set by a step, ns."""
        self._since_ns += step_ns
        self._estimated_ns = moved(self._estimated_ns, step_ns)
        parts = (self._preload_input, self._feature_input, self._components, self._data_faults)
        for part in parts:
            part.move(step_ns)
        if self._limits is not None:
            self._limits.move(step_ns)

    def health(self, now_ns: int) -> AxisHealth:
        """Condition of the axis as of now."""
        condition, reasons = self._verdict(now_ns)
        is_known = condition is not AxisCondition.UNAVAILABLE
        below = self._limits.below if is_known and self._limits is not None else None
        estimate, header = self.estimate, self._preload_input.header
        if self._preload_input.is_stale(now_ns):
            estimate = None
        return AxisHealth(
            axis=self.axis,
            condition=condition,
            status=EstimateStatus.UNESTIMATED if estimate is None else estimate.status,
            method=None if estimate is None else estimate.method,
            measured_time_ns=None if header is None else header.source_time_ns,
            limits=self._shown_limits,
            reasons=reasons,
            since_time_ns=self._since_ns if condition is self._condition else now_ns,
            components=self._components.reports(now_ns),
            data_faults=dict(self._data_faults.counts),
            below=below,
        )

    def _verdict(self, now_ns: int) -> _Verdict:
        if self.estimate is None or self._preload_input.is_stale(now_ns):
            return AxisCondition.UNAVAILABLE, self._missing_input(now_ns)
        if self._limits is None or self._percent_missing(self.estimate):
            return AxisCondition.UNAVAILABLE, self._no_limit(self.estimate)
        held: tuple[str, ...] = ()
        if self.estimate.status is not EstimateStatus.ESTIMATED:
            held = (_NO_NUMBER[self.estimate.status], *self.estimate.reasons)
            if not self._within_grace(now_ns):
                return AxisCondition.UNAVAILABLE, held
        condition = self._limits.condition
        if condition is None:
            first = "confirming: the first numbers must last for a moment"
            return AxisCondition.UNAVAILABLE, held or (first,)
        return condition, (*self._limits.reasons, *held)

    def _missing_input(self, now_ns: int) -> tuple[str, ...]:
        preparing = self._components.preparing(self.axis, now_ns)
        if preparing is not None:
            return (preparing,)
        if self.estimate is None:
            reasons = ["no_input: no preload estimate heard yet"]
        else:
            limit_s = PRELOAD.stale_after_s
            reasons = [f"stale_input: no new preload estimate for more than {limit_s:g} s"]
        if self._feature_input.is_stale(now_ns):
            reasons.append("no_data: no measured data of the axis either")
        return tuple(reasons)

    @staticmethod
    def _percent_missing(estimate: PreloadEstimate) -> bool:
        return estimate.status is EstimateStatus.ESTIMATED and estimate.preload_percent is None

    def _no_limit(self, estimate: PreloadEstimate) -> tuple[str, ...]:
        if self._percent_missing(estimate):
            reason = "no_limit: preload in % not available"
        else:
            reason = "no_limit: the preload of the fresh screw is not known"
        return (reason, *estimate.reasons)

    def _within_grace(self, now_ns: int) -> bool:
        if self._estimated_ns is None:
            return False
        return 0 <= now_ns - self._estimated_ns <= GRACE_NS

    def _status_events(
        self, before: PreloadEstimate | None, estimate: PreloadEstimate, now_ns: int
    ) -> tuple[Event, ...]:
        if before is not None and before.status is estimate.status:
            return ()
        reason = f": {estimate.reasons[0]}" if estimate.reasons else ""
        invalid = estimate.status is EstimateStatus.INVALID
        event = Event(
            axis=self.axis,
            kind="status_changed",
            level=AxisCondition.WARNING if invalid else AxisCondition.NORMAL,
            text=f"estimate is {estimate.status.replace('_', ' ')}{reason}",
            time_ns=now_ns,
            data={"from": None if before is None else before.status, "to": estimate.status},
        )
        return (event,)

    def _condition_event(
        self,
        before: AxisCondition,
        condition: AxisCondition,
        reasons: tuple[str, ...],
        now_ns: int,
    ) -> Event:
        supported = condition is not AxisCondition.UNAVAILABLE
        percent = _readable_percent(self.estimate) if supported else None
        words = _condition_words(condition, reasons)
        return Event(
            axis=self.axis,
            kind="condition_changed",
            level=condition,
            text=words.text,
            code=words.code,
            values=words.values,
            time_ns=now_ns,
            data={"from": before, "to": condition, "preload_percent": percent},
        )


def _condition_words(condition: AxisCondition, reasons: tuple[str, ...]) -> Statement:
    """A new condition, with the first reason; as it is sent, that is a code."""
    if not reasons:
        return told(Code.CONDITION_CHANGED, condition=condition.value)
    first, name = reasons[0], reasons[0].partition(":")[0]
    return told(
        Code.CONDITION_CHANGED_FOR, {"reason": first}, condition=condition.value, reason=name
    )


def _readable_percent(estimate: PreloadEstimate | None) -> float | None:
    if estimate is None or estimate.status is not EstimateStatus.ESTIMATED:
        return None
    return estimate.preload_percent


def _bounds(estimate: PreloadEstimate) -> PreloadBounds | None:
    """Preload with its interval; without bounds nothing is certain."""
    if estimate.preload_percent is None:
        return None
    return PreloadBounds(
        value=estimate.preload_percent,
        low=float("-inf") if estimate.low is None else estimate.low,
        high=float("inf") if estimate.high is None else estimate.high,
    )
