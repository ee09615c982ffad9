"""Words of the alarms: without a tense, so that they hold while active and after."""

from ...messages.health import AxisCondition, AxisHealth
from ...messages.sentence import Code, Told, told
from ...messages.trend import Trend, TrendStatus

H_PER_RATE = 1000.0
_SPANS = ((H_PER_RATE, "1000_h"), (24.0, "day"), (1.0, "hour"), (1.0 / 60.0, "minute"))
SILENT = Told("")


def limit_words(health: AxisHealth, value_percent: float | None, fresh: float | None) -> Told:
    """Preload against its limits, in percent of the fresh screw's; empty before the first value.

    Args:
        health: The condition with its reasons.
        value_percent: The last value known, percent of the load rating.
        fresh: The fresh screw's preload, percent of the load rating.
    """
    if health.condition in (AxisCondition.WARNING, AxisCondition.FAULT) and health.reasons:
        return Told(health.reasons[0].partition(": ")[2], health.below)
    if value_percent is None or not fresh:
        return SILENT
    known = health.condition is not AxisCondition.UNAVAILABLE
    percent = 100.0 * value_percent / fresh
    return told(Code.PRELOAD_BACK if known else Code.PRELOAD_LAST_KNOWN, percent=percent)


def rate_words(trend: Trend | None, loss: float, limit: float) -> Told:
    """Loss of preload against its limit, percent of the fresh screw's per 1000 h."""
    if trend is None or trend.status is not TrendStatus.FALLING:
        return told(Code.PRELOAD_FELL_LATELY)
    hours, per = _readable_span(loss)
    words = {"per": f"per {per.replace('_', ' ')}"}
    return told(Code.PRELOAD_FALLING, words, loss=loss * hours / H_PER_RATE, per=per, limit=limit)


def drop_words(before: float, after: float) -> Told:
    """Sudden fall of the preload, both percent of the fresh screw's."""
    return told(Code.PRELOAD_FELL_SUDDENLY, points=before - after, before=before, after=after)


def _readable_span(percent_per_1000_h: float) -> tuple[float, str]:
    """Longest time in which less than everything is lost, h, with its code."""
    short = [span for span in _SPANS if percent_per_1000_h * span[0] < 100.0 * H_PER_RATE]
    return (short or _SPANS[-1:])[0]
