"""`/metrics` of a fleet node."""

from collections.abc import Iterable

from fastapi import APIRouter
from fastapi.responses import Response
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest
from prometheus_client.core import Metric
from prometheus_client.registry import Collector

from ...health.fleet.plant_rows import PlantTable
from ...messages.health import AxisCondition
from ..metric_families import counters, gauges
from .desk import FleetDesk
from .routes import DeskDep

fleet_metrics_router = APIRouter(tags=["service"])


@fleet_metrics_router.get("/metrics", response_class=Response)
async def metrics(desk: DeskDep) -> Response:
    """Metrics of the plant and of this fleet node in the text format of Prometheus."""
    registry = CollectorRegistry()
    registry.register(FleetCollector(desk, await desk.table()))
    return Response(generate_latest(registry), media_type=CONTENT_TYPE_LATEST)


class FleetCollector(Collector):
    """Metrics as of one moment."""

    def __init__(self, desk: FleetDesk, table: PlantTable) -> None:
        self._desk, self._table = desk, table

    def collect(self) -> Iterable[Metric]:
        """All families."""
        axes = gauges("fleet_axes", "Axes of the plant in a condition", "condition")
        for condition in AxisCondition:
            there = sum(row.condition is condition for row in self._table.rows)
            axes.add_metric((condition.value,), there)
        faster = gauges("fleet_faster_axes", "Axes that wear faster than their peers", "node")
        outpaced = (row.peers for row in self._table.rows if row.peers is not None)
        faster.add_metric((self._desk.name,), sum(peers.faster for peers in outpaced))
        missing = gauges("fleet_missing", "Parts of the plant that are not shown", "node")
        missing.add_metric((self._desk.name,), len(self._table.missing))
        nodes = gauges("fleet_node_parts", "Parts of the plant that a fleet node reads", "node")
        for state in self._table.nodes:
            nodes.add_metric((state.name,), state.parts)
        return axes, faster, missing, nodes, *self._own()

    def _own(self) -> Iterable[Metric]:
        counts = counters("fleet_counts", "Counts of this node since its start", "counter")
        for name, count in self._desk.counters().items():
            counts.add_metric((name,), count)
        readings = gauges("fleet_reading", "Values of this node now", "reading")
        for name, value in self._desk.readings().items():
            readings.add_metric((name,), value)
        refused = counters("fleet_refused", "Payloads refused on the plant's bus", "key", "reason")
        for labels, count in self._desk.refused().items():
            refused.add_metric(labels, count)
        return counts, readings, *((refused,) if refused.samples else ())
