"""Events and changes for any number of live readers, none of which can hold up the service.

Everything here runs in the thread of one event loop.
"""

import asyncio
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import NamedTuple

from ...messages.event import Event
from .events import StoredEvent


class Batch(NamedTuple):
    """Events that a reader lost, being too slow, and has not seen yet; (topic, axis) changed."""

    lost: int
    events: tuple[StoredEvent, ...]
    changed: tuple[tuple[str, str], ...]


def concerns(event: Event, axis: str | None) -> bool:
    """Return whether an event is for readers of `axis` (None: of all axes)."""
    return axis is None or event.axis in ("", axis)


class Subscription:
    """The backlog of one reader, of bounded size.

    Of preload and health only *that* they changed is kept, once per axis: a slow reader skips to
    the newest value. Events are kept each, up to a number; then the oldest are dropped and counted.
    """

    def __init__(self, capacity: int, axis: str | None) -> None:
        self.axis = axis
        self.events: deque[StoredEvent] = deque(maxlen=capacity)
        self.changed: dict[tuple[str, str], None] = {}
        self.lost = 0
        self.wake = asyncio.Event()
        self.closed = False

    async def next(self, timeout_s: float) -> Batch:
        """Wait for news, at most `timeout_s`, and hand out all of them."""
        with suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                await self.wake.wait()
        batch = Batch(self.lost, tuple(self.events), tuple(self.changed))
        self.lost = 0
        self.events.clear()
        self.changed.clear()
        if not self.closed:
            self.wake.clear()
        return batch


class FanOut:
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
        self._subscriptions.add(subscription)
        if self._closed:
            self.close()
        try:
            yield subscription
        finally:
            self._subscriptions.discard(subscription)

    def put_event(self, stored: StoredEvent) -> None:
        """Hand an event to every reader that it concerns."""
        for each in self._subscriptions:
            if concerns(stored.event, each.axis):
                each.lost += len(each.events) == each.events.maxlen
                each.events.append(stored)
                each.wake.set()

    def mark(self, topic: str, axis: str) -> None:
        """Tell every reader that there is a newer value."""
        for each in self._subscriptions:
            if each.axis in (None, axis):
                each.changed[topic, axis] = None
                each.wake.set()

    def open(self) -> None:
        """Let streams begin again."""
        self._closed = False

    def close(self) -> None:
        """End all streams, now and until `open`."""
        self._closed = True
        for each in self._subscriptions:
            each.closed = True
            each.wake.set()
