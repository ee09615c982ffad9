"""Cost of a plant, from what one axis and one report were measured to cost."""

from dataclasses import dataclass

from edge_service.bus.plant.reporting import HEARTBEAT_S

AXES_PER_MACHINE = 8
DAY_S = 86_400.0


@dataclass(frozen=True, slots=True)
class Measured:
    """Figures of `edge-service bench plant` and of the tests.

    Attributes:
        report_bytes: of a machine of 8 axes on the bus.
        read_us: processor of a fleet node for one axis of one report.
        table_us: processor of a fleet node for one axis of a table of the whole plant.
        router_us: processor of a router for one axis of one report.
        number_us: processor of a router for one axis of one number of a last report.
        axis_kb: memory of a fleet node for one axis of the whole plant.
        node_mb: memory of a fleet node without machines.
        point_bytes: one axis of one logged report in a fleet node's store.
        logged_bytes: one report in a machine's own log.
    """

    report_bytes: float
    read_us: float
    table_us: float
    router_us: float
    number_us: float
    axis_kb: float
    node_mb: float
    point_bytes: float
    logged_bytes: float


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of a plant.

    Attributes:
        messages_s, mb_s: into the fleet nodes together.
        router_cores: of the router through which all of it goes.
        node_cores: of each fleet node while somebody looks at its page.
        node_mb: memory of each.
        store_mb_day, log_mb_day: history of all fleet nodes together, and of each machine.
    """

    messages_s: float
    mb_s: float
    router_cores: float
    node_cores: float
    node_mb: float
    store_mb_day: float
    log_mb_day: float


def plant_cost(
    axes: int,
    measured: Measured,
    nodes: int = 2,
    period_s: float = 1.0,
    log_period_s: float = 600.0,
    table_s: float = 1.0,
) -> Cost:
    """Cost of a plant whose machines have 8 axes each.

    Args:
        period_s, log_period_s: between the reports of a machine, and those in its log.
        table_s: between two tables of the whole plant, on each node.
    """
    machines = axes / AXES_PER_MACHINE
    reports_s = machines / period_s
    router_us = measured.router_us / period_s + measured.number_us / max(period_s, HEARTBEAT_S)
    reading = axes / period_s / nodes * measured.read_us / 1e6
    return Cost(
        messages_s=reports_s,
        mb_s=reports_s * measured.report_bytes / 1e6,
        router_cores=axes * router_us / 1e6,
        node_cores=reading + axes / table_s * measured.table_us / 1e6,
        node_mb=measured.node_mb + axes * measured.axis_kb / 1e3,
        store_mb_day=axes * DAY_S / log_period_s * measured.point_bytes / 1e6,
        log_mb_day=DAY_S / log_period_s * measured.logged_bytes / 1e6,
    )
