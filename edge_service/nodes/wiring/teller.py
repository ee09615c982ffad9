"""Tells events to whoever listens, each after it is in the diary."""

import asyncio
from collections import deque
from collections.abc import Callable

from ...clock import now_ns
from ...health.events.diary import Diary
from ...health.events.log import LoggedEvent
from ...messages.event import Event
from ..supervision.heartbeat import Heartbeat

MOST_WAITING = 10_000
"""Events that may wait for a disk that does not answer; then the oldest go, counted."""


class Teller:
    """A queue of events that were heard.

    Args:
        tell: hands an event that is kept to live readers and outputs.
    """

    def __init__(self, diary: Diary, tell: Callable[[LoggedEvent], None]) -> None:
        self._diary, self._tell = diary, tell
        self._waiting: deque[Event] = deque(maxlen=MOST_WAITING)
        self._wake = asyncio.Event()
        self.dropped = 0

    def put(self, event: Event) -> None:
        """Tell of an event as soon as it is kept; never waits."""
        self.dropped += len(self._waiting) == MOST_WAITING
        self._waiting.append(event)
        self._wake.set()

    async def run(self, heart: Heartbeat) -> None:
        """Keep events and tell them, until cancelled."""
        while True:
            with heart.idle(lambda: not self._waiting):
                await self._wake.wait()
            self._wake.clear()
            while self._waiting:
                batch = tuple(self._waiting)
                kept = await heart.in_thread(self._diary.add, batch, now_ns())
                for logged in kept:
                    self._tell(logged)
                for _ in batch:
                    self._waiting.popleft()
