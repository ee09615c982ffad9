"""Daemon threads for one kind of work each: what hangs holds up nothing of another kind."""

import asyncio
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any, ParamSpec, TypeVar

Given = ParamSpec("Given")
T = TypeVar("T")
U = TypeVar("U")
IDLE_S = 10.0
"""Time after which a thread without work ends."""
_Work = tuple[Callable[[], Any], "Future[Any]"]


class Threads:
    """Threads that begin when there is work; neither a process nor its end waits for them."""

    def __init__(self, name: str, most: int = 1) -> None:
        self._name, self._most = name, most
        self._waiting: deque[_Work] = deque()
        self._changed = threading.Condition()
        self._alive = self._busy = 0

    async def run(self, work: Callable[Given, T], *args: Given.args, **kwargs: Given.kwargs) -> T:
        """Result of the work, or its error. Being cancelled leaves a thread at work."""
        done: Future[T] = Future()
        with self._changed:
            self._waiting.append((partial(work, *args, **kwargs), done))
            if self._alive < self._most and len(self._waiting) > self._alive - self._busy:
                self._alive += 1
                threading.Thread(target=self._serve, name=self._name, daemon=True).start()
            self._changed.notify()
        return await asyncio.wrap_future(done)

    def _serve(self) -> None:
        while (each := self._next()) is not None:
            work, done = each
            if done.set_running_or_notify_cancel():
                try:
                    done.set_result(work())
                except BaseException as error:  # noqa: BLE001
                    done.set_exception(error)
            with self._changed:
                self._busy -= 1

    def _next(self) -> _Work | None:
        """The next work; None if none comes for a while: the thread has ended then."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._waiting, IDLE_S):
                self._alive -= 1
                return None
            self._busy += 1
            return self._waiting.popleft()


def in_threads(
    work: Callable[[U], T], items: Iterable[U], most: int | None = os.cpu_count()
) -> list[T]:
    """Results of work that frees the interpreter, on all processors, in the order of the items."""
    with ThreadPoolExecutor(most) as pool:
        return list(pool.map(work, items))


def repeating(period_s: float, work: Callable[[], None]) -> Callable[[], None]:
    """Do something from time to time in the background; returns what ends it."""
    stop = threading.Event()

    def repeat() -> None:
        while not stop.wait(period_s):
            work()

    threading.Thread(target=repeat, name="repeating", daemon=True).start()
    return stop.set
