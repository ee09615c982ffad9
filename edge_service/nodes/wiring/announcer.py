"""Announces events and conditions in their order, each after it is on the disk."""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import Any

from ...health.events.audit import AuditEntry
from ...messages.event import Event
from ...messages.health import AxisHealth
from ..supervision.heartbeat import Heartbeat

PATIENCE_S = 2.0
"""So long the disk may hold back what is to be told; then monitoring goes on without it."""
_SILENT = "the disk does not answer"


@dataclass(slots=True)
class Announcement:
    """Events and condition to be told of one axis.

    Attributes:
        health: condition that goes with the events.
        snapshot: state of the axis that must be kept first; None: the events change none.
        entries: for the audit log.
        intents: for the audit log as well, before anything else is kept.
        told: called when it has been told, with the problem that kept it off the disk.
        order: grows from one announcement to the next.
    """

    axis: str
    events: tuple[Event, ...]
    health: AxisHealth
    snapshot: dict[str, Any] | None = None
    entries: tuple[AuditEntry, ...] = ()
    told: Callable[[str], None] = field(default=lambda _problem: None)
    intents: tuple[AuditEntry, ...] = ()
    order: int = field(default_factory=count().__next__)

    @property
    def must_be_kept(self) -> bool:
        """True if it holds more than the condition as of now."""
        return bool(self.events or self.entries or self.snapshot)


@dataclass(slots=True)
class _Writing:
    """Announcements on their way to the disk, and the problem with it."""

    batch: Sequence[Announcement]
    problem: str = _SILENT
    begun: bool = False
    done: asyncio.Event = field(default_factory=asyncio.Event)


class Announcer:
    """A queue in front of the bus: what waits together is written together, then published.

    Args:
        keep: puts announcements on the disk, in any thread; returns the problem, if any.
        publish: puts one announcement on the bus.
    """

    def __init__(
        self,
        keep: Callable[[Sequence[Announcement]], str],
        publish: Callable[[Announcement], None],
    ) -> None:
        self._keep, self._publish = keep, publish
        self._waiting: list[Announcement] = []
        self._in_hand: list[Announcement] = []  # taken, and not told yet
        self._writing: _Writing | None = None  # of what is in hand
        self._writings: list[_Writing] = []
        self._to_tell, self._to_write = asyncio.Event(), asyncio.Event()

    def put(self, announcement: Announcement) -> None:
        """Announce as soon as it is kept; never waits."""
        self._waiting.append(announcement)
        self._to_tell.set()

    @property
    def idle(self) -> bool:
        """True if nothing waits to be written or told."""
        return not (self._waiting or self._in_hand or self._writings)

    async def announce(self, heart: Heartbeat) -> None:
        """Publish what is kept, until cancelled; begun again, it goes on with what was in hand."""
        while True:
            if not self._in_hand:
                with heart.idle(lambda: not self._waiting):
                    await self._to_tell.wait()
                self._take()
            self._tell(await self._written(heart) if self._writing else "")

    async def write(self, heart: Heartbeat) -> None:
        """Keep what is to be published, until cancelled."""
        while True:
            with heart.idle(lambda: not self._writings):
                await self._to_write.wait()
            self._to_write.clear()
            while self._writings:
                writing = self._writings[0]
                writing.problem = await heart.in_thread(self._keep, writing.batch)
                writing.done.set()
                self._writings.pop(0)

    def flush(self) -> None:
        """Keep and publish at once all that waits; for the end."""
        unwritten = [each for writing in self._writings for each in writing.batch]
        problem = self._keep([*unwritten, *self._waiting])
        self._tell(problem)
        self._take()
        self._tell(problem)

    async def _written(self, heart: Heartbeat) -> str:
        writing = self._writing
        assert writing is not None
        behind = any(other is not writing for other in self._writings)
        patience_s = 0.0 if behind else PATIENCE_S
        if not writing.begun:
            writing.begun = True
            self._writings.append(writing)
            self._to_write.set()
        heart.beat(patience_s)
        try:
            async with asyncio.timeout(patience_s):
                await writing.done.wait()
        except TimeoutError:
            return _SILENT
        return writing.problem

    def _take(self) -> None:
        self._to_tell.clear()
        self._in_hand, self._waiting = self._waiting, []
        kept = [each for each in self._in_hand if each.must_be_kept]
        self._writing = _Writing(kept) if kept else None

    def _tell(self, problem: str) -> None:
        while self._in_hand:
            each = self._in_hand.pop(0)
            self._publish(each)
            each.told(problem)
