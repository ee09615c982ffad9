"""Condition of one axis, its data faults and components, and events of their changes."""

from ..messages.answer import of_fresh
from ..messages.codec import Header
from ..messages.estimate import EstimateStatus, PreloadEstimate
from ..messages.event import AxisCondition, Code, Event, Statement, told
from ..messages.features import FeatureBlock
from ..messages.health import AxisHealth, ComponentHealth, Limits
from ..messages.topics import FEAT, HEALTH, PRELOAD
from .axis_events import noted
from .components import ComponentWatch
from .inputs import DataFaults, Heard
from .limits import GRACE_NS, LimitTracker

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
        limits: None where the fresh screw's preload is not known.
    """

    def __init__(self, axis: str, limits: Limits | None, now_ns: int) -> None:
        self.axis, self._limits = axis, limits
        self._tracker = None if limits is None else LimitTracker(limits)
        self._preload = Heard[PreloadEstimate](PRELOAD.stale_after_s)
        self._features = Heard[FeatureBlock](FEAT.stale_after_s)
        self._components = ComponentWatch(HEALTH.stale_after_s)
        self._data_faults = DataFaults(axis)
        self._estimated_ns: int | None = None
        self._condition = AxisCondition.UNAVAILABLE
        self._since_ns = now_ns

    @property
    def estimate(self) -> PreloadEstimate | None:
        return self._preload.payload

    def on_preload(
        self, header: Header, estimate: PreloadEstimate, now_ns: int
    ) -> tuple[Event, ...]:
        before = self.estimate
        self._preload.hear(header, estimate, now_ns)
        if estimate.status is EstimateStatus.ESTIMATED:
            self._estimated_ns = now_ns
        if self._tracker is not None:
            self._tracker.update(estimate, header.source_time_ns)
        changed: tuple[Event, ...] = ()
        if before is None or before.status is not estimate.status:
            reason = f": {estimate.reasons[0]}" if estimate.reasons else ""
            invalid = estimate.status is EstimateStatus.INVALID
            level = AxisCondition.WARNING if invalid else AxisCondition.NORMAL
            text = f"estimate is {estimate.status.replace('_', ' ')}{reason}"
            data = {"from": None if before is None else before.status, "to": estimate.status}
            about = (now_ns, data, level)
            changed = (noted(self.axis, "status_changed", Statement(text=text), *about),)
        return (*changed, *self.tick(now_ns))

    def on_feature(self, header: Header, block: FeatureBlock, now_ns: int) -> tuple[Event, ...]:
        """Count the data faults of an interval."""
        self._features.hear(header, block, now_ns)
        return self._data_faults.count(block.fault, now_ns)

    def on_component(self, report: ComponentHealth, now_ns: int) -> tuple[Event, ...]:
        """Take a component's report in; those of other axes are ignored."""
        return self._components.on_report(report, now_ns) if report.axis == self.axis else ()

    def tick(self, now_ns: int) -> tuple[Event, ...]:
        """Let time pass: what went stale or is over by now."""
        before = self._condition
        condition, reasons = self._verdict(now_ns)
        events = (*self._data_faults.tick(now_ns), *self._components.tick(now_ns))
        if condition is before:
            return events
        self._condition = condition
        self._since_ns = now_ns
        if condition is AxisCondition.UNAVAILABLE and self._tracker is not None:
            self._tracker.restart()
        words = told(Code.CONDITION_CHANGED, condition=condition.value)
        if reasons:
            code, _, sentence = reasons[0].partition(": ")
            said = {"reason": sentence.rstrip(".")}
            words = told(Code.CONDITION_CHANGED_FOR, said, condition=condition.value, reason=code)
        is_known = self.estimate is not None and condition is not AxisCondition.UNAVAILABLE
        percent = self.estimate.preload_percent if is_known and self.estimate else None
        data = {"from": before, "to": condition, "preload_percent": percent}
        return (noted(self.axis, "condition_changed", words, now_ns, data, condition), *events)

    def health(self, now_ns: int) -> AxisHealth:
        """Condition of the axis as of now, with its number."""
        condition, reasons = self._verdict(now_ns)
        heard, limits = self._preload, self._limits
        estimate = None if heard.is_stale(now_ns) else self.estimate
        number = None
        if estimate is not None and condition is not AxisCondition.UNAVAILABLE:
            number = of_fresh(estimate, None if limits is None else limits.fresh_percent)
        return AxisHealth(
            axis=self.axis,
            condition=condition,
            status=EstimateStatus.UNESTIMATED if estimate is None else estimate.status,
            method=None if estimate is None else estimate.method,
            of_fresh=number,
            measured_time_ns=heard.measured_ns,
            limits=limits,
            reasons=reasons,
            since_time_ns=self._since_ns if condition is self._condition else now_ns,
            components=self._components.reports(now_ns),
            data_faults=dict(self._data_faults.counts),
        )

    def _verdict(self, now_ns: int) -> _Verdict:
        missing = self._components.missing(self._preload, self.axis, now_ns)
        if missing is not None or self.estimate is None:
            reasons: tuple[str, ...] = (missing or "",)
            if self._features.is_stale(now_ns) and not reasons[0].startswith("preparing"):
                reasons = (*reasons, "no_data: no measured data of the axis either")
            return AxisCondition.UNAVAILABLE, reasons
        estimated = self.estimate.status is EstimateStatus.ESTIMATED
        reason = ""
        if estimated and self.estimate.preload_percent is None:
            reason = "no_limit: preload in % not available"
        elif self._tracker is None:
            reason = "no_limit: the preload of the fresh screw is not known"
        if reason or self._tracker is None:
            return AxisCondition.UNAVAILABLE, (reason, *self.estimate.reasons)
        held: tuple[str, ...] = ()
        if not estimated:
            held = (_NO_NUMBER[self.estimate.status], *self.estimate.reasons)
            if self._estimated_ns is None or not 0 <= now_ns - self._estimated_ns <= GRACE_NS:
                return AxisCondition.UNAVAILABLE, held
        condition = self._tracker.condition
        if condition is None:
            first = "confirming: the first numbers must last for a moment"
            return AxisCondition.UNAVAILABLE, held or (first,)
        return condition, (*self._tracker.reasons, *held)
