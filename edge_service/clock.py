"""The time of day for everything in this process; it does not believe every step of the wall clock.

It goes on with a clock that nobody can set (and that counts a suspended host), and follows the wall
clock: at once where they part little, after a while where that was set. So a year that is wrong for
some seconds is never seen; and whoever keeps times is told by how much a lasting step moved them.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

NS_PER_S = 1_000_000_000
STEP_NS = NS_PER_S
"""From here on a difference is a step: clocks are slewed by less."""
HOLD_S = 30.0
"""A step is followed when it has lasted for so long, s."""
Moved = Callable[[int], None]


def steady_ns() -> int:
    """A clock that never goes back and goes on while the host is suspended, ns."""
    return time.clock_gettime_ns(getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC))


class ServiceClock:
    """UNIX time of this process."""

    def __init__(
        self, wall_ns: Callable[[], int] = time.time_ns, steady_ns: Callable[[], int] = steady_ns
    ) -> None:
        self._wall_ns = wall_ns
        self._steady_ns = steady_ns
        self._base_ns = self._wall_ns() - steady_ns()
        self._newest_ns = 0
        self._step: tuple[int, int] | None = None
        self._listeners: list[Moved] = []

    def now_ns(self) -> int:
        """UNIX time, ns; it goes back with a followed step only."""
        self._newest_ns = max(self._newest_ns, self._base_ns + self._steady_ns())
        return self._newest_ns

    def follow(self) -> None:
        """Look at the wall clock, about once a second; follow it, and tell of a step."""
        now_ns = self._steady_ns()
        ahead_ns = self._wall_ns() - self._base_ns - now_ns
        if abs(ahead_ns) < STEP_NS:
            self._base_ns += ahead_ns
            self._step = None
            return
        if self._step is None or abs(self._step[0] - ahead_ns) >= STEP_NS:
            self._step = ahead_ns, now_ns
        if now_ns - self._step[1] >= HOLD_S * NS_PER_S:
            self._base_ns += ahead_ns
            self._newest_ns, self._step = 0, None
            for moved in tuple(self._listeners):
                moved(ahead_ns)

    @contextmanager
    def telling(self, moved: Moved) -> Iterator[None]:
        """Tell of every followed step, ns, inside: at the moment at which `now_ns` makes it."""
        self._listeners.append(moved)
        try:
            yield
        finally:
            self._listeners.remove(moved)


CLOCK = ServiceClock()
"""That of this process."""


def now_ns() -> int:
    """UNIX time, ns: the one answer to what time it is."""
    return CLOCK.now_ns()
