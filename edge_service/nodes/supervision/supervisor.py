"""Owner of all tasks of a process: looks at them many times a second, and says how they are."""

import asyncio
import time
from collections.abc import Callable, Iterator
from contextlib import suppress

from .loop_lag import LoopLag
from .policy import RestartPolicy
from .task import TaskChange
from .tasks import Tasks

LOOK_PERIOD_S = 0.2
START_S = 60.0
"""A mistake in the configuration ends a service that starts; one that runs goes on without it."""


class TaskGivenUpError(Exception):
    """A task without which the service is of no use has failed too often."""


class Supervisor:
    """All tasks of one process.

    Attributes:
        final: errors that no other try would mend, raised while the service starts.
        start_s: how long that lasts.

    Args:
        clock: monotonic, s.
        policy: by which tasks are begun again.
    """

    def __init__(
        self, clock: Callable[[], float] = time.monotonic, policy: RestartPolicy | None = None
    ) -> None:
        self._policy = policy or RestartPolicy()
        self.final: tuple[type[Exception], ...] = ()
        self.start_s = START_S
        self._clock = clock
        self._started_s = clock()
        self._groups: list[Tasks] = []
        self.lag = LoopLag(clock(), LOOK_PERIOD_S)

    def tasks(
        self, component: str, on_change: Callable[[TaskChange], None] = lambda _change: None
    ) -> Tasks:
        """Tasks of one component, to be ended by whoever asks for them."""
        group = Tasks(component, on_change, self._clock, self._policy, self._forget)
        self._groups.append(group)
        return group

    def _forget(self, group: Tasks) -> None:
        self._groups = [each for each in self._groups if each is not group]

    def __iter__(self) -> Iterator[Tasks]:
        return iter(tuple(self._groups))

    def look(self) -> None:
        """Look at every task once.

        Raises TaskGivenUpError, and what no other try would mend while the service starts.
        """
        now_s = self._clock()
        stood_s = self.lag.look(now_s)
        for group in self:
            for task, change in group.look(now_s, stood_s):
                self._weigh(group, task.rules.vital, change, now_s)

    def _weigh(self, group: Tasks, vital: bool, change: TaskChange, now_s: float) -> None:
        if isinstance(change.error, self.final) and now_s - self._started_s < self.start_s:
            raise change.error
        if vital and change.kind == "task_given_up":
            raise TaskGivenUpError(f"{group.component}: {change.task} {change.reason}")

    def faults(self) -> list[str]:
        """Problems now, a line for each task."""
        return [f"{group.component}: {fault}" for group in self for fault in group.faults()]

    @property
    def is_well(self) -> bool:
        """False while a task has stalled that cannot even be ended: only a new process helps."""
        return not any(task.is_stuck for group in self for task in group)

    async def run(self, until: asyncio.Event, each: Callable[[float], bool]) -> None:
        """Look until the event is set, or `each`, called with the time of every look, says so."""
        self.lag.begin(self._clock())
        while not until.is_set():
            self.look()
            if each(self._clock()):
                return
            with suppress(TimeoutError):
                async with asyncio.timeout(LOOK_PERIOD_S):
                    await until.wait()
