"""Context given to every node, and the report of a node on itself."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field, replace

from ...bus.publisher import Publisher
from ...bus.session import Bus
from ...bus.subscriber import Subscriber
from ...clock import now_ns
from ...config import EdgeConfig
from ...health.condition.component import ComponentStatusMachine
from ...health.store.events import EventLog
from ...health.store.store import FILE_NAME, Store, StoreFailedError
from ...messages.codec.interface import T
from ...messages.event import Event, Severity
from ...messages.health import ComponentHealth, ComponentStatus
from ...messages.topics import EVENT, STATUS, Topic
from ..supervision.heartbeat import Heartbeat
from ..supervision.supervisor import Supervisor
from ..supervision.task import TaskChange
from ..supervision.tasks import Tasks
from ..supervision.words import said

REPORT_PERIOD_S = 1.0
_OPENING_S = 300.0
"""Longest check of a large file on a slow disk."""


@dataclass(slots=True)
class NodeContext:
    """The configuration and the bus, shared by the nodes of one process.

    Attributes:
        on_http_ready: called with the page's address once it is served.
        keeps_estimates: whether the estimators go on where the last process was.
        supervisor: owner of all tasks of the process.
        heart: sign of life of the node that it is given to.
    """

    config: EdgeConfig
    bus: Bus
    on_http_ready: Callable[[str], None] = field(default=lambda _url: None)
    keeps_estimates: bool = True
    supervisor: Supervisor = field(default_factory=Supervisor)
    heart: Heartbeat = field(
        default_factory=lambda: Heartbeat("node", float("inf"), time.monotonic)
    )

    _events: EventLog | None = None

    def __post_init__(self) -> None:
        folder = self.config.store.folder
        path = None if folder is None else folder / FILE_NAME
        self._events = self._events or EventLog(Store(path))

    @property
    def events(self) -> EventLog:
        """Events in the store; the nodes of a process share one."""
        assert self._events is not None
        return self._events

    @property
    def store(self) -> Store:
        """The store of the process."""
        return self.events.store

    def publisher(self, axis: str, topic: Topic[T]) -> Publisher[T]:
        """Declare the publisher of one topic of one axis."""
        return self.bus.publisher(self.config.keys.key(axis, topic), topic, axis)

    def subscribe(self, topic: Topic[T], *, depth: int = 256) -> Subscriber[T]:
        """Subscribe to one topic of every configured axis."""
        names = self.config.keys
        keys = names.of_axes((axis.name for axis in self.config.axes), topic)
        return self.bus.subscribe(names.all_axes(topic), topic, depth=depth, keys=keys)

    def subscribe_to_components(self, topic: Topic[T]) -> Subscriber[T]:
        """Subscribe to one topic of every component."""
        names = self.config.keys
        keys = names.of_components(tuple(axis.name for axis in self.config.axes), topic)
        return self.bus.subscribe(names.all_components(topic), topic, keys=keys)

    @contextmanager
    def of_node(self, heart: Heartbeat) -> Iterator["NodeContext"]:
        """The context of one life of one node: what it declares on the bus ends with it."""
        with self.bus.scope() as bus:
            yield replace(self, bus=bus, heart=heart)

    async def from_store(self, reporter: "Reporter", work: Callable[[], T]) -> T:
        """Result of work on the store; while that cannot be read, it is waited for, and said."""
        while True:
            try:
                return await self.heart.in_thread(work, limit_s=_OPENING_S)
            except StoreFailedError as error:
                reporter.to(ComponentStatus.RECOVERABLE_ERROR, str(error))
                await self.heart.sleep(REPORT_PERIOD_S)

    async def forever(self) -> None:
        """Wait until the node is ended; its tasks do the work."""
        with self.heart.idle():
            await asyncio.Event().wait()


class Reporter:
    """Publishes the status and the counters of one component, on change and once a second.

    It owns the component's tasks: while one of them is down, the status says so.
    """

    def __init__(self, context: NodeContext, component: str, axis: str | None = None) -> None:
        self._machine = ComponentStatusMachine(component, axis)
        self._axis = axis
        keys, bus = context.config.keys, context.bus
        self._publisher = bus.publisher(keys.component(component, axis, STATUS), STATUS, axis)
        self._events = bus.publisher(keys.component(component, axis, EVENT), EVENT, axis)
        self._tasks = context.supervisor.tasks(
            component if axis is None else f"{component} {axis}", self.tell
        )
        self.counters: Callable[[], dict[str, int]] = dict
        self.readings: Callable[[], dict[str, float]] = dict
        self.problems: Callable[[], list[str]] = list
        """Problems beside its tasks, e.g. that the disk takes nothing."""
        self.broken: Callable[[], bool] = lambda: False
        """True while it does not do its work although its tasks do theirs."""

    @property
    def status(self) -> ComponentStatus:
        """The status last entered."""
        return self._machine.status

    def to(self, status: ComponentStatus, reason: str = "") -> None:
        """Enter a status (the same one again only renews the reason) and publish."""
        self._machine.to(status, reason)
        self.publish()

    def publish(self) -> None:
        """Put the report on the bus."""
        self._publisher.publish(self._report(), now_ns())

    def _report(self) -> ComponentHealth:
        faults = self._tasks.faults() + self.problems()
        own = self._machine.report(
            self.counters()
            | {
                "task_restarts": self._tasks.restarts,
                "message_failures": self._tasks.failures.count,
            },
            self.readings() | {"tasks_down": float(self._tasks.down + self.broken())},
        )
        if not faults or own.status in _ENDING:
            return own
        given_up = self._tasks.given_up
        down = ComponentStatus.PERMANENT_ERROR if given_up else ComponentStatus.RECOVERABLE_ERROR
        return own.model_copy(update={"status": down, "reason": "; ".join(faults)})

    @asynccontextmanager
    async def running(self) -> AsyncIterator[Tasks]:
        """Own tasks inside, and publish once a second; say on leaving that the component stops."""
        self._tasks.repeat("report", REPORT_PERIOD_S, self.publish)
        failure = ""
        try:
            yield self._tasks
        except Exception as error:
            failure = said(error)
            raise
        finally:
            await self._tasks.end()
            if failure:
                self.to(ComponentStatus.RECOVERABLE_ERROR, failure)
            else:
                self.to(ComponentStatus.STOPPING)
                self.to(ComponentStatus.STOPPED)

    def note(self, where: str, error: Exception) -> None:
        """Count an error in a single message, and tell of it."""
        self._tasks.failures.note(where, self._axis or "", error)

    def tell(self, change: TaskChange) -> None:
        """Tell of a change by an event and by the status."""
        at_ns = now_ns()
        event = Event(
            axis=self._axis or "",
            kind=change.kind if change.kind in OWN_EVENTS else "component_changed",
            severity=_SEVERITY.get(change.kind, Severity.WARNING),
            message=f"{self._machine.component}: {change.task} {change.reason}",
            time_ns=at_ns,
            data={
                "component": self._machine.component,
                "task": change.task,
                "change": change.kind,
                "restarts": change.restarts,
            },
        )
        self._events.publish(event, at_ns)
        self.publish()


OWN_EVENTS = ("component_changed", "estimator_reset")
"""Kinds of events that components tell of themselves."""
_ENDING = (ComponentStatus.STOPPING, ComponentStatus.STOPPED)
_SEVERITY = {"task_recovered": Severity.INFO, "task_given_up": Severity.ERROR}
