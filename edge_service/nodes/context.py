"""Configuration, bus, machines and store of events, shared by the nodes of one process."""

import asyncio
import logging
import time
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, suppress
from functools import cached_property
from typing import Any, NoReturn

from ..bus.publisher import Publisher
from ..bus.session import Bus
from ..bus.subscriber import Subscriber
from ..clock import now_ns
from ..config import AxisConfig, EdgeConfig
from ..health.store.events import EventLog, StoredEvent
from ..health.store.store import FILE_NAME, State, Store, StoreFailedError
from ..messages.codec import Header, T, Topic
from ..messages.event import AxisCondition, Event
from ..models.machine import Machine
from ..outputs.base import Output
from .stages import load_machines, prepare

PATIENCE_S = 2.0
"""So long the disk may hold back what is to be told; then monitoring goes on without it."""
log = logging.getLogger(__name__)
WATCH_PERIOD_S = 1.0
SILENT = "the disk does not answer"
Publish = Callable[[list[StoredEvent], str], None]
"""Takes events that are kept, and the problem that kept them off the disk; empty without."""


class NodeContext:
    """Shared by the nodes of one process.

    Args:
        keeps_estimates: whether the estimators go on where the last process was.
        is_replay: it ends with its sources, and a source that cannot work ends it.
    """

    def __init__(
        self,
        config: EdgeConfig,
        bus: Bus,
        on_http_ready: Callable[[str], None] = lambda _url: None,
        *,
        keeps_estimates: bool = True,
        is_replay: bool = False,
    ) -> None:
        self.config, self.bus, self.on_http_ready = config, bus, on_http_ready
        self.keeps_estimates, self.is_replay = keeps_estimates, is_replay
        folder = config.store.folder
        self.store = Store(None if folder is None else folder / FILE_NAME)
        self.events = EventLog(self.store)
        self.dispatcher = EventDispatcher(self.events)
        self.outputs: dict[str, Output] = {}
        """Outputs as configured, for whoever looks after their queues."""
        self._subscribers: list[Subscriber[Any]] = []
        self.gone: set[str] = set()
        """Axes that were removed since the beginning."""
        self.renewals: list[Callable[[str], None]] = []
        """Told of every axis that begins, begins anew or is gone from `machines`."""

    @cached_property
    def machines(self) -> dict[str, Machine]:
        """Machine of each axis, by the axis' name. Raises ConfigError."""
        return load_machines(self.config)

    @cached_property
    def prepared(self) -> asyncio.Future[None]:
        """Done once the kernels are compiled; that begins when it is first asked for."""
        return asyncio.ensure_future(prepare(self.config, tuple(self.machines.values())))

    def renew(self, axis: AxisConfig, machine: Machine) -> None:
        """Let an axis begin, or begin anew, by its table and machine file, in every node."""
        self.config = self.config.with_axis(axis)
        self.machines[axis.name] = machine
        self.gone.discard(axis.name)
        for renew in (*self.renewals,):
            renew(axis.name)

    def drop(self, axis: str) -> None:
        """Let every node forget an axis, and the bus what was last said of it."""
        axes = tuple(each for each in self.config.axes if each.name != axis)
        self.config = self.config.model_copy(update={"axes": axes})
        del self.machines[axis]
        self.gone.add(axis)
        for renew in (*self.renewals,):
            renew(axis)
        self.bus.forget(f"{self.config.keys.root}/{axis}/")

    def publisher(self, axis: str, topic: Topic[T]) -> Publisher[T]:
        return self.bus.publisher(self.config.keys.key(axis, topic), topic, axis)

    def publishers(self, topic: Topic[T]) -> dict[str, Publisher[T]]:
        """Declare the publishers of one topic of every axis that is there, now or later."""
        publishers: dict[str, Publisher[T]] = {}

        def declare(axis: str) -> None:
            if axis in self.gone:
                publishers.pop(axis, None)
            else:
                publishers[axis] = self.publisher(axis, topic)

        self._for_every_axis(declare)
        return publishers

    def subscribe(self, topic: Topic[T], *, depth: int = 256) -> Subscriber[T]:
        """Subscribe to one topic of every configured axis."""
        names, keys = self.config.keys, set[str]()
        self._for_every_axis(lambda axis: keys.add(names.key(axis, topic)))
        subscriber = self.bus.subscribe(names.all_axes(topic), topic, depth=depth, keys=keys)
        self._subscribers.append(subscriber)
        return subscriber

    def has_unread(self) -> bool:
        """Return whether something that was published waits for a node of this process."""
        return any(each.has_unread for each in self._subscribers)

    def subscribe_to_components(self, topic: Topic[T]) -> Subscriber[T]:
        names = self.config.keys
        keys = {*names.of_components((), topic)}
        self._for_every_axis(lambda axis: keys.update(names.of_components((axis,), topic)))
        return self.bus.subscribe(names.all_components(topic), topic, keys=keys)

    def _for_every_axis(self, work: Callable[[str], None]) -> None:
        """Do something for every axis, and for each that comes later."""
        for axis in self.config.axes:
            work(axis.name)
        self.renewals.append(work)

    async def forever(self) -> NoReturn:
        """Wait until the node is ended; its tasks do the work."""
        await asyncio.get_running_loop().create_future()
        raise AssertionError("unreachable")


def header() -> Header:
    """Header of a question or an answer: each is the only one of its series."""
    asked_ns = now_ns()
    return Header(0, asked_ns, asked_ns, time.monotonic_ns())


class EventDispatcher:
    """Queue of events and their states: kept together in one transaction, then published."""

    def __init__(self, events: EventLog) -> None:
        self._events = events
        self._waiting: list[tuple[list[StoredEvent], Publish]] = []
        self._wake = asyncio.Event()
        self._saving: asyncio.Task[tuple[dict[int, int], str]] | None = None
        self._problem, self._damages = "", 0

    def put(self, events: Iterable[Event], publish: Publish, states: Iterable[State] = ()) -> None:
        """Publish events as soon as they are kept with states; never waits."""
        self._waiting.append((self._events.put(events, now_ns(), states), publish))
        self._wake.set()

    async def run(self, bears: Callable[[str], AbstractContextManager[None]]) -> None:
        """Keep and publish, until cancelled; an error in one publication is borne."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            count, patience_s = len(self._waiting), 0.0
            if self._saving is None or self._saving.done():
                self._saving = asyncio.ensure_future(self._events.store.run(self.save))
                patience_s = PATIENCE_S
            await asyncio.wait({self._saving}, timeout=patience_s)
            outcome = self._saving.result() if self._saving.done() else ({}, SILENT)
            for _ in range(count):
                with bears("an event"):
                    self._publish(*outcome)

    def flush(self) -> None:
        """Keep and publish at once all that waits; for the end."""
        outcome = self.save()
        while self._waiting:
            with suppress(Exception):  # they are kept; the reason of the end must not be hidden
                self._publish(*outcome)

    def save(self) -> tuple[dict[int, int], str]:
        """Numbers under which events are kept, and the problem that kept them off the disk."""
        try:
            return self._events.save(), ""
        except StoreFailedError as error:
            return {}, str(error)

    def _publish(self, numbers: dict[int, int], problem: str) -> None:
        stored, publish = self._waiting.pop(0)
        kept = [StoredEvent(numbers.get(each.id, each.id), each.event) for each in stored]
        publish(kept, problem)

    async def watch(self, tell: Callable[[Event], None]) -> None:
        """Write what a failing disk did not take, and tell of that and of damage."""
        while True:
            await asyncio.sleep(WATCH_PERIOD_S)
            await self._events.store.run(self.save)
            for event in self.news(now_ns()):
                log.warning("%s", event.text)
                tell(event)

    def news(self, at_ns: int) -> list[Event]:
        """Events of what became of the store since the last call."""
        store, found = self._events.store, list[tuple[str, AxisCondition, str]]()
        problem, before, self._problem = store.problem, self._problem, store.problem
        if problem and not before:
            words = f"nothing can be kept on the disk, and waits in memory: {problem}"
            found.append(("store_failing", AxisCondition.FAULT, words))
        elif before and not problem:
            words = "the disk takes again what is to be kept"
            found.append(("store_recovered", AxisCondition.NORMAL, words))
        damages = store.damages[self._damages :]
        self._damages += len(damages)
        found += [("store_damaged", AxisCondition.WARNING, words) for words in damages]
        return [
            Event(axis="", kind=kind, level=severity, text=words, time_ns=at_ns)
            for kind, severity, words in found
        ]
