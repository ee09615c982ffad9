"""Events and changes for any number of live readers, none of which can hold up the service.

Everything here runs in the thread of one event loop.
"""

import asyncio
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from ...messages.event import Event
from .events import StoredEvent


@dataclass(frozen=True, slots=True)
class Batch:
    """Events and changes that a reader has not seen yet.

    Attributes:
        lost: events dropped because the reader was too slow.
        events: events, oldest first.
        changed: (topic, axis) of which there is a newer value on the state.
    """

    lost: int
    events: tuple[StoredEvent, ...]
    changed: tuple[tuple[str, str], ...]


def concerns(event: Event, axis: str | None) -> bool:
    """True of an event that is for readers of `axis` (None: of all axes)."""
    return axis is None or event.axis in ("", axis)


class Subscription:
    """The backlog of one reader, of bounded size.

    Of preload and health only *that* they changed is kept, once per axis: a slow reader skips to
    the newest value. Events are kept each, up to a number; then the oldest are dropped and counted.
    """

    def __init__(self, capacity: int, axis: str | None = None) -> None:
        self.axis = axis
        self._events: deque[StoredEvent] = deque(maxlen=capacity)
        self._changed: dict[tuple[str, str], None] = {}
        self._lost = 0
        self._wake = asyncio.Event()
        self.closed = False

    def put_event(self, stored: StoredEvent) -> None:
        """Hand over an event; those of other axes than the reader's are skipped."""
        if not concerns(stored.event, self.axis):
            return
        if len(self._events) == self._events.maxlen:
            self._lost += 1
        self._events.append(stored)
        self._wake.set()

    def mark(self, topic: str, axis: str) -> None:
        """Say that there is a newer value."""
        if self.axis in (None, axis):
            self._changed[topic, axis] = None
            self._wake.set()

    def close(self) -> None:
        """Wake the reader for the last time."""
        self.closed = True
        self._wake.set()

    @property
    def backlog(self) -> int:
        """Entries waiting for the reader."""
        return len(self._events) + len(self._changed)

    async def next(self, timeout_s: float) -> Batch:
        """Wait for news, at most `timeout_s`, and hand out all of them."""
        try:
            async with asyncio.timeout(timeout_s):
                await self._wake.wait()
        except TimeoutError:
            pass
        batch = Batch(self._lost, tuple(self._events), tuple(self._changed))
        self._lost = 0
        self._events.clear()
        self._changed.clear()
        if not self.closed:
            self._wake.clear()
        return batch


class FanOut:
    """All live readers."""

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._subscriptions: set[Subscription] = set()
        self._closed = False

    def __len__(self) -> int:
        return len(self._subscriptions)

    @contextmanager
    def subscribe(self, axis: str | None = None) -> Iterator[Subscription]:
        """A reader's subscription for as long as the context lasts."""
        subscription = Subscription(self._capacity, axis)
        if self._closed:
            subscription.close()
        self._subscriptions.add(subscription)
        try:
            yield subscription
        finally:
            self._subscriptions.discard(subscription)

    def put_event(self, stored: StoredEvent) -> None:
        """Hand an event to every reader."""
        for subscription in self._subscriptions:
            subscription.put_event(stored)

    def mark(self, topic: str, axis: str) -> None:
        """Tell every reader that there is a newer value."""
        for subscription in self._subscriptions:
            subscription.mark(topic, axis)

    def open(self) -> None:
        """Let streams begin again."""
        self._closed = False

    def close(self) -> None:
        """End all streams, now and until `open`."""
        self._closed = True
        for subscription in self._subscriptions:
            subscription.close()
