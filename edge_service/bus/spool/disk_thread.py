"""One thread for one file: work is done in order, and a disk that hangs holds up nobody else."""

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any, TypeVar

from ...threads import Outcome

T = TypeVar("T")
_CLOSE_S = 5.0


class DiskThread:
    """A daemon thread that does one piece of work after the other; no process waits for its end."""

    def __init__(self, name: str) -> None:
        self._work: SimpleQueue[tuple[Callable[[], Any], Future[Any]] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def do(self, work: Callable[[], T]) -> "asyncio.Future[T]":
        """Let work be done, also if nobody waits for it; what it returns or raises."""
        return asyncio.wrap_future(self._put(work))

    def close(self, last: Callable[[], None]) -> None:
        """Do what waits and one thing more; a disk that hangs is not waited for. Safe twice."""
        if self._thread.is_alive():
            self._put(last)
            self._work.put(None)
            self._thread.join(_CLOSE_S)

    def _put(self, work: Callable[[], T]) -> Future[T]:
        done: Future[T] = Future()
        done.set_running_or_notify_cancel()  # whoever ceases to wait does not undo it
        self._work.put((work, done))
        return done

    def _run(self) -> None:
        while (each := self._work.get()) is not None:
            work, done = each
            with Outcome(done):
                done.set_result(work())
