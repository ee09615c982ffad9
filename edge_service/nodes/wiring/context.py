"""Context given to every node, and the report of a node on itself."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from ...bus.publisher import Publisher
from ...bus.session import Bus
from ...bus.subscriber import Subscriber
from ...config import EdgeConfig
from ...health.condition.component import ComponentStatusMachine
from ...messages.codec.interface import T
from ...messages.header import Header
from ...messages.health import ComponentHealth, ComponentStatus
from ...messages.topics import STATUS, Topic

REPORT_PERIOD_S = 1.0


@dataclass(slots=True)
class NodeContext:
    """The configuration and the bus, shared by the nodes of one process.

    Attributes:
        on_http_ready: called with the page's address once it is served.
        keeps_estimates: whether the estimators go on where the last process was.
    """

    config: EdgeConfig
    bus: Bus
    on_http_ready: Callable[[str], None] = field(default=lambda _url: None)
    keeps_estimates: bool = True

    def publisher(self, axis: str, topic: Topic[T]) -> Publisher[T]:
        """Declare the publisher of one topic of one axis."""
        return self.bus.publisher(self.config.keys.key(axis, topic), topic, axis)

    def subscribe(self, topic: Topic[T], *, depth: int = 256) -> Subscriber[T]:
        """Subscribe to one topic of every configured axis."""
        names = self.config.keys
        keys = names.of_axes((axis.name for axis in self.config.axes), topic)
        return self.bus.subscribe(names.all_axes(topic), topic, depth=depth, keys=keys)

    def subscribe_to_components(self) -> Subscriber[ComponentHealth]:
        """Subscribe to the reports of every component."""
        names = self.config.keys
        keys = names.of_components(tuple(axis.name for axis in self.config.axes), STATUS)
        return self.bus.subscribe(names.all_components(STATUS), STATUS, keys=keys)


async def each(subscriber: Subscriber[T], take: Callable[[str, Header, T], None]) -> None:
    """Hand axis, header and payload of everything that is heard to `take`."""
    async for axis, header, payload in subscriber:
        take(axis, header, payload)


class Reporter:
    """Publishes the status and the counters of one component, on change and once a second."""

    def __init__(self, context: NodeContext, component: str, axis: str | None = None) -> None:
        self._machine = ComponentStatusMachine(component, axis)
        self._publisher = context.bus.publisher(
            context.config.keys.component(component, axis, STATUS), STATUS, axis
        )
        self.counters: Callable[[], dict[str, int]] = dict
        self.readings: Callable[[], dict[str, float]] = dict

    @property
    def status(self) -> ComponentStatus:
        """The status last reported."""
        return self._machine.status

    def to(self, status: ComponentStatus, reason: str = "") -> None:
        """Enter a status (the same one again only renews the reason) and publish."""
        self._machine.to(status, reason)
        self.publish()

    def publish(self) -> None:
        """Put the report on the bus."""
        report = self._machine.report(self.counters(), self.readings())
        self._publisher.publish(report, time.time_ns())

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Publish once a second inside; say on leaving that the component stops."""
        repeating = asyncio.create_task(self._repeat())
        try:
            yield
        finally:
            repeating.cancel()
            if self.status is not ComponentStatus.STOPPED:
                self.to(ComponentStatus.STOPPING)
                self.to(ComponentStatus.STOPPED)

    async def _repeat(self) -> None:
        while True:
            self.publish()
            await asyncio.sleep(REPORT_PERIOD_S)
