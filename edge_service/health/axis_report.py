"""Report on one axis to its plant, and words of it that a fleet of HTTP services says alike."""

from collections.abc import Sequence

from ..messages.answer import AxisAnswer
from ..messages.estimate import EstimateStatus, Interval
from ..messages.plant import AxisReport
from ..messages.trend import Crossing, Trend

_H_PER_RATE = 1000.0
MOST_LETTERS = 1000
"""Of a task or a reason; a sentence has 200."""


def axis_report(answer: AxisAnswer) -> AxisReport:
    """Report on an axis from its answer."""
    estimate, health = answer.estimate, answer.health
    doubted = any(alarm.kind == "model" and alarm.active for alarm in health.alarms)
    crossing = _next_crossing(health.trend)
    return AxisReport(
        axis=answer.axis,
        condition=health.condition,
        headline=health.headline,
        task=health.advice[0].text[:MOST_LETTERS] if health.advice else "",
        status=estimate.status,
        time_ns=answer.measured_ns,
        preload_percent=estimate.preload_percent,
        low=estimate.low,
        high=estimate.high,
        fresh_percent=answer.fresh_percent,
        fits=fits(estimate.status, doubted=doubted),
        limit=crossing and crossing.limit,
        limit_earliest_ns=crossing and crossing.earliest_ns,
        limit_likely_ns=crossing and crossing.likely_ns,
        limit_latest_ns=crossing and crossing.latest_ns,
        loss_per_1000_h=_loss(health.trend, answer.fresh_percent),
        reason=sentence(answer.reasons)[:MOST_LETTERS],
    )


def fits(status: str, *, doubted: bool) -> bool | None:
    """Tell whether the model fits; None if nobody can tell.

    Args:
        status: of the estimate, one of `EstimateStatus`.
        doubted: whether the alarm `model` is active.
    """
    if doubted or status == EstimateStatus.INVALID:
        return False
    return True if status == EstimateStatus.ESTIMATED else None


def loss_per_1000_h(rate: Interval, fresh_percent: float) -> Interval:
    """Loss in percent of the fresh screw's preload per 1000 h.

    Args:
        rate: change in percent of the load rating per hour.
        fresh_percent: preload of the fresh screw, percent of the load rating, not 0.
    """
    scale = -100.0 * _H_PER_RATE / fresh_percent
    return Interval(value=scale * rate.value, low=scale * rate.high, high=scale * rate.low)


def sentence(reasons: Sequence[str]) -> str:
    """Sentence of the first reason; empty if there is none.

    >>> sentence(["no_input: no preload estimate heard yet", "other: more"])
    'no preload estimate heard yet'
    """
    return reasons[0].partition(": ")[2] if reasons else ""


def _next_crossing(trend: Trend | None) -> Crossing | None:
    crossings = () if trend is None else trend.crossings
    return next((each for each in crossings if each.earliest_ns is not None), None)


def _loss(trend: Trend | None, fresh_percent: float | None) -> Interval | None:
    if trend is None or trend.rate_percent_per_h is None or not fresh_percent:
        return None
    return loss_per_1000_h(trend.rate_percent_per_h, fresh_percent)
