"""Alarms, trend and use in the words of Prometheus."""

from collections.abc import Iterable

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from ..health.service_state import ServiceState
from ..messages.alarm import AlarmKind
from ..messages.trend import Trend, Use

_PREFIX = "edge_service"


class TrendCollector(Collector):
    """Alarms, trend and use of every axis, as of one moment."""

    def __init__(self, state: ServiceState, now_ns: int) -> None:
        self._state = state
        self._now_ns = now_ns

    def collect(self) -> Iterable[Metric]:
        """All families."""
        active = _gauge("alarm_active", "1 while its cause holds", "alarm")
        waiting = _gauge("alarm_unacknowledged", "1 until somebody acknowledged it", "alarm")
        rate = _gauge("preload_rate_percent_per_hour", "Change of the preload", "bound")
        reached = _gauge(
            "limit_reached_timestamp_seconds", "When a limit will be reached", "limit", "bound"
        )
        use = [
            _counter("distance_metres", "Way of the table since the part is in use"),
            _counter("moving_seconds", "Time in motion since the part is in use"),
            _counter("reversals", "Changes of direction since the part is in use"),
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


def _gauge(name: str, text: str, *labels: str) -> GaugeMetricFamily:
    return GaugeMetricFamily(f"{_PREFIX}_{name}", text, labels=("axis", *labels))


def _counter(name: str, text: str) -> CounterMetricFamily:
    return CounterMetricFamily(f"{_PREFIX}_{name}", text, labels=("axis",))
