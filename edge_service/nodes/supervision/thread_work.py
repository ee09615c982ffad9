"""One piece of work in a thread of its own, which may hang without holding up anybody else."""

import asyncio
import threading
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Any


class ThreadWork:
    """One piece of work in a daemon thread: neither a pool nor the end of the process waits for it.

    Args:
        due_s: when it is overdue, s of the clock of whoever looks.
    """

    def __init__(self, name: str, due_s: float) -> None:
        self.due_s = due_s
        self._name = name
        self._loop = asyncio.get_running_loop()
        self._done: asyncio.Future[Any] = self._loop.create_future()
        self._done.add_done_callback(_noted)

    @property
    def at_work(self) -> bool:
        """True until it is done."""
        return not self._done.done()

    async def run(self, work: Callable[..., Any], *arguments: object) -> Any:
        """Do the work; returns, or raises, what it does."""
        outcome = _Outcome()

        def do() -> None:
            with outcome:
                outcome.value = work(*arguments)
            with suppress(RuntimeError):  # the loop is closed: nobody wants to know
                self._loop.call_soon_threadsafe(self._deliver, outcome)

        threading.Thread(target=do, name=self._name, daemon=True).start()
        await self.wait()
        return self._done.result()

    async def wait(self) -> None:
        """Wait for its end; being cancelled changes nothing for the thread."""
        await asyncio.wait([self._done])

    def _deliver(self, outcome: "_Outcome") -> None:
        if outcome.error is not None:
            self._done.set_exception(outcome.error)
        else:
            self._done.set_result(outcome.value)


class _Outcome:
    """Outcome of the work: a value, or the error that ended it."""

    value: Any = None
    error: BaseException | None = None

    def __enter__(self) -> None:
        pass

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        error: BaseException | None,
        _where: TracebackType | None,
    ) -> bool:
        self.error = RuntimeError("no more") if isinstance(error, StopIteration) else error
        return True


def _noted(done: "asyncio.Future[Any]") -> None:
    """Look at an error, or asyncio complains of one that nobody waited for."""
    if not done.cancelled():
        done.exception()
