"""Report of an output on itself: the other side, and the disk on which messages wait for it."""

import logging
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from ...bus.spool.spool import Spool
from ...messages.health import ComponentStatus
from ..supervision.tasks import Tasks
from ..wiring.context import NodeContext, Reporter

log = logging.getLogger(__name__)
_PERIOD_S = 1.0


class OutputReport:
    """Component status of an output, from what is wrong with the other side or with the disk."""

    def __init__(self, context: NodeContext, name: str) -> None:
        self._name = name
        self._known = False
        self._problem = ""
        self._spool: Spool | None = None
        self.reporter = Reporter(context, name)

    def watch(self, spool: Spool, counters: Callable[[], dict[str, int]]) -> None:
        """Report on a spool as well, with further counters."""
        self._spool = spool
        self.reporter.counters = lambda: (
            counters() | {"dropped": spool.dropped, "damaged": spool.damaged}
        )
        self.reporter.readings = lambda: {"waiting": len(spool), "dead_letters": spool.dead}

    def tell(self, problem: str) -> None:
        """Take in what is wrong with the other side; "" if nothing is."""
        self._known = True
        self._problem = problem
        self.look()

    def look(self) -> None:
        """Report what has changed."""
        disk = "" if self._spool is None else self._spool.problem
        problem = self._problem or (disk and f"the disk takes nothing ({disk}); kept in memory")
        if problem:
            if self.reporter.status is not ComponentStatus.RECOVERABLE_ERROR:
                log.warning("%s: %s; what is to be sent is kept", self._name, problem)
            self.reporter.to(ComponentStatus.RECOVERABLE_ERROR, problem)
        elif self._known and self.reporter.status is not ComponentStatus.OK:
            log.info("%s: all is well", self._name)
            self.reporter.to(ComponentStatus.OK)

    @asynccontextmanager
    async def running(self) -> AsyncIterator[Tasks]:
        """Own the tasks of the output inside, and report on it."""
        async with self.reporter.running() as tasks:
            tasks.repeat("disk", _PERIOD_S, self.look)
            yield tasks
