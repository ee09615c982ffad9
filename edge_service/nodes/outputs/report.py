"""Report of an output on itself: the other side, and the disk on which messages wait for it."""

import logging
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from ...bus.spool.spool import Spool
from ...messages.health import ComponentStatus
from ..supervision.tasks import Tasks
from ..wiring.context import NodeContext, Reporter

log = logging.getLogger(__name__)


class OutputReport:
    """Component status of an output, from what is wrong with the other side or with the disk."""

    def __init__(self, context: NodeContext, name: str) -> None:
        self._name = name
        self._reporter = Reporter(context, name)

    def watch(self, spool: Spool, counters: Callable[[], dict[str, int]]) -> None:
        """Report on a spool as well, with further counters."""

        def problems() -> list[str]:
            problem = spool.problem
            return [f"the disk accepts no data ({problem}); kept in memory"] if problem else []

        self._reporter.problems = problems
        self._reporter.counters = lambda: (
            counters() | {"dropped": spool.dropped, "damaged": spool.damaged}
        )
        self._reporter.readings = lambda: {"waiting": len(spool), "dead_letters": spool.dead}

    def tell(self, problem: str) -> None:
        """Take in what is wrong with the other side; "" if nothing is."""
        status = self._reporter.status
        if problem:
            if status is not ComponentStatus.RECOVERABLE_ERROR:
                log.warning("%s: %s; messages are kept until they can be sent", self._name, problem)
            self._reporter.to(ComponentStatus.RECOVERABLE_ERROR, problem)
        elif status is not ComponentStatus.OK:
            log.info("%s: works again", self._name)
            self._reporter.to(ComponentStatus.OK)

    @asynccontextmanager
    async def running(self) -> AsyncIterator[Tasks]:
        """Own the tasks of the output inside, and report on it."""
        async with self._reporter.running() as tasks:
            yield tasks
