"""`/metrics`: the service state in the words of Prometheus, read at the moment of the scrape."""

from collections.abc import Callable, Iterable
from operator import attrgetter

from fastapi import APIRouter
from fastapi.responses import Response
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

from .. import __version__
from ..messages.estimate import EstimateStatus, PreloadEstimate
from ..messages.health import AxisCondition, ComponentHealth, ComponentStatus
from .context import NowDep, StateDep
from .metric_families import PREFIX, StateCollector, counters, gauges
from .metrics_trend import TrendCollector

metrics_router = APIRouter(tags=["service"])

_DRAG, _STIFFNESS = "drag_torque_nm", "stiffness_n_per_m"

_Number = Callable[[PreloadEstimate], float | None]


def _bound(quantity: str, bound: str) -> _Number:
    def number(estimate: PreloadEstimate) -> float | None:
        interval = getattr(estimate, quantity)
        return None if interval is None else float(getattr(interval, bound))

    return number


_NUMBERS: tuple[tuple[str, str, _Number], ...] = (
    ("preload_percent", "Preload, percent of the load rating", attrgetter("preload_percent")),
    ("preload_low_percent", "Lower bound of the preload, percent", attrgetter("low")),
    ("preload_high_percent", "Upper bound of the preload, percent", attrgetter("high")),
    ("preload_newtons", "Preload, N", attrgetter("preload_n")),
    ("drag_torque_newton_metres", "Coulomb drag torque, N m", _bound(_DRAG, "value")),
    ("drag_torque_low_newton_metres", "Lower bound of the drag torque, N m", _bound(_DRAG, "low")),
    ("drag_torque_high_newton_metres", "Upper bound of the drag, N m", _bound(_DRAG, "high")),
    ("stiffness_newtons_per_metre", "Stiffness in series, N/m", _bound(_STIFFNESS, "value")),
    ("stiffness_low_newtons_per_metre", "Its lower bound, N/m", _bound(_STIFFNESS, "low")),
    ("stiffness_high_newtons_per_metre", "Its upper bound, N/m", _bound(_STIFFNESS, "high")),
    ("normalised_innovation_squared", "Averages 1 if the model fits", attrgetter("nis")),
)


@metrics_router.get("/metrics", response_class=Response)
async def metrics(state: StateDep, now_ns: NowDep) -> Response:
    """Metrics in the text format of Prometheus; a number that does not exist has no sample."""
    registry = CollectorRegistry()
    registry.register(ServiceCollector(state, now_ns))
    registry.register(TrendCollector(state, now_ns))
    return Response(generate_latest(registry), media_type=CONTENT_TYPE_LATEST)


class ServiceCollector(StateCollector):
    """Metrics of the service state as of one moment."""

    def collect(self) -> Iterable[Metric]:
        """All families."""
        yield from self._estimates()
        yield from self._conditions()
        yield from self._components()
        yield from self._counters()

    def _estimates(self) -> Iterable[Metric]:
        families = [gauges(name, text) for name, text, _number in _NUMBERS]
        age = gauges("estimate_age_seconds", "Age of the newest sample behind the estimate")
        status = gauges("estimate_status", "1 for the present status", "axis", "status")
        for axis in self._state.axes:
            reading = self._state.preload(axis, self._now_ns)
            for family, (_name, _text, number) in zip(families, _NUMBERS, strict=True):
                _add(family, (axis,), number(reading.estimate))
            _add(age, (axis,), reading.age_s)
            for each in EstimateStatus:
                _add(status, (axis, each.value), float(each is reading.estimate.status))
        return (*families, age, status)

    def _conditions(self) -> Iterable[Metric]:
        family = gauges("axis_condition", "1 for the present condition", "axis", "condition")
        faults = counters("data_faults", "Faulty intervals", "axis", "kind")
        for axis in self._state.axes:
            health = self._state.health(axis, self._now_ns)
            for condition in AxisCondition:
                value = float(condition is health.condition)
                _add(family, (axis, condition.value), value)
            for kind, count in health.data_faults.items():
                _add(faults, (axis, kind), count)
        return family, faults

    def _components(self) -> Iterable[Metric]:
        family = gauges(
            "component_status", "1 for the present status", "component", "axis", "status"
        )
        counts = counters(
            "component_counts",
            "Counts of the component since its start",
            "component",
            "axis",
            "counter",
        )
        readings = gauges(
            "component_reading",
            "Present value reported by the component",
            "component",
            "axis",
            "reading",
        )
        for report in self._reports():
            labels = (report.component, report.axis or "")
            for status in ComponentStatus:
                _add(family, (*labels, status.value), float(status is report.status))
            for counter, count in report.counters.items():
                _add(counts, (*labels, counter), count)
            for reading, value in report.readings.items():
                _add(readings, (*labels, reading), value)
        return family, counts, readings

    def _reports(self) -> Iterable[ComponentHealth]:
        yield from self._state.components(self._now_ns)
        for axis in self._state.axes:
            yield from self._state.health(axis, self._now_ns).components

    def _counters(self) -> Iterable[Metric]:
        lost = counters("lost_payloads", "Payloads missing from the sequence", "axis", "topic")
        for axis in self._state.axes:
            for topic, count in self._state.lost_payloads(axis).items():
                _add(lost, (axis, topic), count)
        ready = GaugeMetricFamily(
            f"{PREFIX}_ready",
            "1 if every axis has fresh input",
            not self._state.unready(self._now_ns),
        )
        readers = GaugeMetricFamily(
            f"{PREFIX}_live_readers", "Readers of the live stream", len(self._state.readers)
        )
        ignored = CounterMetricFamily(
            f"{PREFIX}_ignored_payloads",
            "Payloads of axes that are not configured",
            self._state.ignored_payloads,
        )
        refused = counters("refused_payloads", "Payloads refused on the bus", "key", "reason")
        for key_and_reason, count in self._state.refused().items():
            _add(refused, key_and_reason, count)
        place = self._state.place
        info = gauges("info", "Always 1; its labels name site and machine", "site", "machine")
        _add(info, (place.site, place.machine), 1.0)
        seldom = (refused,) if refused.samples else ()
        return info, self._build(), lost, ready, readers, ignored, *seldom

    def _build(self) -> Metric:
        """Versions, as labels."""
        build = gauges(
            "build_info",
            "Always 1; its labels name versions of program and configuration",
            *("version", "configuration"),
        )
        _add(build, (__version__, self._state.configuration), 1.0)
        return build


def _add(
    family: GaugeMetricFamily | CounterMetricFamily, labels: tuple[str, ...], value: float | None
) -> None:
    if value is not None:
        family.add_metric(labels, value)
