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
    """What is to be told of one axis.

    Attributes:
        health: condition that goes with the events.
        snapshot: state of the axis that must be kept first; None: the events change none.
        entries: for the audit log.
        told: called when it has been told, with the problem that kept it off the disk.
        order: grows from one announcement to the next.
    """

    axis: str
    events: tuple[Event, ...]
    health: AxisHealth
    snapshot: dict[str, Any] | None = None
    entries: tuple[AuditEntry, ...] = ()
    told: Callable[[str], None] = field(default=lambda _problem: None)
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
        self._writings: list[_Writing] = []
        self._to_tell, self._to_write = asyncio.Event(), asyncio.Event()

    def put(self, announcement: Announcement) -> None:
        """Announce as soon as it is kept; never waits."""
        self._waiting.append(announcement)
        self._to_tell.set()

    async def announce(self, heart: Heartbeat) -> None:
        """Publish what is kept, until cancelled."""
        while True:
            with heart.idle():
                await self._to_tell.wait()
            batch = self._taken()
            kept = [each for each in batch if each.must_be_kept]
            self._tell(batch, await self._written(kept, heart) if kept else "")

    async def write(self, heart: Heartbeat) -> None:
        """Keep what is to be published, until cancelled."""
        while True:
            with heart.idle():
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
        batch = self._taken()
        self._tell(batch, self._keep([*unwritten, *batch]))

    async def _written(self, batch: Sequence[Announcement], heart: Heartbeat) -> str:
        patience_s = 0.0 if self._writings else PATIENCE_S
        writing = _Writing(batch)
        self._writings.append(writing)
        self._to_write.set()
        heart.beat(patience_s)
        try:
            async with asyncio.timeout(patience_s):
                await writing.done.wait()
        except TimeoutError:
            return _SILENT
        return writing.problem

    def _taken(self) -> list[Announcement]:
        self._to_tell.clear()
        batch, self._waiting = self._waiting, []
        return batch

    def _tell(self, batch: Sequence[Announcement], problem: str) -> None:
        for each in batch:
            self._publish(each)
            each.told(problem)
