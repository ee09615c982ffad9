"""One answer about an axis in which no statement contradicts another."""

from ...messages.answer import of_fresh as share_of_fresh
from ...messages.estimate import Interval, PreloadEstimate
from ...messages.health import AxisCondition, AxisHealth
from ...messages.trend import Trend
from .headline import headline
from .tasks import advice

_PASSED = {
    AxisCondition.WARNING: frozenset({"warning"}),
    AxisCondition.FAULT: frozenset({"warning", "fault"}),
}


def consistent(health: AxisHealth, estimate: PreloadEstimate | None) -> AxisHealth:
    """Return the health with number and trend that fit its condition, headline and advice."""
    trend, number = _ahead(health.trend, health.condition), None
    if estimate is not None and health.condition is not AxisCondition.UNAVAILABLE:
        fresh = None if health.limits is None else health.limits.fresh_percent
        number = share_of_fresh(estimate, fresh)
    dated = (each for each in (trend.crossings if trend else ()) if each.earliest_ns is not None)
    told = health.model_copy(
        update={"trend": trend, "of_fresh": number, "next_limit": next(dated, None)}
    )
    return told.model_copy(update={"headline": headline(told), "advice": advice(told, estimate)})


def of_fresh(trend: Trend, fresh_percent: float | None) -> Trend:
    """Return the trend with its rate in percent of the fresh screw's preload as well."""
    rate = trend.rate_percent_per_h
    if rate is None or not fresh_percent:
        return trend
    share = 100.0 / fresh_percent
    of_fresh = Interval(value=rate.value * share, low=rate.low * share, high=rate.high * share)
    return trend.model_copy(update={"rate_fresh_percent_per_h": of_fresh})


def _ahead(trend: Trend | None, condition: AxisCondition) -> Trend | None:
    """Return the trend without dates for limits that the axis has passed already."""
    passed = _PASSED.get(condition, frozenset())
    if trend is None or not any(each.limit in passed for each in trend.crossings):
        return trend
    crossings = tuple(each for each in trend.crossings if each.limit not in passed)
    return trend.model_copy(update={"crossings": crossings})
