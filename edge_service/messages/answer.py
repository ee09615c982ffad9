"""Answers about one axis at one moment: as HTTP gives them, and as outputs show them."""

from dataclasses import dataclass

from pydantic import Field

from .codec import Header
from .estimate import EstimateStatus, ImmEstimate, PreloadEstimate
from .event import AxisCondition
from .health import Advice, Alarm, AxisHealth, Headline, Limits
from .interval import Frozen, Interval, TimeNs
from .trend import Crossing


class PreloadAnswer(PreloadEstimate):
    """The estimate as it may be read now: numbers are null, never stale.

    Attributes:
        condition, reasons: of the axis, and why.
        measured_time_ns: UNIX time of the newest sample behind it, ns; `measured_at` in JSON.
    """

    axis: str
    condition: AxisCondition
    of_fresh: Interval | None  # preload in percent of the fresh screw's
    measured_time_ns: TimeNs | None = Field(alias="measured_at")
    age_s: float | None  # time since then, s


class AxisRow(Frozen):
    """One axis in a list of many; numbers are null where nothing may be read."""

    axis: str
    condition: AxisCondition
    headline: Headline | None = None
    advice: tuple[Advice, ...] = ()
    status: EstimateStatus
    method: str | None = None
    of_fresh: Interval | None = None
    measured_time_ns: TimeNs | None = Field(None, alias="measured_at")
    age_s: float | None = None
    next_limit: Crossing | None = None
    rate_fresh_percent_per_h: Interval | None = None
    alarms: tuple[Alarm, ...] = ()
    limits: Limits | None = None

    @property
    def level(self) -> AxisCondition:
        """Level of the headline: the worst of the condition and of the alarms."""
        return self.condition if self.headline is None else self.headline.level

    @property
    def urgency(self) -> tuple[int, float, float]:
        """Key to sort by, the worst first: level, date of the next limit, preload unless NORMAL."""
        limit, never = self.next_limit, float("inf")
        date = None if limit is None else limit.likely_ns or limit.earliest_ns
        share = None if self.level is AxisCondition.NORMAL else self.of_fresh
        return -self.level.urgency, date or never, never if share is None else share.value


class AxesAnswer(Frozen):
    """All axes of one machine, the worst first."""

    site: str
    machine: str
    axes: tuple[AxisRow, ...]


def axis_row(health: AxisHealth, now_ns: int) -> AxisRow:
    names = AxisRow.model_fields.keys() & AxisHealth.model_fields.keys()
    measured_ns, trend = health.measured_time_ns, health.trend
    return AxisRow(
        **{name: getattr(health, name) for name in names},
        age_s=None if measured_ns is None else max(now_ns - measured_ns, 0) / 1e9,
        rate_fresh_percent_per_h=None if trend is None else trend.rate_fresh_percent_per_h,
    )


@dataclass(frozen=True, slots=True)
class AxisAnswer:
    """Answer about one axis: all that may be read now, and nothing else."""

    axis: str
    estimate: PreloadEstimate  # numbers are None unless its status is `estimated` and it is fresh
    measured_ns: int | None  # UNIX time of the newest sample behind it, ns; None before the first
    health: AxisHealth  # UNAVAILABLE as soon as it rests on something stale
    is_heard: bool  # estimates and conditions come in
    header: Header | None = None  # of the estimate's message; None before the first
    opinion: ImmEstimate | None = None  # the second one, numbers as in the estimate

    @property
    def of_fresh(self) -> Interval | None:
        """Preload in percent of the fresh screw's; None where there is no number."""
        limits = self.health.limits
        return of_fresh(self.estimate, None if limits is None else limits.fresh_percent)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons of the condition and of the estimate, `code: sentence`; a code stands once."""
        present = self.estimate.reasons
        codes = {reason.partition(":")[0] for reason in present}
        held = [each for each in self.health.reasons if each.partition(":")[0] not in codes]
        return tuple(dict.fromkeys((*held, *present)))

    @property
    def advice(self) -> Advice | None:
        """The most urgent task; None if there is nothing to do."""
        return next(iter(self.health.advice), None)

    @property
    def due_ns(self) -> int | None:
        """UNIX time by which the most urgent task is likely due, ns; past if it is due now."""
        first = self.advice
        if first is not None and first.now:
            return self.health.since_time_ns
        due = None if first is None else first.due
        return None if due is None else due.likely_ns or due.earliest_ns

    def preload(self, age_s: float | None = None) -> PreloadAnswer:
        """Message on the preload, of that age."""
        estimate, names = self.estimate, PreloadEstimate.model_fields
        return PreloadAnswer(
            **{name: getattr(estimate, name) for name in names} | {"reasons": self.reasons},
            axis=self.axis,
            condition=self.health.condition,
            of_fresh=self.of_fresh,
            measured_time_ns=self.measured_ns,
            age_s=age_s,
        )


def of_fresh(estimate: PreloadEstimate, fresh_percent: float | None) -> Interval | None:
    """Preload of an estimate in percent of the fresh screw's; None where there is no number."""
    percent, low, high = estimate.preload_percent, estimate.low, estimate.high
    if estimate.status is not EstimateStatus.ESTIMATED or not fresh_percent:
        return None
    if percent is None or low is None or high is None:
        return None
    return Interval(value=percent, low=low, high=high).times(100.0 / fresh_percent)
