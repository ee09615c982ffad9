"""Events that came into the diary and, as the service ended then, to no output on the bus."""

import time
from collections.abc import Iterable

from ...bus.spool.spool import Spool
from ...clock import now_ns
from ...health.store.events import EventLog
from ...messages.event import Event
from ...messages.header import Header
from ...messages.topics import EVENT
from ...threads import Threads
from ..supervision.task import TASK_EVENTS

_MOST_MISSED, _NEAR = 10_000, 200


class MissedEvents:
    """Puts events of axes into a spool that also hears them on the bus, and none of them twice.

    Args:
        axes: whose events are wanted.
    """

    def __init__(self, diary: EventLog, spool: Spool, axes: Iterable[str]) -> None:
        self._diary, self._spool, self._axes = diary, spool, frozenset(axes)
        self._mark = spool.mark
        self._thread = Threads("missed events")

    async def put(self) -> None:
        """Put what was missed before this start; a new spool has missed nothing."""
        last_id = self._diary.last_id()
        if self._mark:
            found = await self._thread.run(self._diary.after, self._mark, _MOST_MISSED)
            epoch_ns = now_ns()
            for sequence, logged in enumerate(found):
                event = logged.event
                if event.axis in self._axes and event.kind not in TASK_EVENTS:
                    header = Header(sequence, epoch_ns, event.time_ns, time.monotonic_ns())
                    said = EVENT.encode(event.axis, header, event)
                    self._spool.put_soon(f"{event.axis}/{EVENT.name}", said, mark=logged.id)
        self._mark = max(self._mark, last_id)
        await self._spool.set_mark(self._mark)

    async def number(self, event: Event) -> int:
        """Number of an event that was heard; 0 if this process' diary does not know it."""
        for logged in await self._thread.run(self._diary.after, self._mark, _NEAR):
            if logged.event == event:
                self._mark = logged.id
                return logged.id
        return 0
