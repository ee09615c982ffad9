"""The supervised tasks of one component, and what it does with messages that it cannot handle."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Iterator
from inspect import isawaitable

from ...bus.subscriber import Subscriber
from ...messages.codec.interface import T
from ...messages.header import Header
from .failures import Failures
from .heartbeat import DEADLINE_S, Heartbeat
from .policy import RestartPolicy
from .task import SupervisedTask, TaskChange, TaskRules, TaskState, Work

log = logging.getLogger(__name__)
_END_S = 10.0
Take = Callable[[str, Header, T], Awaitable[None] | None]


class Tasks:
    """Tasks that live and end with one component.

    Args:
        component: whose tasks they are.
        on_change: told what has changed.
        clock: monotonic, s.
        policy: by which tasks are begun again.
        on_end: told when all have ended.
    """

    def __init__(
        self,
        component: str,
        on_change: Callable[[TaskChange], None],
        clock: Callable[[], float],
        policy: RestartPolicy,
        on_end: Callable[["Tasks"], None],
    ) -> None:
        self.component = component
        self.failures = Failures(self._message_failed, clock)
        self._on_change = on_change
        self._clock = clock
        self._policy = policy
        self._on_end = on_end
        self._tasks: list[SupervisedTask] = []

    def __iter__(self) -> Iterator[SupervisedTask]:
        return iter(tuple(self._tasks))

    def start(
        self,
        name: str,
        work: Work,
        *,
        deadline_s: float = DEADLINE_S,
        may_end: bool = False,
        vital: bool = False,
    ) -> SupervisedTask:
        """Begin a task; `work` is called again whenever it ends or stalls."""
        rules = TaskRules(self._policy, deadline_s, may_end, vital)
        task = SupervisedTask(name, work, rules, self._clock)
        self._tasks.append(task)
        return task

    def follow(
        self, name: str, subscriber: Subscriber[T], take: Take[T], *, vital: bool = False
    ) -> SupervisedTask:
        """Hand axis, header and payload of everything that is heard to `take`.

        An error in one message is counted and told; the next message is handled.
        """

        async def work(heart: Heartbeat) -> None:
            with heart.idle(lambda: subscriber.is_idle):
                async for axis, header, payload in subscriber:
                    heart.beat()
                    with self.failures.borne(name, axis):
                        taken = take(axis, header, payload)
                        if taken is not None:
                            await heart.patiently(taken)

        return self.start(name, work, vital=vital)

    def repeat(
        self,
        name: str,
        period_s: float,
        work: Callable[[], Awaitable[None] | None],
        *,
        vital: bool = False,
    ) -> SupervisedTask:
        """Do something, and again after each period."""

        async def repeated(heart: Heartbeat) -> None:
            while True:
                done = work()
                if isawaitable(done):
                    await heart.patiently(done)
                await heart.next(period_s)

        return self.start(name, repeated, vital=vital)

    def look(self, now_s: float, stood_s: float) -> list[tuple[SupervisedTask, TaskChange]]:
        """Look at every task; what has changed is told and returned."""
        found = []
        for task in self:
            task.heart.forgive(stood_s)
            change = task.look(now_s)
            if change is not None:
                self._tell(change)
                found.append((task, change))
        return found

    @property
    def down(self) -> int:
        """Number of tasks that do not work, or have not yet proven that they do again."""
        return sum(bool(task.fault) for task in self)

    def faults(self) -> list[str]:
        """Problems now, a line for each task, and one for messages."""
        own = [f"{task.name} {task.fault}" for task in self if task.fault]
        return own + self.failures.now()

    @property
    def given_up(self) -> bool:
        """True if a task is begun no more."""
        return any(task.state is TaskState.GIVEN_UP for task in self)

    @property
    def restarts(self) -> int:
        """Restarts of all tasks."""
        return sum(task.restarts.total for task in self)

    async def end(self) -> None:
        """End all tasks."""
        tasks = tuple(self)
        self._tasks.clear()
        self._on_end(self)
        for task in tasks:
            task.end()
        if tasks:
            ended, _ = await asyncio.wait([task.running for task in tasks], timeout=_END_S)
            for each in ended:
                each.cancelled() or each.exception()  # asyncio complains of one nobody looked at

    def _tell(self, change: TaskChange) -> None:
        level = logging.INFO if change.kind == "task_recovered" else logging.WARNING
        log.log(level, "%s: %s %s", self.component, change.task, change.reason)
        with self.failures.borne("report"):  # whoever fails to tell must not end the looks
            self._on_change(change)

    def _message_failed(self, where: str, reason: str) -> None:
        self._tell(TaskChange("message_failed", where, reason, self.restarts))
