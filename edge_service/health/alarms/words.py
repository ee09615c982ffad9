"""Words of the alarms: without a tense, so that they hold while active and after."""

from ...messages.health import AxisCondition, AxisHealth
from ...messages.trend import Trend, TrendStatus

H_PER_RATE = 1000.0
_SPANS = ((H_PER_RATE, "1000 h"), (24.0, "day"), (1.0, "hour"), (1.0 / 60.0, "minute"))


def limit_words(health: AxisHealth, value_percent: float | None, fresh: float | None) -> str:
    """Preload against its limits, in percent of the fresh screw's; empty before the first value.

    Args:
        health: The condition with its reasons.
        value_percent: The last value known, percent of the load rating.
        fresh: The fresh screw's preload, percent of the load rating.
    """
    if health.condition in (AxisCondition.WARNING, AxisCondition.FAULT) and health.reasons:
        return health.reasons[0].partition(": ")[2]
    if value_percent is None or not fresh:
        return ""
    known = health.condition is not AxisCondition.UNAVAILABLE
    prefix = "preload back at" if known else "preload when last known:"
    return f"{prefix} {100.0 * value_percent / fresh:.0f} % of the fresh screw's"


def rate_words(trend: Trend | None, loss: float, limit: float) -> str:
    """Loss of preload against its limit, percent of the fresh screw's per 1000 h."""
    if trend is None or trend.status is not TrendStatus.FALLING:
        return "fast loss of preload until lately; no clear trend at present"
    return f"preload falling by {_readable(loss)}; limit {limit:g} % per 1000 h"


def drop_words(before: float, after: float) -> str:
    """Sudden fall of the preload, both percent of the fresh screw's."""
    return (
        f"preload fell suddenly by {before - after:.0f} points, from {before:.0f} to "
        f"{after:.0f} % of the fresh screw's"
    )


def _readable(percent_per_1000_h: float) -> str:
    """A rate over the longest time in which less than everything is lost."""
    short = [span for span in _SPANS if percent_per_1000_h * span[0] < 100.0 * H_PER_RATE]
    hours, name = (short or _SPANS[-1:])[0]
    return f"{percent_per_1000_h * hours / H_PER_RATE:.3g} % of the fresh screw's per {name}"
