"""Events with the states that they led to: kept first, then published, in their order."""

import asyncio
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

from ...clock import now_ns
from ...health.store.events import EventLog, StoredEvent
from ...health.store.states import State
from ...health.store.store import StoreFailedError
from ...messages.event import Event, Severity
from ..supervision.heartbeat import Heartbeat

PATIENCE_S = 2.0
"""So long the disk may hold back what is to be told; then monitoring goes on without it."""
WATCH_PERIOD_S = 1.0
SILENT = "the disk does not answer"
Publish = Callable[[list[StoredEvent], str], None]
"""Takes events that are kept, and the problem that kept them off the disk; empty without."""


@dataclass(slots=True)
class _Batch:
    """Events that are published together."""

    stored: list[StoredEvent]
    publish: Publish
    is_kept: bool

    def tell(self, numbers: dict[int, int], problem: str) -> None:
        kept = [StoredEvent(numbers.get(each.id, each.id), each.event) for each in self.stored]
        self.publish(kept, problem)


class EventDispatcher:
    """A queue: what waits together is written in one transaction, then published."""

    def __init__(self, events: EventLog) -> None:
        self._events = events
        self._waiting: list[_Batch] = []
        self._in_hand: list[_Batch] = []
        self._wake = asyncio.Event()
        self._saving: asyncio.Task[tuple[dict[int, int], str]] | None = None

    def put(self, events: Iterable[Event], publish: Publish, states: Iterable[State] = ()) -> None:
        """Publish events as soon as they are kept with states; never waits."""
        states = tuple(states)
        stored = self._events.put(events, now_ns(), states)
        self._waiting.append(_Batch(stored, publish, bool(stored or states)))
        self._wake.set()

    async def run(self, heart: Heartbeat) -> None:
        """Keep and publish, until cancelled; begun again, it goes on with what was in hand."""
        while True:
            if not self._in_hand:
                with heart.idle(lambda: not self._waiting):
                    await self._wake.wait()
                self._wake.clear()
                self._in_hand, self._waiting = self._waiting, []
            is_kept = any(each.is_kept for each in self._in_hand)
            numbers, problem = await self._saved(heart) if is_kept else ({}, "")
            self._publish(numbers, problem)

    async def watch(self, tell: Callable[[Event], None], heart: Heartbeat) -> None:
        """Write what a failing disk did not take, and tell of that and of damage."""
        watch = StoreWatch(self._events)
        while True:
            await heart.next(WATCH_PERIOD_S)
            await heart.in_thread(partial(try_to_save, self._events))
            for event in watch.news(now_ns()):
                tell(event)

    def flush(self) -> None:
        """Keep and publish at once all that waits; for the end."""
        numbers, problem = try_to_save(self._events)
        while self._in_hand or self._waiting:
            self._publish(numbers, problem)
            self._in_hand, self._waiting = self._waiting, []

    async def _saved(self, heart: Heartbeat) -> tuple[dict[int, int], str]:
        """Outcome of writing all that waits; the problem alone where the disk is silent."""
        patience_s = 0.0
        if self._saving is None or self._saving.done():
            patience_s = PATIENCE_S
            work = self._events.store.run(try_to_save, self._events)
            self._saving = asyncio.ensure_future(work)
        heart.beat(patience_s)
        await asyncio.wait({self._saving}, timeout=patience_s)
        return self._saving.result() if self._saving.done() else ({}, SILENT)

    def _publish(self, numbers: dict[int, int], problem: str) -> None:
        while self._in_hand:
            self._in_hand.pop(0).tell(numbers, problem)


class StoreWatch:
    """Events of what becomes of the store itself."""

    def __init__(self, events: EventLog) -> None:
        self._events = events
        self._problem = ""
        self._damages = 0

    def news(self, at_ns: int) -> Iterator[Event]:
        """Events of what has changed since the last call."""
        store = self._events.store
        problem, before, self._problem = store.problem, self._problem, store.problem
        if problem and not before:
            words = f"nothing can be kept on the disk, and waits in memory: {problem}"
            yield _event("store_failing", Severity.ERROR, words, at_ns)
        elif before and not problem:
            words = "the disk takes again what is to be kept"
            yield _event("store_recovered", Severity.INFO, words, at_ns)
        damages = store.damages[self._damages :]
        self._damages += len(damages)
        for words in damages:
            yield _event("store_damaged", Severity.WARNING, words, at_ns)


def try_to_save(events: EventLog) -> tuple[dict[int, int], str]:
    """Numbers under which events are kept, and the problem that kept them off the disk."""
    try:
        return events.save(), ""
    except StoreFailedError as error:
        return {}, str(error)


def _event(kind: str, severity: Severity, words: str, at_ns: int) -> Event:
    return Event(axis="", kind=kind, severity=severity, message=words, time_ns=at_ns)
