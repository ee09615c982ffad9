"""Answer about one axis at one moment, as outputs show it."""

from collections.abc import Sequence
from dataclasses import dataclass

from .advice import Advice
from .estimate import EstimateStatus, Interval, PreloadEstimate
from .header import Header
from .health import AxisHealth


@dataclass(frozen=True, slots=True)
class AxisAnswer:
    """Answer about one axis: all that may be read now, and nothing else.

    Attributes:
        estimate: numbers are None unless its status is `estimated` and it is fresh.
        measured_ns: UNIX time of the newest sample behind it, ns; None before the first.
        health: UNAVAILABLE as soon as it rests on something stale.
        fresh_percent: preload of the fresh screw, percent of the load rating; None if not known.
        warning_of_fresh, fault_of_fresh: limits of the condition, percent of fresh.
        is_heard: whether estimates and conditions come in at all.
        method: estimator that the estimate is of.
        header: of the estimate's message; None before the first.
    """

    axis: str
    estimate: PreloadEstimate
    measured_ns: int | None
    health: AxisHealth
    fresh_percent: float | None
    warning_of_fresh: float
    fault_of_fresh: float
    is_heard: bool
    method: str = ""
    header: Header | None = None

    @property
    def of_fresh(self) -> Interval | None:
        """Preload in percent of the fresh screw's; None where there is no number."""
        return of_fresh(self.estimate, self.fresh_percent)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons of the condition and of the estimate, `code: sentence`; empty if all is well."""
        return reasons_together(self.health.reasons, self.estimate.reasons)

    @property
    def advice(self) -> Advice | None:
        """The most urgent task; None if there is nothing to do."""
        return next(iter(self.health.advice), None)

    @property
    def due_ns(self) -> int | None:
        """UNIX time by which the most urgent task is likely due, ns; past if it is due now."""
        first = self.advice
        if first is None:
            return None
        if first.now:
            return self.health.since_time_ns
        return None if first.due is None else first.due.likely_ns or first.due.earliest_ns

    @property
    def next_limit_ns(self) -> int | None:
        """Earliest UNIX time at which a limit is reached, ns; None if no date can be named."""
        crossings = () if self.health.trend is None else self.health.trend.crossings
        times_ns = [each.earliest_ns for each in crossings if each.earliest_ns is not None]
        return min(times_ns, default=None)


def reasons_together(earlier: Sequence[str], present: Sequence[str]) -> tuple[str, ...]:
    """Reasons of both, without the earlier ones whose code is among the present ones."""
    codes = {reason.partition(":")[0] for reason in present}
    held = [reason for reason in earlier if reason.partition(":")[0] not in codes]
    return tuple(dict.fromkeys((*held, *present)))


def of_fresh(estimate: PreloadEstimate, fresh_percent: float | None) -> Interval | None:
    """Preload of an estimate in percent of the fresh screw's; None where there is no number."""
    percent, low, high = estimate.preload_percent, estimate.low, estimate.high
    if estimate.status is not EstimateStatus.ESTIMATED or not fresh_percent:
        return None
    if percent is None or low is None or high is None:
        return None
    share = 100.0 / fresh_percent
    return Interval(value=percent * share, low=low * share, high=high * share)
