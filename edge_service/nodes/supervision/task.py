"""One supervised task: begun, looked at, ended when it stalls, begun again or given up."""

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from enum import Enum
from typing import Any

from .heartbeat import DEADLINE_S, Heartbeat
from .policy import RestartPolicy, Restarts
from .words import said

Work = Callable[[Heartbeat], Coroutine[Any, Any, None]]
TASK_EVENTS = ("task_failed", "task_recovered", "task_given_up", "message_failed", "loop_stalled")
"""Kinds of events in which a component tells of its tasks."""
PROVEN_S = 3.0
"""A task that was begun again must run for so long before it counts as mended."""
_CANCEL_AGAIN_S = 5.0


class TaskState(Enum):
    """State of a supervised task."""

    RUNNING = "running"
    ENDING = "ending"
    PAUSED = "paused"
    DONE = "done"
    GIVEN_UP = "given up"


@dataclass(frozen=True, slots=True)
class TaskRules:
    """Rules for one task.

    Attributes:
        restarts: how it is begun again.
        deadline_s: longest time without a sign of life.
        may_end: its work may be done some day.
        vital: without it the service does not do what it is for: giving it up ends the process.
    """

    restarts: RestartPolicy
    deadline_s: float = DEADLINE_S
    may_end: bool = False
    vital: bool = False


@dataclass(frozen=True, slots=True)
class TaskChange:
    """Something that a look has found.

    Attributes:
        kind: one of TASK_EVENTS.
        error: what ended the task, if it was an exception.
    """

    kind: str
    task: str
    reason: str
    restarts: int
    error: BaseException | None = None


class SupervisedTask:
    """A task, its sign of life and its restarts; `look` does all the work.

    Args:
        name: of the task within its component.
        work: called for each life of the task.
        clock: monotonic, s.
    """

    def __init__(self, name: str, work: Work, rules: TaskRules, clock: Callable[[], float]) -> None:
        self.name = name
        self.work = work
        self.rules = rules
        self.heart = Heartbeat(name, rules.deadline_s, clock)
        self.restarts = Restarts(rules.restarts)
        self.fault = ""
        self.done = asyncio.Event()
        self._clock = clock
        self.begin()

    def begin(self) -> None:
        """Start a life of the task."""
        self._begun_s = self._at_s = self._cancelled_s = self._clock()
        self.heart.begin()
        self.state = TaskState.RUNNING
        self.running = asyncio.create_task(self.work(self.heart), name=self.name)

    @property
    def is_stuck(self) -> bool:
        """True for a task that has stalled and cannot be ended either."""
        return self.state is TaskState.ENDING and self._clock() - self._at_s > _CANCEL_AGAIN_S

    def look(self, now_s: float) -> TaskChange | None:
        """Look how the task is, and do what is due."""
        if self.state is TaskState.RUNNING:
            return self._look_at_life(now_s)
        if self.state is TaskState.ENDING:
            return self._look_at_end(now_s)
        if self.state is TaskState.PAUSED and now_s >= self._at_s:
            self.begin()
        return None

    def end(self) -> None:
        """Let the task end for good."""
        self.running.cancel()
        self.state = TaskState.DONE

    def _look_at_life(self, now_s: float) -> TaskChange | None:
        if self.running.done():
            return self._ended(now_s)
        if self.heart.is_late(now_s):
            self._cancel(now_s)
            self.state, self._at_s = TaskState.ENDING, now_s
            return self._failed(f"stalled: no sign of life for {self.rules.deadline_s:g} s")
        if self.heart.is_thread_late(now_s):
            return (
                None
                if self.fault
                else self._failed("hangs: check that the disk and the other side answer")
            )
        if self.fault and now_s - self._begun_s >= PROVEN_S:
            self.fault = ""
            return self._change("task_recovered", "works again")
        return None

    def _look_at_end(self, now_s: float) -> TaskChange | None:
        if self.running.done():
            error = None if self.running.cancelled() else self.running.exception()
            return self._pause(now_s, error)
        if now_s - self._cancelled_s > _CANCEL_AGAIN_S:
            self._cancel(now_s)
        return None

    def _cancel(self, now_s: float) -> None:
        self.running.cancel()
        self._cancelled_s = now_s

    def _ended(self, now_s: float) -> TaskChange | None:
        error = None if self.running.cancelled() else self.running.exception()
        if error is None and self.rules.may_end and not self.running.cancelled():
            self.state, self.fault = TaskState.DONE, ""
            self.done.set()
            return None
        failed = self._failed("ended" if error is None else f"ended ({said(error)})", error)
        return self._pause(now_s, error) or failed

    def _pause(self, now_s: float, error: BaseException | None) -> TaskChange | None:
        pause_s = self.restarts.pause_s(now_s - self._begun_s)
        if pause_s is None:
            return self.give_up(error)
        self.state, self._at_s = TaskState.PAUSED, now_s + pause_s
        return None

    def give_up(self, error: BaseException | None) -> TaskChange:
        """Begin it no more."""
        self.state = TaskState.GIVEN_UP
        self.fault = f"given up after {self.restarts.total} restarts: {self.fault}"
        return self._change("task_given_up", self.fault, error)

    def _failed(self, reason: str, error: BaseException | None = None) -> TaskChange:
        self.fault = reason
        return self._change("task_failed", reason, error)

    def _change(self, kind: str, reason: str, error: BaseException | None = None) -> TaskChange:
        return TaskChange(kind, self.name, reason, self.restarts.total, error)
