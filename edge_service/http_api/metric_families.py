"""Families of metrics in the words of Prometheus, and their collectors."""

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily
from prometheus_client.registry import Collector

from ..health.service_state import ServiceState

PREFIX = "edge_service"


class StateCollector(Collector):
    """Base of the collectors: the service state as of one moment."""

    def __init__(self, state: ServiceState, now_ns: int) -> None:
        self._state = state
        self._now_ns = now_ns


def gauges(name: str, text: str, *labels: str) -> GaugeMetricFamily:
    """Family of gauges, by axis unless labels are given."""
    return GaugeMetricFamily(f"{PREFIX}_{name}", text, labels=labels or ("axis",))


def counters(name: str, text: str, *labels: str) -> CounterMetricFamily:
    """Family of counters, by axis unless labels are given."""
    return CounterMetricFamily(f"{PREFIX}_{name}", text, labels=labels or ("axis",))
