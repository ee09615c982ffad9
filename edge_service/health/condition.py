"""Condition of one axis by its limits, its data faults, and events of their changes."""

import math

from ..config_tables import AlarmsConfig
from ..messages.answer import of_fresh
from ..messages.codec import Header
from ..messages.estimate import EstimateStatus, PreloadEstimate
from ..messages.event import AxisCondition, Code, Event, told
from ..messages.features import FeatureBlock
from ..messages.health import AxisHealth, ComponentHealth, Limits
from ..messages.topics import FEAT, HEALTH, PRELOAD
from .axis_events import noted
from .components import ComponentWatch
from .inputs import NS_PER_S, DataFaults, Heard
from .statements import because

HYSTERESIS_SHARE = 0.05
"""Rise above a limit that ends it, share of the fresh preload."""
GRACE_NS = 10 * NS_PER_S
"""So long a condition is kept while estimates come, but without a number."""
_DELAY_NS = round(0.3 * NS_PER_S)
"""So long the whole interval must lie beyond a limit."""
_DOUBT_DELAY_NS = 10 * NS_PER_S
"""So long the value must lie beyond a limit that its interval still straddles."""
_NO_NUMBER = {
    EstimateStatus.UNESTIMATED: "no_number: the data cannot tell the preload yet",
    EstimateStatus.INSUFFICIENT_EXCITATION: "no_number: recent motion cannot tell the preload",
    EstimateStatus.INVALID: "no_number: model and data disagree, or the data are faulty",
}
FIRST = "confirming: the first numbers must last for a moment"
_Verdict = tuple[AxisCondition, tuple[str, ...]]


def limits_of(settings: AlarmsConfig, fresh_percent: float | None) -> Limits | None:
    """Limits of an axis, percent of the load rating; None if the fresh preload is not known."""
    if fresh_percent is None:
        return None
    point = fresh_percent / 100.0
    return Limits(
        fresh_percent=fresh_percent,
        warning_percent=settings.warning_percent * point,
        fault_percent=settings.fault_percent * point,
    )


class LimitLatch:
    """Latch that tells whether preload lies below one limit.

    It switches when the whole interval has been beyond the limit for 0.3 s, or the value for
    10 s. So a clear drop shows within a few estimates, while a doubtful one (the limit
    inside the interval) needs time, but cannot hide behind a wide interval for ever. To switch
    back the value must rise above the limit by the hysteresis. Contrary evidence restarts the
    delay; missing evidence does not, or a real drop could hide behind stop-and-go motion.
    """

    def __init__(self, limit_percent: float, release_percent: float) -> None:
        self.below = False
        self.limit_percent, self.release_percent = limit_percent, release_percent
        self._doubtful_since: int | None = None
        self._certain_since: int | None = None

    def restart(self) -> None:
        """Forget evidence for a change; the state stays."""
        self._doubtful_since = self._certain_since = None

    def update(self, value: float, low: float, high: float, begun_ns: int, time_ns: int) -> None:
        """Take one estimate in, percent, that rests on samples from one time to another."""
        beyond, certain = value < self.limit_percent, high < self.limit_percent
        if self.below:
            beyond, certain = value >= self.release_percent, low >= self.limit_percent
        self._doubtful_since = _since(self._doubtful_since, beyond, begun_ns)
        self._certain_since = _since(self._certain_since, beyond and certain, begun_ns)
        if _lasted(self._certain_since, time_ns, _DELAY_NS) or _lasted(
            self._doubtful_since, time_ns, _DOUBT_DELAY_NS
        ):
            self.below = not self.below
            self.restart()


class LimitTracker:
    """Condition of an axis from its estimates.

    `condition` is None until the estimator has seen motion for 0.3 s: at a start, or after an
    interruption, a screw without preload is never called NORMAL first. What it saw while it
    learned counts, so that its first number has a condition.
    """

    def __init__(self, limits: Limits) -> None:
        margin = HYSTERESIS_SHARE * limits.fresh_percent
        self._fresh_percent = limits.fresh_percent
        self._warning = LimitLatch(limits.warning_percent, limits.warning_percent + margin)
        self._fault = LimitLatch(limits.fault_percent, limits.fault_percent + margin)
        self._first_ns: int | None = None
        self._last_ns, self._high = 0, math.inf
        self._confirmed: bool | None = None  # before the first number

    def restart(self) -> None:
        """After an interruption: keep the states of the limits, ask for new evidence."""
        self._first_ns = self._confirmed = None
        self._warning.restart()
        self._fault.restart()

    def update(self, estimate: PreloadEstimate, time_ns: int) -> None:
        """Take one estimate in, at the time of its newest sample; certain by its bounds alone."""
        status, value = estimate.status, estimate.preload_percent
        learns = status is EstimateStatus.UNESTIMATED and estimate.data_used_s > 0.0
        if not learns and (value is None or status is not EstimateStatus.ESTIMATED):
            return
        if not 0 <= time_ns - self._last_ns <= GRACE_NS:
            self.restart()
        first_ns = time_ns if self._first_ns is None else self._first_ns
        self._first_ns, self._last_ns = first_ns, time_ns
        if learns or value is None:
            return
        low = -math.inf if estimate.low is None else estimate.low
        self._high = math.inf if estimate.high is None else estimate.high
        seen_ns = min(time_ns - first_ns, _DELAY_NS) if self._confirmed is None else 0
        for latch in (self._warning, self._fault):
            latch.update(value, low, self._high, time_ns - seen_ns, time_ns)
        self._confirmed = self._confirmed or time_ns - first_ns >= _DELAY_NS

    @property
    def condition(self) -> AxisCondition | None:
        """Condition that the estimates support; None if they have not lasted long enough."""
        if not self._confirmed:
            return None
        if self._fault.below:
            return AxisCondition.FAULT
        return AxisCondition.WARNING if self._warning.below else AxisCondition.NORMAL

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons why the condition is not NORMAL; their codes say whether that is in doubt."""
        if self.condition not in (AxisCondition.FAULT, AxisCondition.WARNING):
            return ()
        is_fault = self.condition is AxisCondition.FAULT
        latch, name = (self._fault, "fault") if is_fault else (self._warning, "warning")
        limit = 100.0 * latch.limit_percent / self._fresh_percent
        if self._high < latch.limit_percent:
            return (f"below_{name}: the preload is below {limit:.3g} % of fresh",)
        return (f"may_be_below_{name}: the preload may be below {limit:.3g} % of fresh",)


def _since(since: int | None, holds: bool, time_ns: int) -> int | None:
    return (time_ns if since is None else since) if holds else None


def _lasted(since: int | None, time_ns: int, delay_ns: int) -> bool:
    return since is not None and time_ns - since >= delay_ns


class ConditionMonitor:
    """Monitor of one axis from its inputs; every call returns the events that it caused.

    The condition is UNAVAILABLE without input, with stale input, while no number came for
    10 s, where no limit is known, and until the first numbers are confirmed.

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

    def on_preload(self, header: Header, latest: PreloadEstimate, now_ns: int) -> tuple[Event, ...]:
        before = self.estimate
        self._preload.hear(header, latest, now_ns)
        if latest.status is EstimateStatus.ESTIMATED:
            self._estimated_ns = now_ns
        if self._tracker is not None:
            self._tracker.update(latest, header.source_time_ns)
        changed: tuple[Event, ...] = ()
        if before is None or before.status is not latest.status:
            status, words = latest.status, told(Code.ESTIMATED)
            if status is not EstimateStatus.ESTIMATED:
                words = because(Code.NOT_KNOWN, [*latest.reasons, _NO_NUMBER[status]][0])
            invalid = status is EstimateStatus.INVALID
            level = AxisCondition.WARNING if invalid else AxisCondition.NORMAL
            about = {"from": None if before is None else before.status, "to": status}, level
            changed = (noted(self.axis, "status_changed", words, now_ns, *about),)
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
        self._condition, self._since_ns = condition, now_ns
        if condition is AxisCondition.UNAVAILABLE and self._tracker is not None:
            self._tracker.restart()
        words = told(Code.CONDITION_CHANGED, condition=condition.value)
        if reasons:
            words = because(Code.CONDITION_CHANGED_FOR, reasons[0], condition=condition.value)
        is_known = self.estimate is not None and condition is not AxisCondition.UNAVAILABLE
        percent = self.estimate.preload_percent if is_known and self.estimate else None
        data = {"from": before, "to": condition, "preload_percent": percent}
        return (noted(self.axis, "condition_changed", words, now_ns, data, condition), *events)

    def health(self, now_ns: int) -> AxisHealth:
        """Condition of the axis as of now, with its number."""
        condition, reasons = self._verdict(now_ns)
        heard, limits = self._preload, self._limits
        estimate = None if heard.is_stale(now_ns) or FIRST in reasons else self.estimate
        number = None
        if estimate is not None and condition is not AxisCondition.UNAVAILABLE:
            number = of_fresh(estimate, None if limits is None else limits.fresh_percent)
        return AxisHealth(
            axis=self.axis,
            condition=condition,
            status=EstimateStatus.UNESTIMATED if estimate is None else estimate.status,
            method=None if estimate is None else estimate.method,
            of_fresh=number,
            measured_time_ns=heard.measured_ns(now_ns),
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
        if estimated and self.estimate.preload_percent is None:
            return AxisCondition.UNAVAILABLE, self.estimate.reasons
        if self._tracker is None:
            reason = "no_limit: the preload of the fresh screw is not known"
            return AxisCondition.UNAVAILABLE, (reason, *self.estimate.reasons)
        held: tuple[str, ...] = ()
        if not estimated:
            held = (_NO_NUMBER[self.estimate.status], *self.estimate.reasons)
            if self._estimated_ns is None or not 0 <= now_ns - self._estimated_ns <= GRACE_NS:
                return AxisCondition.UNAVAILABLE, held
        condition = self._tracker.condition
        if condition is None:
            return AxisCondition.UNAVAILABLE, held or (FIRST,)
        return condition, (*self._tracker.reasons, *held)
