"""Process of one fleet node: wiring, loop, clock and signals."""

import asyncio
import logging
from collections.abc import Callable
from functools import partial

from ...bus.plant.session import PlantSettingsError
from ...clock import CLOCK
from ...config import ConfigError, FleetNodeConfig
from ...http_api.fleet.app import create_fleet_app
from ...http_api.limits.settings import HttpLimits
from ...http_api.serve import AddressError, serve
from ..outputs.plant.access import plant_settings
from ..supervision.heartbeat import Heartbeat
from ..supervision.signals import install_stop
from ..supervision.supervisor import Supervisor
from ..supervision.tasks import Tasks
from ..supervision.watchdog import Watchdog
from ..wiring.http_rights import Address, doorkeeper_of, hosts_of, tls_files
from .backfill import Backfill
from .desk import PlantDesk
from .reader import FleetReader

log = logging.getLogger(__name__)
CLOCK_PERIOD_S = 1.0
LOOK_PERIOD_S, ANSWER_PERIOD_S = 0.25, 1.0


async def run_fleet_node(config: FleetNodeConfig, on_http_ready: Callable[[str], None]) -> None:
    """Run one fleet node until SIGINT or SIGTERM.

    Raises ConfigError, AddressError: before anything is served.
    """
    supervisor = Supervisor()
    supervisor.final = (ConfigError, AddressError, PlantSettingsError)
    tasks = supervisor.tasks("fleet")
    problems: list[Callable[[], list[str]]] = [tasks.faults]
    reader = FleetReader(
        config.node.name,
        config.node.page,
        plant_settings(config.plant),
        lambda: [line for each in problems for line in each()],
    )
    backfill = Backfill(reader, config.history.folder, config.history.budget_mb)
    reader.answer_past = backfill.answer
    problems.append(backfill.problems)
    desk = PlantDesk(reader, backfill)
    watchdog = Watchdog.of_environment()
    ready = False

    def served(url: str) -> None:
        nonlocal ready
        ready = True
        on_http_ready(url)

    def look(now_s: float) -> bool:
        faults = "; ".join(supervisor.faults()) or "all tasks are running"
        watchdog.look(now_s, ready=ready, well=supervisor.is_well, status=faults)
        return False

    try:
        _begin(tasks, config, reader, desk, served)
        tasks.start("backfill", backfill.run)
        await supervisor.run(install_stop(), look)
    finally:
        watchdog.stopping()
        await tasks.end()
        await reader.close()
        backfill.close()


def _begin(
    tasks: Tasks,
    config: FleetNodeConfig,
    reader: FleetReader,
    desk: PlantDesk,
    served: Callable[[str], None],
) -> None:
    """Begin the tasks of the node."""
    http = config.http
    app = create_fleet_app(desk, hosts_of(http), doorkeeper_of(http))
    scheme = "http" if http.certificate is None else "https"
    address = Address(http.host, http.port, served, scheme)
    serve_app = partial(
        serve, app, tls=tls_files(http), limits=HttpLimits(connections=http.connections)
    )

    async def server(heart: Heartbeat) -> None:
        await serve_app(
            address.host,
            address.port,
            stop=asyncio.Event(),
            on_bound=address.bound,
            on_tick=heart.beat,
        )

    tasks.repeat("clock", CLOCK_PERIOD_S, CLOCK.follow)
    tasks.start("server", server, vital=True)
    tasks.start("plant", reader.run, vital=True)
    tasks.start("reports", partial(reader.read, tasks.failures), vital=True)
    tasks.repeat("table", LOOK_PERIOD_S, desk.look)
    tasks.repeat("answers", ANSWER_PERIOD_S, reader.prepare)
