"""One process and its nodes: what it says of itself on the bus and to systemd."""

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace

from ...messages.health import ComponentStatus
from ..supervision.task import TaskChange
from ..supervision.tasks import Tasks
from ..supervision.watchdog import Watchdog
from .context import NodeContext, Reporter


class Process:
    """A process of one or more nodes.

    Args:
        component: name under which it reports.
        serves: it is ready when its page is, and not at once.
        watchdog: who is told how it goes.
    """

    def __init__(
        self, context: NodeContext, component: str, *, serves: bool, watchdog: Watchdog
    ) -> None:
        self._supervisor = context.supervisor
        self._reporter = Reporter(context, component)
        self._reporter.readings = lambda: {"loop_lag_s": self._supervisor.lag.worst_s}
        self._reporter.problems = lambda: [fault] if (fault := self._supervisor.lag.fault) else []
        self._tell_url: Callable[[str], None] = context.on_http_ready
        self._ready = not serves
        self._watchdog = watchdog
        self.context = replace(context, on_http_ready=self._served)
        """For its nodes."""

    @asynccontextmanager
    async def running(self) -> AsyncIterator[Tasks]:
        """Own the nodes inside."""
        async with self._reporter.running() as tasks:
            self._reporter.to(ComponentStatus.OK)
            try:
                yield tasks
            finally:
                self._watchdog.stopping()

    def look(self, now_s: float) -> None:
        """Say how it goes; after every look at the tasks."""
        lag = self._supervisor.lag
        if lag.is_to_be_told(now_s):
            self._reporter.tell(TaskChange("loop_stalled", "loop", lag.fault, 0))
        faults = [*self._supervisor.faults(), *([lag.fault] if lag.fault else [])]
        self._watchdog.look(
            now_s,
            ready=self._ready,
            well=self._supervisor.is_well,
            status="; ".join(faults) or "all tasks are running",
        )

    def _served(self, url: str) -> None:
        self._ready = True
        self._tell_url(url)
