"""Prometheus: the families of all axes and of the service, rendered at the moment of the scrape."""

from collections.abc import Iterable, Mapping

from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from .. import __version__
from ..messages.answer import AxisAnswer
from ..messages.estimate import EstimateStatus
from ..messages.event import AxisCondition
from ..messages.health import AlarmKind, ComponentHealth, ComponentStatus
from .base import Message, Output, OutputConfig, value_at

_GAUGES = {
    "preload_fresh_ratio": ("Preload as a share of the fresh screw's", "axis", "bound"),
    "preload_rating_ratio": ("Preload as a share of the load rating", "axis", "bound"),
    "imm_preload_rating_ratio": ("The same, second opinion", "axis", "bound"),
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
"""Help and labels."""
_COUNTERS = {
    "distance_meters": ("Way of the table since the part came into use", "axis"),
    "moving_seconds": ("Time in motion since the part came into use", "axis"),
    "reversals": ("Changes of direction since the part came into use", "axis"),
    "data_faults": ("Faulty intervals", "axis", "kind"),
    "payloads_dropped": ("Payloads that were not used", "topic", "reason"),
}
_INTERVALS = {
    "preload_fresh_ratio": (0.01, "of_fresh"),
    "drag_torque_newton_meters": (1.0, "estimate.drag_torque_nm"),
    "stiffness_newtons_per_meter": (1.0, "estimate.stiffness_n_per_m"),
    "preload_fresh_ratio_per_second": (0.01 / 3600.0, "health.trend.rate_fresh_percent_per_h"),
}
"""Family -> scale and path in an answer; the bounds are labels."""
_NUMBERS = {
    "preload_newtons": (1.0, "estimate.preload_n"),
    "measured_timestamp_seconds": (1e-9, "measured_ns"),
    "normalized_innovation_squared": (1.0, "estimate.nis"),
    "distance_meters": (1.0, "health.use.distance_m"),
    "moving_seconds": (1.0, "health.use.moving_s"),
    "reversals": (1.0, "health.use.reversals"),
}


class MetricsOutput(Output):
    """Text for `/metrics` of the page, which is always served: nothing is opened or taken."""

    config_model = OutputConfig
    content_type = CONTENT_TYPE_LATEST
    takes_answers = False

    def text(
        self,
        configuration: str,
        ready: bool,
        answers: Iterable[AxisAnswer] = (),
        components: Iterable[ComponentHealth] = (),
        temperature_c: Mapping[str, float] = {},
        dropped: Mapping[tuple[str, str], int] = {},
        outboxes: Mapping[str, tuple[int, int, int | None]] = {},
    ) -> bytes:
        """The text format of Prometheus; a number that does not exist has no sample.

        Args:
            dropped: payloads that were not used, by topic and reason.
            outboxes: by output: events that wait, dead letters, UNIX time of the oldest, ns.
        """
        add = (families := _Families()).add
        for answer in answers:
            families.add_axis(answer)
        for axis, value in temperature_c.items():
            add("temperature_celsius", value, axis)
        for report in components:
            for status in ComponentStatus:
                labels = report.component, report.axis or "", status.value
                add("component_status", status is report.status, *labels)
        for topic_and_reason, count in dropped.items():
            add("payloads_dropped", count, *topic_and_reason)
        add("ready", ready)
        add("build_info", 1.0, __version__, configuration, self.context.site, self.context.machine)
        for output, (waiting, dead, oldest_ns) in outboxes.items():
            add("outbox_messages", waiting, output, "waiting")
            add("outbox_messages", dead, output, "dead")
            add("outbox_oldest_timestamp_seconds", oldest_ns, output, scale=1e-9)
        registry = CollectorRegistry()
        registry.register(families)
        return bytes(generate_latest(registry))

    async def take(self, message: Message | None = None) -> None:
        """Nothing."""

    open = close = take


class _Families(Collector):
    def __init__(self) -> None:
        self._families: dict[str, GaugeMetricFamily | CounterMetricFamily] = {}
        for name, (text, *labels) in _GAUGES.items():
            self._families[name] = GaugeMetricFamily(f"edge_service_{name}", text, labels=labels)
        for name, (text, *labels) in _COUNTERS.items():
            self._families[name] = CounterMetricFamily(f"edge_service_{name}", text, labels=labels)

    def collect(self) -> Iterable[Metric]:
        return [each for each in self._families.values() if each.samples]

    def add(self, name: str, value: float | None, *labels: str, scale: float = 1.0) -> None:
        if value is not None:
            self._families[name].add_metric(labels, scale * value)

    def add_axis(self, answer: AxisAnswer) -> None:
        axis, estimate, health = answer.axis, answer.estimate, answer.health
        for name, (scale, path) in _NUMBERS.items():
            self.add(name, value_at(answer, path), axis, scale=scale)
        percents = {"value": estimate.preload_percent, "low": estimate.low, "high": estimate.high}
        for bound, percent in percents.items():
            self.add("preload_rating_ratio", percent, axis, bound, scale=0.01)
            second = value_at(answer, f"opinion.{bound.replace('value', 'preload_percent')}")
            self.add("imm_preload_rating_ratio", second, axis, bound, scale=0.01)
            for name, (scale, path) in _INTERVALS.items():
                self.add(name, value_at(answer, f"{path}.{bound}"), axis, bound, scale=scale)
        method = estimate.method or ""
        for each in EstimateStatus:
            self.add("estimate_status", each is estimate.status, axis, each.value, method)
        for mode, probability in estimate.mode_probability.items():
            self.add("mode_probability", probability, axis, mode)
        for condition in AxisCondition:
            self.add("condition", condition is health.condition, axis, condition.value)
        shown = {alarm.kind: alarm for alarm in health.alarms}
        for kind in AlarmKind:
            alarm = shown.get(kind)
            states = {
                "active": alarm is not None and alarm.active,
                "unacknowledged": alarm is not None and alarm.acknowledged_by is None,
                "shelved": alarm is not None and alarm.shelved_until_ns is not None,
            }
            for state, holds in states.items():
                self.add("alarm", holds, axis, kind.value, state)
        for fault, count in health.data_faults.items():
            self.add("data_faults", count, axis, fault)
        for crossing in () if health.trend is None else health.trend.crossings:
            for bound in ("earliest", "likely", "latest"):
                labels, time_ns = (axis, crossing.limit, bound), getattr(crossing, f"{bound}_ns")
                self.add("limit_timestamp_seconds", time_ns, *labels, scale=1e-9)


def family_names() -> tuple[str, ...]:
    """Names of all families, as they stand in the text."""
    counters = (f"edge_service_{name}_total" for name in _COUNTERS)
    return (*(f"edge_service_{name}" for name in _GAUGES), *counters)
