"""Starts nodes on one bus session, and ends them together."""

import asyncio
import gc
import getpass
import logging
import math
import os
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from functools import partial
from typing import Any

from drivers.base import DriverMisconfiguredError, DriverUnavailableError

from .. import __version__
from ..bus.session import Bus, BusUnavailableError
from ..bus.settings import BusConfigurationError, BusSettings
from ..clock import CLOCK, now_ns
from ..config import ConfigError, EdgeConfig
from ..http_api.serve import AddressError
from ..messages.event import Event, Severity
from . import acquire_node, downsample_node, estimate_node, health_node, http_node, output_node
from .supervision.heartbeat import Heartbeat
from .supervision.signals import install_stop
from .supervision.supervisor import START_S
from .supervision.task import SupervisedTask, Work
from .supervision.tasks import Tasks
from .supervision.watchdog import Watchdog
from .wiring.context import NodeContext
from .wiring.event_dispatcher import try_to_save
from .wiring.http_rights import check_access
from .wiring.process import Process

log = logging.getLogger(__name__)
PIPELINE = ("http", "health", "estimate", "downsample", "acquire")
Run = Callable[[NodeContext], Coroutine[Any, Any, None]]
_JOIN_PERIOD_S = 1.0
CLOCK_PERIOD_S = 1.0
DRAIN_S = 0.5


async def run_service(config: EdgeConfig, on_http_ready: Callable[[str], None]) -> None:
    """All nodes in one process, until SIGINT or SIGTERM.

    The process is the bus' router: others connect to its endpoint.
    """
    await check_service(config)
    check_access(config)
    place = config.bus
    bus = await Bus.open(BusSettings(place.endpoint, "router", zenoh_file=place.zenoh_file))
    names = (*config.outputs, *PIPELINE)
    await _run_on(bus, config, names, on_http_ready)


async def run_node(config: EdgeConfig, name: str, on_http_ready: Callable[[str], None]) -> None:
    """One node alone: `bus` is the router, every other node waits for it and joins it."""
    there = ("bus", *PIPELINE, *config.outputs)
    if name not in there:
        raise ConfigError(f"no node {name!r}; there are {', '.join(sorted(there))}")
    await check_service(config)
    place = config.bus
    if name == "http":
        check_access(config)
    if name == "bus":  # its nodes publish from processes of their own: so may others
        bus = await Bus.open(BusSettings(place.endpoint, "router", False, place.zenoh_file))
        log.info("bus at %s", bus.endpoint)
    else:
        bus = await _join(BusSettings(place.endpoint, "client", zenoh_file=place.zenoh_file))
    await _run_on(bus, config, (name,), on_http_ready)


async def _join(settings: BusSettings) -> Bus:
    waiting = False
    while True:
        try:
            return await Bus.open(settings)
        except BusUnavailableError as error:
            if not waiting:
                log.warning("%s; waiting for it", error)
            waiting = True
            await asyncio.sleep(_JOIN_PERIOD_S)


async def _run_on(
    bus: Bus, config: EdgeConfig, names: tuple[str, ...], on_http_ready: Callable[[str], None]
) -> None:
    try:
        bus.declare_alive(config.keys.alive)
        context = NodeContext(config, bus, on_http_ready)
        _name_old_files(config)
        context.events.put((_service_started(config, names),), now_ns())
        await run_nodes(context, names, install_stop())
    finally:
        await bus.close()


def _service_started(config: EdgeConfig, names: tuple[str, ...]) -> Event:
    try:
        who = getpass.getuser()
    except (KeyError, OSError):  # a user without a name
        who = str(os.getuid())
    return Event(
        axis="",
        kind="service_started",
        severity=Severity.INFO,
        message=f"edge-service {__version__} started: {' '.join(names)}",
        time_ns=now_ns(),
        who=who,
        origin=f"process {os.getpid()}",
        data={"version": __version__, "configuration_digest": config.digest},
    )


def _name_old_files(config: EdgeConfig) -> None:
    """Say once which files in the state folder nobody reads any more."""
    folder = config.store.folder
    if folder is not None and folder.is_dir():
        old = sorted(path.name for path in (*folder.glob("axis=*"), *folder.glob("@*")))
        if old:
            log.warning("%s: of a former version, and not read: %s", folder, ", ".join(old))


async def run_nodes(
    context: NodeContext,
    names: tuple[str, ...],
    stop: asyncio.Event,
    *,
    until_sources_end: bool = False,
) -> None:
    """Run nodes until `stop` is set; one that fails is begun again while the others go on.

    With `until_sources_end` they also end, drained, when every driver's source has ended.

    Raises:
        ConfigError: what cannot work, found while the service starts. AddressError alike.
        TaskGivenUpError: a part that the service cannot do without fails again and again.
    """
    gc.collect()
    gc.freeze()  # a full collection over the imported libraries would stop the loop for 0.2 s
    supervisor = context.supervisor
    supervisor.final = (ConfigError, AddressError, BusConfigurationError)
    supervisor.start_s = math.inf if until_sources_end else START_S
    process = Process(
        context,
        "service" if len(names) > 1 else f"{names[0]}_process",
        serves="http" in names,
        watchdog=Watchdog.of_environment(),
    )
    async with closing_store(context), process.running() as tasks:
        tasks.repeat("clock", CLOCK_PERIOD_S, CLOCK.follow)
        sources = _begin(process.context, tasks, names)

        def look(now_s: float) -> bool:
            process.look(now_s)
            return until_sources_end and all(source.done.is_set() for source in sources)

        await supervisor.run(stop, look)
        if not stop.is_set():
            await asyncio.sleep(DRAIN_S)


@asynccontextmanager
async def closing_store(context: NodeContext) -> AsyncIterator[None]:
    """Write what waits and close the store when all nodes have ended."""
    try:
        yield
    finally:
        try_to_save(context.events)
        context.store.close()


def _begin(context: NodeContext, tasks: Tasks, names: tuple[str, ...]) -> list[SupervisedTask]:
    """Begin the nodes; returns those that read the axes."""
    for name in names:
        if name in context.config.outputs:
            tasks.start(name, _life(context, partial(output_node.run, name=name)))
        elif name in _RUNS:
            tasks.start(name, _life(context, _RUNS[name]), vital=True)
    return [
        tasks.start(
            f"acquire {axis.name}",
            _life(context, partial(acquire_node.run, axis=axis)),
            may_end=True,
        )
        for axis in (context.config.axes if "acquire" in names else ())
    ]


def _life(context: NodeContext, run: Run) -> Work:
    """One life of a node: what it declares on the bus ends with it."""

    async def life(heart: Heartbeat) -> None:
        with context.of_node(heart) as own:
            await run(own)

    return life


_RUNS: dict[str, Run] = {
    "downsample": downsample_node.run,
    "estimate": estimate_node.run,
    "health": health_node.run,
    "http": http_node.run,
}


async def check_service(config: EdgeConfig) -> tuple[str, ...]:
    """Check what only the nodes and drivers know: machine files, drivers, settings, sources.

    Returns:
        One line on each source that cannot be reached now (trying again later may help).

    Raises ConfigError.
    """
    for name in config.outputs:
        output_node.make_output(config, name)
    unreachable = []
    for axis in config.axes:
        driver = acquire_node.make_driver(axis)
        try:
            await driver.probe()
        except DriverUnavailableError as error:
            unreachable.append(f"axis {axis.name}: {error}")
        except DriverMisconfiguredError as error:
            raise ConfigError(f"{axis.place}.settings.{error}") from None
        finally:
            await driver.close()
    return tuple(unreachable)
