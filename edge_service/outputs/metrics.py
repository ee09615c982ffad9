"""Prometheus: the families of all axes and of the service, rendered at the moment of the scrape."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from .. import __version__
from ..messages.answer import AxisAnswer
from ..messages.estimate import EstimateStatus
from ..messages.event import AxisCondition
from ..messages.health import AlarmKind, ComponentHealth, ComponentStatus
from ..messages.interval import Interval
from .base import Message, Output, OutputConfig

_BOUNDS = ("value", "low", "high")
_PERCENT = 0.01
_GAUGES = {
    "preload_fresh_ratio": ("Preload as a share of the fresh screw's", "axis", "bound"),
    "preload_rating_ratio": ("Preload as a share of the load rating", "axis", "bound"),
    "preload_newtons": ("Preload", "axis"),
    "drag_torque_newton_meters": ("Coulomb drag torque at the motor", "axis", "bound"),
    "stiffness_newtons_per_meter": ("Stiffness in series", "axis", "bound"),
    "estimate_status": ("1 for the present status", "axis", "status", "method"),
    "mode_probability": ("Probability of each preload level", "axis", "mode"),
    "measured_timestamp_seconds": ("Time of the newest sample behind the estimate", "axis"),
    "normalized_innovation_squared": ("Averages 1 if the model fits", "axis"),
    "condition": ("1 for the present condition", "axis", "condition"),
    "alarm": ("1 while an alarm is active, unacknowledged, shelved", "axis", "alarm", "state"),
    "preload_fresh_ratio_per_second": ("Change of the preload", "axis", "bound"),
    "limit_timestamp_seconds": ("When a limit will be reached", "axis", "limit", "bound"),
    "temperature_celsius": ("Temperature of nut or housing", "axis"),
    "component_status": ("1 for the present status", "component", "axis", "status"),
    "ready": ("1 if every axis has fresh input",),
    "build_info": ("Always 1", "version", "configuration", "site", "machine"),
    "outbox_messages": ("Events that wait, and dead letters", "output", "state"),
    "outbox_oldest_timestamp_seconds": ("Time of the oldest event that waits", "output"),
}
"""Family without its prefix -> help and labels."""
_COUNTERS = {
    "distance_meters": ("Way of the table since the part came into use", "axis"),
    "moving_seconds": ("Time in motion since the part came into use", "axis"),
    "reversals": ("Changes of direction since the part came into use", "axis"),
    "data_faults": ("Faulty intervals", "axis", "kind"),
    "payloads_dropped": ("Payloads that were not used", "topic", "reason"),
}


@dataclass(frozen=True, slots=True)
class Scraped:
    """Facts of one moment.

    Attributes:
        temperature_c: by axis, where it is measured.
        dropped: payloads that were not used, by topic and reason.
        outboxes: by output: events that wait, dead letters, UNIX time of the oldest, ns.
    """

    site: str
    machine: str
    configuration: str
    ready: bool
    answers: tuple[AxisAnswer, ...] = ()
    components: tuple[ComponentHealth, ...] = ()
    temperature_c: Mapping[str, float] | None = None
    dropped: Mapping[tuple[str, str], int] | None = None
    outboxes: Mapping[str, tuple[int, int, int | None]] | None = None


class MetricsOutput(Output):
    """Text for `/metrics` of the page, which is always served: nothing is opened or taken."""

    config_model = OutputConfig
    content_type = CONTENT_TYPE_LATEST
    takes_answers = False

    def text(self, scraped: Scraped) -> bytes:
        """The text format of Prometheus; a number that does not exist has no sample."""
        registry = CollectorRegistry()
        registry.register(_Families(scraped))
        return bytes(generate_latest(registry))

    async def open(self) -> None:
        """Nothing."""

    async def take(self, message: Message) -> None:
        """Nothing."""

    async def close(self) -> None:
        """Nothing."""


class _Families(Collector):
    """All families of one moment."""

    def __init__(self, scraped: Scraped) -> None:
        self._scraped = scraped
        self._families: dict[str, GaugeMetricFamily | CounterMetricFamily] = {}
        for name, (text, *labels) in _GAUGES.items():
            self._families[name] = GaugeMetricFamily(f"edge_service_{name}", text, labels=labels)
        for name, (text, *labels) in _COUNTERS.items():
            self._families[name] = CounterMetricFamily(f"edge_service_{name}", text, labels=labels)

    def collect(self) -> Iterable[Metric]:
        """The families, which are filled now."""
        for answer in self._scraped.answers:
            self._estimate(answer)
            self._health(answer)
        self._service()
        return [each for each in self._families.values() if each.samples]

    def _add(self, name: str, value: float | None, *labels: str) -> None:
        if value is not None:
            self._families[name].add_metric(labels, float(value))

    def _interval(self, name: str, axis: str, interval: Interval | None, scale: float) -> None:
        for bound in _BOUNDS if interval is not None else ():
            self._add(name, scale * getattr(interval, bound), axis, bound)

    def _estimate(self, answer: AxisAnswer) -> None:
        axis, estimate = answer.axis, answer.estimate
        self._interval("preload_fresh_ratio", axis, answer.of_fresh, _PERCENT)
        percents = (estimate.preload_percent, estimate.low, estimate.high)
        for bound, percent in zip(_BOUNDS, percents, strict=True):
            ratio = None if percent is None else _PERCENT * percent
            self._add("preload_rating_ratio", ratio, axis, bound)
        self._add("preload_newtons", estimate.preload_n, axis)
        self._interval("drag_torque_newton_meters", axis, estimate.drag_torque_nm, 1.0)
        self._interval("stiffness_newtons_per_meter", axis, estimate.stiffness_n_per_m, 1.0)
        for status in EstimateStatus:
            value = float(status is estimate.status)
            self._add("estimate_status", value, axis, status.value, answer.estimate.method or "")
        for mode, probability in estimate.mode_probability.items():
            self._add("mode_probability", probability, axis, mode)
        measured_ns = answer.measured_ns
        measured_s = None if measured_ns is None else measured_ns / 1e9
        self._add("measured_timestamp_seconds", measured_s, axis)
        self._add("normalized_innovation_squared", estimate.nis, axis)

    def _health(self, answer: AxisAnswer) -> None:
        axis, health = answer.axis, answer.health
        for condition in AxisCondition:
            value = float(condition is health.condition)
            self._add("condition", value, axis, condition.value)
        shown = {alarm.kind: alarm for alarm in health.alarms}
        for kind in AlarmKind:
            alarm = shown.get(kind)
            states = {
                "active": alarm is not None and alarm.active,
                "unacknowledged": alarm is not None and alarm.acknowledged_by is None,
                "shelved": alarm is not None and alarm.shelved_until_ns is not None,
            }
            for state, holds in states.items():
                self._add("alarm", float(holds), axis, kind.value, state)
        for fault, count in health.data_faults.items():
            self._add("data_faults", count, axis, fault)
        if health.trend is not None:
            rate = health.trend.rate_fresh_percent_per_h
            self._interval("preload_fresh_ratio_per_second", axis, rate, _PERCENT / 3600.0)
            for crossing in health.trend.crossings:
                for bound in ("earliest", "likely", "latest"):
                    time_ns = getattr(crossing, f"{bound}_ns")
                    time_s = None if time_ns is None else time_ns / 1e9
                    self._add("limit_timestamp_seconds", time_s, axis, crossing.limit, bound)
        if health.use is not None:
            self._add("distance_meters", health.use.distance_m, axis)
            self._add("moving_seconds", health.use.moving_s, axis)
            self._add("reversals", health.use.reversals, axis)

    def _service(self) -> None:
        scraped = self._scraped
        for axis, temperature_c in (scraped.temperature_c or {}).items():
            self._add("temperature_celsius", temperature_c, axis)
        for report in scraped.components:
            for status in ComponentStatus:
                value = float(status is report.status)
                labels = report.component, report.axis or "", status.value
                self._add("component_status", value, *labels)
        for topic_and_reason, count in (scraped.dropped or {}).items():
            self._add("payloads_dropped", count, *topic_and_reason)
        self._add("ready", float(scraped.ready))
        place = scraped.site, scraped.machine
        self._add("build_info", 1.0, __version__, scraped.configuration, *place)
        for output, (waiting, dead, oldest_ns) in (scraped.outboxes or {}).items():
            self._add("outbox_messages", waiting, output, "waiting")
            self._add("outbox_messages", dead, output, "dead")
            oldest_s = None if oldest_ns is None else oldest_ns / 1e9
            self._add("outbox_oldest_timestamp_seconds", oldest_s, output)


def family_names() -> tuple[str, ...]:
    """Names of all families, as they stand in the text."""
    counters = (f"edge_service_{name}_total" for name in _COUNTERS)
    return (*(f"edge_service_{name}" for name in _GAUGES), *counters)
