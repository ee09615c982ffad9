"""One part of the service: its tasks, its status on the bus, and the errors that it bears."""

import asyncio
import logging
import math
import time
import traceback
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import Any

from ..bus.settings import BusConfigurationError
from ..bus.subscriber import Subscriber
from ..clock import now_ns
from ..config import ConfigError
from ..health.store.store import StoreFailedError
from ..http_api.serve import AddressError
from ..messages.codec import Header, T
from ..messages.event import AxisCondition, Event, Statement
from ..messages.health import ComponentHealth, ComponentStatus
from ..messages.topics import EVENT, STATUS
from ..retry import Retry, heed_cancellation
from .context import NodeContext

log = logging.getLogger(__name__)
REPORT_PERIOD_S = 1.0
SHOWN_S, TOLD_AGAIN_S = 5.0, 60.0
"""Time for which the status shows an error in a message, and after which the log repeats it, s."""
PROVEN_S = 3.0
"""Time for which a task begun anew must work before it counts as mended, s."""
_MENDED_BY_PEOPLE = (ConfigError, AddressError, BusConfigurationError)
_SHOWN = (ComponentStatus.STARTING, ComponentStatus.OK, ComponentStatus.RECOVERABLE_ERROR)


class PartFailedError(Exception):
    """A part that the service cannot do without has failed; the text is one line."""


class Component:
    """Tasks of one part of the service, of all axes or of one, and its report once a second.

    What fails ends all tasks of the component, and with them the process, except where `again`
    begins it anew or `bears` counts it.

    Attributes:
        counters, readings: stated in the report.
        problems: lines on what is wrong although the tasks run.
        is_broken: it does not do its work although its tasks run.
    """

    def __init__(self, context: NodeContext, name: str, axis: str | None = None) -> None:
        keys, bus = context.config.keys, context.bus
        self.name, self._axis = name, axis
        self._publisher = bus.publisher(keys.component(name, axis, STATUS), STATUS, axis)
        self._events = bus.publisher(keys.component(name, axis, EVENT), EVENT, axis)
        self._store, self._group = context.store, asyncio.TaskGroup()
        self._tasks: list[asyncio.Task[None]] = []
        self.status, self.reason = ComponentStatus.STARTING, ""
        self.counters: Callable[[], dict[str, int]] = dict
        self.readings: Callable[[], dict[str, float]] = dict
        self.problems: Callable[[], list[str]] = list
        self.is_broken: Callable[[], bool] = lambda: False
        self.restarts = 0
        self._fault, self._mended_s = "", math.inf
        self._failures, self._last_failure = 0, (-math.inf, "")
        self._told_s: dict[str, float] = {}

    def to(self, status: ComponentStatus, reason: str = "") -> None:
        """Enter a status (the same one again only renews the reason) and publish."""
        self.status, self.reason = status, reason
        self.publish()

    def publish(self) -> None:
        """Put the report on the bus."""
        now_s = time.monotonic()
        if now_s >= self._mended_s:
            self._fault, self._mended_s = "", math.inf
        failed_s, failure = self._last_failure
        faults = [self._fault, failure if now_s - failed_s < SHOWN_S else "", *self.problems()]
        faults = [each for each in faults if each]
        status, reason = self.status, self.reason
        if faults and status in _SHOWN:
            status, reason = ComponentStatus.RECOVERABLE_ERROR, "; ".join(faults)
        own = {"task_restarts": self.restarts, "message_failures": self._failures}
        report = ComponentHealth(
            component=self.name,
            axis=self._axis,
            status=status,
            reason=reason,
            counters=self.counters() | own,
            readings=self.readings() | {"tasks_down": float(bool(self._fault) or self.is_broken())},
        )
        self._publisher.publish(report, now_ns())

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Run tasks inside. Raises PartFailedError, or as it is what a person must mend."""
        try:
            async with self._group:
                self.repeat(REPORT_PERIOD_S, self.publish)
                try:
                    yield
                finally:
                    for task in self._tasks:
                        task.cancel()
        except BaseExceptionGroup as group:
            error: BaseException = group
            while isinstance(error, BaseExceptionGroup):
                error = error.exceptions[0]
            if isinstance(error, (*_MENDED_BY_PEOPLE, PartFailedError)):
                raise error from None
            raise PartFailedError(f"{self.name}: {said(error)}") from error
        finally:
            self.to(ComponentStatus.STOPPING)
            self.to(ComponentStatus.STOPPED)

    def start(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        """Begin a task."""
        task = self._group.create_task(work)
        self._tasks = [*(each for each in self._tasks if not each.done()), task]
        return task

    def follow(self, subscriber: Subscriber[T], take: Callable[[str, Header, T], object]) -> None:
        """Hand axis, header and payload of everything that is heard to `take`, and bear errors."""

        async def work() -> None:
            async for axis, header, payload in subscriber:
                with self.bears(f"a message of axis {axis}"):
                    take(axis, header, payload)

        self.start(work())

    def repeat(self, period_s: float, work: Callable[[], Awaitable[None] | None]) -> None:
        """Do something now and at each multiple of a period, so that all wake in one moment."""

        async def repeated() -> None:
            while True:
                waited = work()
                if waited is not None:
                    await waited
                now_s = asyncio.get_running_loop().time()
                turn = math.floor(now_s / period_s + 0.01) + 1  # a timer may wake a little early
                await asyncio.sleep(turn * period_s - now_s)

        self.start(repeated())

    @contextmanager
    def bears(self, what: str) -> Iterator[None]:
        """Bear an error inside: it is counted and told, and goes no further."""
        try:
            yield
        except Exception as error:
            log.debug("%s", self.name, exc_info=True)
            self.note(f"cannot handle {what}", error)

    def note(self, words: str, error: Exception) -> str:
        """Count an error, and log it at most once a minute; returns what is said of it."""
        self._failures += 1
        now_s, line = time.monotonic(), f"{words}: {said(error)}"
        self._last_failure = now_s, line
        if now_s - self._told_s.get(words, -math.inf) >= TOLD_AGAIN_S:
            self._told_s[words] = now_s
            log.warning("%s: %s", self.name, line)
        return line

    async def again(
        self,
        work: Callable[[], Awaitable[None]],
        retry: Retry,
        away: type[Exception],
        final: type[Exception] | tuple[()] = (),
    ) -> None:
        """Do work; begin it anew after errors that are not `final`. `away` is no fault of it."""
        while True:
            begun_s = time.monotonic()
            try:
                return await work()
            except final:
                raise
            except away as error:
                reason = str(error)
                if self.status is not ComponentStatus.RECOVERABLE_ERROR:
                    log.warning("%s: %s; trying again", self.name, reason)
            except Exception as error:
                log.debug("%s", self.name, exc_info=True)
                reason = self._fault = f"failed ({said(error)})"
                log.warning("%s: %s; beginning anew", self.name, reason)
            heed_cancellation()  # while it closed, which may fail in its own way
            if time.monotonic() - begun_s > PROVEN_S:
                retry.reset()
            self.restarts += 1
            self._mended_s = math.inf
            self.to(ComponentStatus.RECOVERABLE_ERROR, reason)
            await asyncio.sleep(retry.pause_s())
            self._mended_s = time.monotonic() + PROVEN_S

    async def from_store(self, work: Callable[[], T]) -> T:
        """Result of work on the store; while that cannot be read, it is waited for, and said."""
        while True:
            try:
                return await self._store.run(work)
            except StoreFailedError as error:
                self.to(ComponentStatus.RECOVERABLE_ERROR, str(error))
                await asyncio.sleep(REPORT_PERIOD_S)

    def tell(self, kind: str, say: Statement, level: AxisCondition = AxisCondition.WARNING) -> None:
        """Tell of a change by an event of the component."""
        log.warning("axis %s: %s", self._axis, say.text)
        event = Event(
            axis=self._axis or "",
            kind=kind,
            level=level,
            time_ns=now_ns(),
            data={"component": self.name},
            **dict(say),
        )
        self._events.publish(event, event.time_ns)


def said(error: BaseException) -> str:
    """Kind, text and place of an error that nobody foresaw, in one line."""
    text = " ".join(str(error).split())[:200]
    frames = traceback.extract_tb(error.__traceback__)
    place = f" at {frames[-1].filename.rpartition('/')[2]}:{frames[-1].lineno}" if frames else ""
    return f"{type(error).__name__}{': ' if text else ''}{text}{place}"
