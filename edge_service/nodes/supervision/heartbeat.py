"""Sign of life of one task, and the deadline by which the next one is due."""

import asyncio
import math
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from .thread_work import ThreadWork

_T = TypeVar("_T")
DEADLINE_S = 1.2
"""Longest time without a sign of life; with the period of the looks it is seen within 2 s."""
THREAD_LIMIT_S = 10.0
"""Longest work of a thread, such as a write to the disk."""
_EARLY_SHARE = 0.01
"""Share of a period by which a timer may wake too early, without its turn coming twice."""


class Heartbeat:
    """Sign of life of one task, over all its restarts.

    Args:
        name: of the task, and of its threads.
        clock: monotonic, s.
    """

    def __init__(self, name: str, deadline_s: float, clock: Callable[[], float]) -> None:
        self._name = name
        self._deadline_s = deadline_s
        self._clock = clock
        self._due_s = clock() + deadline_s
        self._idle: Callable[[], bool] | None = None
        self._thread: ThreadWork | None = None
        self._patient_until_s: float | None = None

    def begin(self) -> None:
        """Start a life of the task."""
        self._idle = self._patient_until_s = None
        self.beat()

    def beat(self, quiet_s: float = 0.0) -> None:
        """Say that the task lives, and that it may be silent for `quiet_s` now."""
        self._due_s = self._clock() + quiet_s + self._deadline_s

    @contextmanager
    def idle(self, rightly: Callable[[], bool] = lambda: True) -> Iterator[None]:
        """Wait inside for as long as it takes, while `rightly` says that there is nothing to do."""
        before, self._idle = self._idle, rightly
        try:
            yield
        finally:
            self._idle = before
            self.beat()

    async def sleep(self, seconds: float) -> None:
        """Sleep, announced."""
        self.beat(seconds)
        await asyncio.sleep(seconds)
        self.beat()

    async def next(self, period_s: float) -> None:
        """Sleep to the next multiple of a period on the loop's clock, announced.

        What is done every second is done by all in the same moment: each time that the process
        wakes costs more than most of what it then does.
        """
        now_s = asyncio.get_running_loop().time()
        turn = math.floor(now_s / period_s + _EARLY_SHARE) + 1
        await self.sleep(turn * period_s - now_s)

    async def in_thread(
        self, work: Callable[..., _T], *arguments: object, limit_s: float = THREAD_LIMIT_S
    ) -> _T:
        """Let a thread of its own work; one at a time, also after a restart of the task.

        Cancelling leaves the thread at work: nothing can end it. It holds up nobody else.
        """
        while self._thread is not None and self._thread.at_work:
            await self._thread.wait()
        self._thread = thread = ThreadWork(self._name, self._clock() + limit_s)
        result: _T = await thread.run(work, *arguments)
        self.beat()
        return result

    async def patiently(self, waited: Awaitable[_T], *, limit_s: float = THREAD_LIMIT_S) -> _T:
        """Wait for what hangs on a disk or a peer; beyond the limit that is shown, not ended."""
        self._patient_until_s = self._clock() + limit_s
        try:
            return await waited
        finally:
            self._patient_until_s = None
            self.beat()

    def forgive(self, seconds: float) -> None:
        """The whole loop stood still for so long: no fault of this task."""
        self._due_s += seconds

    def is_late(self, now_s: float) -> bool:
        """Tell whether a sign of life is overdue; a thread at work is one."""
        in_thread = self._thread is not None and self._thread.at_work
        waits = in_thread or self._patient_until_s is not None
        if waits or (self._idle is not None and self._idle()):
            self._due_s = max(self._due_s, now_s + self._deadline_s)
        return now_s > self._due_s

    def is_thread_late(self, now_s: float) -> bool:
        """Tell whether a thread, or what is waited for patiently, takes longer than its limit."""
        if self._patient_until_s is not None and now_s > self._patient_until_s:
            return True
        return self._thread is not None and self._thread.at_work and now_s > self._thread.due_s
