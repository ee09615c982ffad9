"""Tries to reach what is away: the one backoff of the service, and an end that counts."""

import asyncio
import random
from collections.abc import Callable, Coroutine
from typing import Any

SHORTENED = 0.25
"""Share by which a pause may be shorter, so that many services do not return at one moment."""


class Retry:
    """Pauses that double from `first_s` to `cap_s`, s, each a little shorter by chance."""

    def __init__(
        self, first_s: float, cap_s: float, chance: Callable[[], float] = random.random
    ) -> None:
        self._first_s, self._cap_s, self._chance = first_s, cap_s, chance
        self._next_s = first_s

    def pause_s(self) -> float:
        """The next pause, s."""
        pause_s, self._next_s = self._next_s, min(2.0 * self._next_s, self._cap_s)
        return pause_s * (1.0 - SHORTENED * self._chance())

    def reset(self) -> None:
        """Begin with the shortest again: it was reached."""
        self._next_s = self._first_s


def heed_cancellation() -> None:
    """Raise CancelledError if the running task was asked to end and is still at it.

    `asyncio.wait_for` of Python 3.11 returns the result instead of being cancelled where both come
    in the same turn of the event loop; a loop around it would go on for ever.
    """
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError


async def all_of(*works: Coroutine[Any, Any, None]) -> None:
    """Await works that go on at once; then raise the first error, if there was one."""
    for result in await asyncio.gather(*works, return_exceptions=True):
        if result is not None:
            raise result
