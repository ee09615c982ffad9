"""Starts nodes on one bus session, and ends them together."""

import asyncio
import gc
import logging
import os
import signal
import socket
from collections.abc import Callable, Coroutine, Iterable
from contextlib import AsyncExitStack, suppress
from dataclasses import replace
from typing import Any

from .. import __version__
from ..bus.session import Bus, BusUnavailableError
from ..bus.settings import BusSettings
from ..clock import CLOCK, now_ns
from ..config import ConfigError, EdgeConfig
from ..health.store.store import held
from ..messages.event import AxisCondition, Code, Event, told
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
_RUNS: dict[str, Callable[[NodeContext], Coroutine[Any, Any, None]]] = {
    "downsample": downsample_node.run,
    "estimate": estimate_node.run,
    "health": health_node.run,
    "http": lambda context: http_node.HttpNode(context).run(),
}


async def run_service(
    read: Callable[[], EdgeConfig], on_http_ready: Callable[[str], None], name: str | None = None
) -> None:
    """All nodes in one process, or one alone, until SIGINT or SIGTERM.

    All together are the router of the bus; else the node `bus` is, which every other one joins.

    Args:
        read: reads the configuration, now and again at each SIGHUP.
    """
    config = read()
    there = ("bus", *PIPELINE, *config.outputs)
    if name is not None and name not in there:
        raise ConfigError(f"no node {name!r}; there are {', '.join(sorted(there))}")
    await check_service(config)
    if name in (None, "http"):
        check_access(config)
    place, folder = config.bus, config.store.folder
    # Around a router alone nodes publish from processes of their own: so may others.
    settings = BusSettings(place.endpoint, "client", name != "bus", place.zenoh_file)
    names = (*config.outputs, *PIPELINE) if name is None else (name,)
    async with AsyncExitStack() as stack:
        stack.enter_context(held(folder, alone=name is None))
        bus = await _joined(replace(settings, role="router") if name in (None, "bus") else settings)
        stack.push_async_callback(bus.close)
        if name == "bus":
            log.info("bus at %s", bus.endpoint)
        bus.declare_alive(config.keys.alive)
        kept = "memory alone" if folder is None else folder.resolve()
        more = f"edge-service: version {__version__}, state in {kept}; Ctrl-C ends it"
        context = NodeContext(config, bus, lambda url: on_http_ready(f"{url}\n{more}"))
        started = Event(
            axis="",
            kind="service_started",
            level=AxisCondition.NORMAL,
            **dict(told(Code.STARTED, version=__version__, parts=" ".join(names))),
            time_ns=now_ns(),
            who=os.environ.get("USER") or str(os.getuid()),
            origin=f"process {os.getpid()}",
            data={"version": __version__, "configuration_digest": config.digest},
        )
        context.events.put((started,), now_ns())
        asyncio.get_running_loop().add_signal_handler(signal.SIGHUP, reread, context, read)
        await run_nodes(context, names, install_stop())


async def _joined(settings: BusSettings) -> Bus:
    """The bus; a client waits for its router."""
    retry, is_told = Retry(0.5, 5.0), False
    while True:
        try:
            return await Bus.open(settings)
        except BusUnavailableError as error:
            if not is_told:
                log.warning("%s; waiting for it", error)
            is_told = True
            await asyncio.sleep(retry.pause_s())


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
    if config.model_dump(exclude={"axes"}) != context.config.model_dump(exclude={"axes"}):
        log.warning("what has changed beside the axes takes effect after a restart")


async def run_nodes(context: NodeContext, names: tuple[str, ...], stop: asyncio.Event) -> None:
    """Run nodes to `stop` or a replay's end. Raises PartFailedError, ConfigError, AddressError."""
    gc.collect()
    gc.freeze()  # a full collection over the imported libraries would stop the loop for 0.2 s
    process = Component(context, "service" if len(names) > 1 else f"{names[0]}_process")
    tell_url = context.on_http_ready

    def served(url: str) -> None:
        notify_systemd("READY=1")
        tell_url(url)

    context.on_http_ready = served
    outputs = context.config.outputs
    context.outputs = {each: output_node.make_output(context.config, each) for each in outputs}
    nodes = _Nodes(context, process, names)
    context.renewals.append(nodes.renew)
    try:
        async with process.running():
            process.to(ComponentStatus.OK)
            process.repeat(CLOCK_PERIOD_S, CLOCK.follow)
            process.start(_watch_loop(context, "estimate" in names))
            key = context.config.keys.component(process.name, None, STATUS)
            reports = context.bus.subscribe(key, STATUS, keys=(key,))
            process.follow(reports, lambda *_: notify_systemd("WATCHDOG=1"))
            process.start(context.dispatcher.run(process.bears))
            for each in names:
                if each in _RUNS:
                    process.start(_RUNS[each](context))
            nodes.tell_outputs()
            for axis in context.machines:
                nodes.read(axis)
            if "http" not in names:
                notify_systemd("READY=1")
            if context.is_replay:
                process.start(nodes.drain(stop))
            await stop.wait()
            notify_systemd("STOPPING=1")
    finally:
        context.dispatcher.flush()
        context.store.close()


class _Nodes:
    """Nodes of which there is one for each axis, or which begin anew with an axis."""

    def __init__(self, context: NodeContext, process: Component, names: tuple[str, ...]) -> None:
        self._context, self._process, self._names = context, process, names
        self._known = {*context.machines}
        self._sources: dict[str, asyncio.Task[None]] = {}
        self._outputs: list[asyncio.Task[None]] = []
        self._closing: dict[str, set[asyncio.Task[None]]] = {}
        """Tasks of an axis, or of the outputs (""), that were ended and may be closing."""

    def renew(self, axis: str) -> None:
        """Read an axis anew, or no longer; outputs begin anew with another set of axes."""
        if (axis in self._context.machines) != (axis in self._known):
            self._known ^= {axis}
            self.tell_outputs()
        source = self._sources.pop(axis, None)
        self._end(axis, () if source is None else (source,))
        if axis in self._context.machines:
            self.read(axis)

    def _end(self, place: str, tasks: Iterable[asyncio.Task[None]]) -> None:
        for task in tasks:
            task.cancel()
        still = {each for each in self._closing.get(place, ()) if not each.done()}
        self._closing[place] = still | {*tasks}

    def read(self, axis: str) -> None:
        """Read an axis as soon as it is no longer read as before."""
        before = self._closing.get(axis)

        async def reading() -> None:
            if before:
                await asyncio.wait(before)
            table = next(each for each in self._context.config.axes if each.name == axis)
            await acquire_node.run(self._context, table)

        if "acquire" in self._names:
            self._sources[axis] = self._process.start(reading())

    def tell_outputs(self) -> None:
        """Begin with the outputs, or begin anew once those of before have closed."""
        self._end("", self._outputs)
        before = self._closing[""]

        async def telling(name: str) -> None:
            if before:
                await asyncio.wait(before)
            await output_node.run(self._context, name)

        there = [each for each in self._names if each in self._context.config.outputs]
        self._outputs = [self._process.start(telling(each)) for each in there]

    async def drain(self, stop: asyncio.Event) -> None:
        """Stop when all sources have ended, and what they gave has passed all nodes."""
        await asyncio.wait([*self._sources.values()])
        context = self._context
        self._process.repeat(DRAIN_PERIOD_S, lambda: None if context.has_unread() else stop.set())


async def _watch_loop(context: NodeContext, prepares: bool) -> None:
    """Tell, at most once a minute, when nothing could run for more than a second."""
    loop = asyncio.get_running_loop()
    if prepares:  # the kernels hold it up, on any computer
        await asyncio.shield(context.prepared)
    while True:
        begun_s = loop.time()
        await asyncio.sleep(LOOK_PERIOD_S)
        held_s = loop.time() - begun_s - LOOK_PERIOD_S
        if held_s > HELD_UP_S:
            log.warning("The service was held up for %.1f s; is the computer overloaded?", held_s)
            await asyncio.sleep(TOLD_AGAIN_S)


def notify_systemd(line: str) -> None:
    """Send a word to systemd, if it asks for any: sd_notify(3)."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if address[:1] in ("/", "@"):
        kind = socket.SOCK_DGRAM | socket.SOCK_CLOEXEC
        with suppress(OSError), socket.socket(socket.AF_UNIX, kind) as to:
            to.setblocking(False)
            to.sendto(line.encode(), address.replace("@", "\0", 1))


async def check_service(config: EdgeConfig) -> tuple[str, ...]:
    """Check drivers and settings; a line on each source that is away now. Raises ConfigError."""
    for name in config.outputs:
        output_node.make_output(config, name)
    said = [await acquire_node.check_source(axis) for axis in config.axes]
    return tuple(filter(None, said))
