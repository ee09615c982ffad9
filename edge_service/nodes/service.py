"""Starts nodes on one bus session, and ends them together."""

import asyncio
import gc
import getpass
import logging
import os
import signal
import socket
from collections.abc import Callable, Coroutine
from contextlib import suppress
from typing import Any

from .. import __version__
from ..bus.session import Bus, BusUnavailableError
from ..bus.settings import BusSettings
from ..clock import CLOCK, now_ns
from ..config import ConfigError, EdgeConfig
from ..messages.event import AxisCondition, Event
from ..messages.health import ComponentStatus
from ..messages.topics import STATUS
from ..retry import Retry
from . import acquire_node, downsample_node, estimate_node, health_node, http_node, output_node
from .component import Component
from .context import NodeContext
from .http_rights import check_access
from .stages import load_machines, make_estimator

log = logging.getLogger(__name__)
PIPELINE = ("http", "health", "estimate", "downsample", "acquire")
CLOCK_PERIOD_S = 1.0
DRAIN_PERIOD_S = 0.02
LOOK_PERIOD_S, HELD_UP_S, TOLD_AGAIN_S = 0.5, 1.0, 60.0
_JOIN_FIRST_S, _JOIN_CAP_S = 0.5, 5.0
_RUNS: dict[str, Callable[[NodeContext], Coroutine[Any, Any, None]]] = {
    "downsample": downsample_node.run,
    "estimate": estimate_node.run,
    "health": health_node.run,
    "http": http_node.run,
}


async def run_service(read: Callable[[], EdgeConfig], on_http_ready: Callable[[str], None]) -> None:
    """All nodes in one process, until SIGINT or SIGTERM.

    The process is the bus' router: others connect to its endpoint.

    Args:
        read: reads the configuration, now and again at each SIGHUP.
    """
    config = read()
    await check_service(config)
    check_access(config)
    place = config.bus
    bus = await Bus.open(BusSettings(place.endpoint, "router", zenoh_file=place.zenoh_file))
    await _run_on(bus, config, (*config.outputs, *PIPELINE), on_http_ready, read)


async def run_node(
    read: Callable[[], EdgeConfig], name: str, on_http_ready: Callable[[str], None]
) -> None:
    """One node alone: `bus` is the router, every other node waits for it and joins it."""
    config = read()
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
    await _run_on(bus, config, (name,), on_http_ready, read)


async def _join(settings: BusSettings) -> Bus:
    retry, is_told = Retry(_JOIN_FIRST_S, _JOIN_CAP_S), False
    while True:
        try:
            return await Bus.open(settings)
        except BusUnavailableError as error:
            if not is_told:
                log.warning("%s; waiting for it", error)
            is_told = True
            await asyncio.sleep(retry.pause_s())


async def _run_on(
    bus: Bus,
    config: EdgeConfig,
    names: tuple[str, ...],
    on_http_ready: Callable[[str], None],
    read: Callable[[], EdgeConfig],
) -> None:
    try:
        bus.declare_alive(config.keys.alive)
        context = NodeContext(config, bus, on_http_ready)
        try:
            who = getpass.getuser()
        except (KeyError, OSError):  # a user without a name
            who = str(os.getuid())
        started = Event(
            axis="",
            kind="service_started",
            level=AxisCondition.NORMAL,
            text=f"edge-service {__version__} started: {' '.join(names)}",
            time_ns=now_ns(),
            who=who,
            origin=f"process {os.getpid()}",
            data={"version": __version__, "configuration_digest": config.digest},
        )
        context.events.put((started,), now_ns())
        with suppress(NotImplementedError, RuntimeError):  # not the main thread: a test
            loop = asyncio.get_running_loop()
            loop.add_signal_handler(signal.SIGHUP, reread, context, read)
        await run_nodes(context, names, install_stop())
    finally:
        await bus.close()


def install_stop() -> asyncio.Event:
    """An event that SIGINT and SIGTERM set."""
    stop, loop = asyncio.Event(), asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        with suppress(NotImplementedError, RuntimeError):  # not the main thread: a test
            loop.add_signal_handler(number, stop.set)
    return stop


def reread(context: NodeContext, read: Callable[[], EdgeConfig]) -> None:
    """Let axes that are new or changed begin, and others go; all else needs a restart."""
    old = {axis.name: axis for axis in context.config.axes}
    try:
        config = read()
        machines = load_machines(config)
        changed = []
        for axis in config.axes:
            machine = machines[axis.name]
            is_same = axis.name in old and axis.model_dump() == old[axis.name].model_dump()
            if not (is_same and machine == context.machines[axis.name]):
                acquire_node.make_driver(axis)
                make_estimator(config.estimator, machine)
                changed.append(axis)
    except ConfigError as error:
        log.error("the configuration is not taken over: %s", error)
        return
    for axis in changed:
        log.info("axis %s begins anew", axis.name)
        context.renew(axis, machines[axis.name])
    for name in old.keys() - machines.keys():
        log.info("axis %s goes", name)
        context.drop(name)
    beside = {"axes"}
    if config.model_dump(exclude=beside) != context.config.model_dump(exclude=beside):
        log.warning("what has changed beside the axes takes effect after a restart")


async def run_nodes(context: NodeContext, names: tuple[str, ...], stop: asyncio.Event) -> None:
    """Run nodes until `stop` is set, or, of a replay, its sources have ended.

    Raises:
        PartFailedError: a part that the service cannot do without failed.
        ConfigError, AddressError: what only a person can mend.
    """
    gc.collect()
    gc.freeze()  # a full collection over the imported libraries would stop the loop for 0.2 s
    name = "service" if len(names) > 1 else f"{names[0]}_process"
    process = Component(context, name)
    tell_url = context.on_http_ready

    def served(url: str) -> None:
        notify_systemd("READY=1")
        tell_url(url)

    context.on_http_ready = served
    sources: dict[str, asyncio.Task[None]] = {}
    outputs: dict[str, asyncio.Task[None]] = {}

    def changed(name: str) -> None:
        """Read an axis that is new, or no longer; outputs begin anew with the axes that are."""
        if (name in context.machines) == (name in known):
            return
        known.symmetric_difference_update((name,))
        for output, task in outputs.items():
            task.cancel()
            outputs[output] = process.start(output_node.run(context, output))
        if name in sources:
            sources.pop(name).cancel()
        elif "acquire" in names:
            read(name)

    def read(name: str) -> None:
        axis = next(each for each in context.config.axes if each.name == name)
        sources[name] = process.start(acquire_node.run(context, axis))

    async def drain(of: list[asyncio.Task[None]]) -> None:
        """Stop when sources have ended, and what they gave has passed all nodes."""
        await asyncio.wait(of)
        process.repeat(DRAIN_PERIOD_S, lambda: None if context.bus.has_unread() else stop.set())

    known = {*context.machines}
    context.renewals.append(changed)
    try:
        async with process.running():
            process.to(ComponentStatus.OK)
            process.repeat(CLOCK_PERIOD_S, CLOCK.follow)
            process.start(_watch_loop())
            process.start(_feed_watchdog(context, name))
            process.start(context.dispatcher.run(process.bears))
            for each in names:
                if each in context.config.outputs:
                    outputs[each] = process.start(output_node.run(context, each))
                elif each in _RUNS:
                    process.start(_RUNS[each](context))
            for axis in context.config.axes if "acquire" in names else ():
                read(axis.name)
            if "http" not in names:
                notify_systemd("READY=1")
            if context.is_replay:
                process.start(drain([*sources.values()]))
            await stop.wait()
            notify_systemd("STOPPING=1")
    finally:
        context.dispatcher.flush()
        context.store.close()


async def _watch_loop() -> None:
    """Tell, at most once a minute, when nothing could run for more than a second."""
    loop = asyncio.get_running_loop()
    while True:
        begun_s = loop.time()
        await asyncio.sleep(LOOK_PERIOD_S)
        held_s = loop.time() - begun_s - LOOK_PERIOD_S
        if held_s > HELD_UP_S:
            log.warning("The service was held up for %.1f s; is the computer overloaded?", held_s)
            await asyncio.sleep(TOLD_AGAIN_S)


async def _feed_watchdog(context: NodeContext, component: str) -> None:
    """Feed systemd's watchdog with each report of the process that comes back over the bus."""
    key = context.config.keys.component(component, None, STATUS)
    async for _ in context.bus.subscribe(key, STATUS, keys=(key,)):
        notify_systemd("WATCHDOG=1")


def notify_systemd(line: str) -> None:
    """Send a word to systemd, if it asks for any: sd_notify(3)."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if address[:1] in ("/", "@"):
        kind = socket.SOCK_DGRAM | socket.SOCK_CLOEXEC
        with suppress(OSError), socket.socket(socket.AF_UNIX, kind) as to:
            to.setblocking(False)
            to.sendto(line.encode(), address.replace("@", "\0", 1))


async def check_service(config: EdgeConfig) -> tuple[str, ...]:
    """Check what only the nodes and drivers know: machine files, drivers, settings, sources.

    Returns:
        One line on each source that cannot be reached now (trying again later may help).

    Raises ConfigError.
    """
    for name in config.outputs:
        output_node.make_output(config, name)
    said = [await acquire_node.check_source(axis) for axis in config.axes]
    return tuple(filter(None, said))
