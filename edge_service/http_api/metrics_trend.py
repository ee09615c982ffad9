"""Alarms, trend and use in the words of Prometheus."""

from collections.abc import Iterable

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

from ..messages.alarm import AlarmKind
from ..messages.trend import Trend, Use
from .metric_families import StateCollector, counters, gauges


class TrendCollector(StateCollector):
    """Alarms, trend and use of every axis, as of one moment."""

    def collect(self) -> Iterable[Metric]:
        """All families."""
        active = gauges("alarm_active", "1 while its cause is present", "axis", "alarm")
        waiting = gauges(
            "alarm_unacknowledged", "1 until somebody acknowledges it", "axis", "alarm"
        )
        rate = gauges("preload_rate_percent_per_hour", "Change of the preload", "axis", "bound")
        reached = gauges(
            "limit_reached_timestamp_seconds",
            "When a limit will be reached",
            "axis",
            "limit",
            "bound",
        )
        use = [
            counters(
                "distance_metres", "Distance travelled by the table since the part came into use"
            ),
            counters("moving_seconds", "Time in motion since the part came into use"),
            counters("reversals", "Changes of direction since the part came into use"),
        ]
        for axis in self._state.axes:
            health = self._state.health(axis, self._now_ns)
            shown = {alarm.kind: alarm for alarm in health.alarms}
            for kind in AlarmKind:
                alarm = shown.get(kind)
                unseen = alarm is not None and alarm.acknowledged_by is None
                active.add_metric([axis, kind.value], float(alarm is not None and alarm.active))
                waiting.add_metric([axis, kind.value], float(unseen))
            if health.trend is not None:
                _add_trend(rate, reached, axis, health.trend)
            if health.use is not None:
                _add_use(use, axis, health.use)
        return active, waiting, rate, reached, *use


def _add_trend(
    rate: GaugeMetricFamily, reached: GaugeMetricFamily, axis: str, trend: Trend
) -> None:
    per_h = trend.rate_percent_per_h
    if per_h is not None:
        for bound in ("value", "low", "high"):
            rate.add_metric([axis, bound], getattr(per_h, bound))
    for crossing in trend.crossings:
        for bound in ("earliest", "likely", "latest"):
            time_ns = getattr(crossing, f"{bound}_ns")
            if time_ns is not None:
                reached.add_metric([axis, crossing.limit, bound], time_ns / 1e9)


def _add_use(families: list[CounterMetricFamily], axis: str, use: Use) -> None:
    values = (use.distance_m, use.moving_s, float(use.reversals))
    for family, value in zip(families, values, strict=True):
        family.add_metric([axis], value)
