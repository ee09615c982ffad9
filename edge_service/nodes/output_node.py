"""One output as a node: hands it what holds now of every axis, and events from its outbox."""

import asyncio
import logging
import time
from collections import deque
from collections.abc import Coroutine, Sequence
from functools import partial
from typing import Any

from ..clock import now_ns
from ..config import ConfigError, EdgeConfig, check_settings
from ..health.store.events import StoredEvent
from ..health.store.outbox import Outbox
from ..health.store.store import Store, StoreFailedError
from ..http_api.words import words_in
from ..messages.event import Event, Severity
from ..messages.health import ComponentStatus
from ..outputs.base import (
    Events,
    Message,
    Output,
    OutputContext,
    OutputMisconfiguredError,
    OutputUnavailableError,
    RefusedError,
    UnknownOutputError,
    load_output,
)
from ..retry import Retry
from .outputs.latest_answers import LatestAnswers
from .supervision.heartbeat import Heartbeat
from .wiring.context import NodeContext, Reporter
from .wiring.http_rights import knows_of

SHOW_PERIOD_S = 0.5
TAKE_S = 30.0
"""Longest time in which an output takes a message."""
FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 60.0
MOST_TOGETHER = 100
"""Events that are handed over together, at most."""
MOST_BROKEN = 5
"""Times that a connection may break at one event, while it takes other messages in between."""
log = logging.getLogger(__name__)


def make_output(config: EdgeConfig, name: str, *, is_test: bool = False) -> Output:
    """The output of a table, its settings checked. Raises ConfigError."""
    table, place = config.outputs[name], config.place(f"outputs.{name}")
    try:
        kind = load_output(table.get("kind") or name)
    except UnknownOutputError as error:
        raise ConfigError(f"{place}: {error}") from None
    settings = check_settings(kind.config_model, table, place)
    context = OutputContext(
        name=name,
        site=config.service.site,
        machine=config.service.machine,
        axes=tuple(axis.name for axis in config.axes),
        folder=config.store.folder,
        knows=knows_of(config),
        words=words_in,
        is_test=is_test,
    )
    try:
        return kind(settings, context)
    except OutputMisconfiguredError as error:
        raise ConfigError(f"{place}.{error}") from None


def outbox_of(store: Store, output: Output, receiver: str) -> Outbox:
    """Queue of the events for one receiver of an output."""
    name = output.context.name
    return Outbox(store, f"{name}/{receiver}" if receiver else name, output.kinds)


async def run(context: NodeContext, name: str) -> None:
    """Tell one output until cancelled. Raises ConfigError for what cannot work."""
    output, latest = make_output(context.config, name), LatestAnswers(context)
    reporter = Reporter(context, name)
    sender = Sender(output, reporter)
    try:
        async with reporter.running() as tasks:
            if output.takes_answers:
                latest.follow(tasks)
                tasks.start("answers", partial(show, sender, latest))
            for receiver in output.receivers:
                work = partial(deliver, sender, context.store, output, receiver)
                tasks.start(f"events {receiver}".strip(), work)
            await context.forever()
    finally:
        await output.close()


class Sender:
    """Hands messages to an output that may be away or hang, and reports on it.

    Attributes:
        sent: messages that it took.
    """

    def __init__(self, output: Output, reporter: Reporter) -> None:
        self._output, self._reporter = output, reporter
        self._opening = asyncio.Lock()
        self._problems: dict[str, str] = {}
        self._sent_s = time.monotonic()
        self.sent = 0
        reporter.problems = lambda: list(self._problems.values())
        reporter.readings = self._readings
        reporter.counters = lambda: {"sent": self.sent}

    def _readings(self) -> dict[str, float]:
        age = {"age_s": time.monotonic() - self._sent_s} if self._output.takes_answers else {}
        return self._output.readings | age

    async def send(self, who: str, message: Message, heart: Heartbeat, retry: Retry) -> bool:
        """Hand a message over; False, after a pause, if the other side is away.

        Raises RefusedError.
        """
        output = self._output
        try:
            async with self._opening:
                opening = within(output.open_s, output.open())
                await heart.patiently(opening, limit_s=2.0 * output.open_s)
            await heart.patiently(within(TAKE_S, output.take(message)), limit_s=2.0 * TAKE_S)
        except OutputUnavailableError as error:
            await self.wait(who, str(error), heart, retry)
            return False
        finally:
            if self._reporter.status is not ComponentStatus.OK:
                self._reporter.to(ComponentStatus.OK)
        self.sent += 1
        self._sent_s = time.monotonic()
        self.works(who, retry)
        return True

    def works(self, who: str, retry: Retry) -> None:
        """Note that there is no problem any more."""
        retry.reset()
        if self._problems.pop(who, None) is not None:
            log.info("%s: works again", self._output.context.name)
            self._reporter.publish()

    async def wait(self, who: str, problem: str, heart: Heartbeat, retry: Retry) -> None:
        """Tell of a problem, and pause."""
        if who not in self._problems:
            log.warning("%s: %s; trying again", self._output.context.name, problem)
        self._problems[who] = problem
        self._reporter.publish()
        await heart.sleep(retry.pause_s())


async def within(limit_s: float, work: Coroutine[Any, Any, None]) -> None:
    """Await what the other side may hold up for ever. Raises OutputUnavailableError."""
    try:
        async with asyncio.timeout(limit_s):
            await work
    except TimeoutError:
        raise OutputUnavailableError(f"no answer within {limit_s:g} s") from None


async def show(sender: Sender, latest: LatestAnswers, heart: Heartbeat) -> None:
    """Hand over what is known now of all axes, again and again."""
    retry = Retry(FIRST_PAUSE_S, LONGEST_PAUSE_S)
    while True:
        for answer in latest.now():
            if not await sender.send("answers", answer, heart, retry):
                break
        else:
            await heart.sleep(SHOW_PERIOD_S)


async def deliver(
    sender: Sender, store: Store, output: Output, receiver: str, heart: Heartbeat
) -> None:
    """Hand over the events of an outbox in their order; what is refused holds up nobody."""
    outbox, retry = outbox_of(store, output, receiver), Retry(FIRST_PAUSE_S, LONGEST_PAUSE_S)
    hour: deque[float] = deque()
    broken, sent_before = 0, 0
    while True:
        try:
            stored = await heart.patiently(store.run(outbox.waiting, MOST_TOGETHER))
            batch = due(output, stored, hour)
            if not batch:
                await heart.sleep(SHOW_PERIOD_S)
                continue
            message = Events(receiver, tuple(each.event for each in batch))
            refusal = ""
            try:
                if not await sender.send(f"events {receiver}", message, heart, retry):
                    broken += sender.sent > sent_before
                    sent_before = sender.sent
                    if broken < MOST_BROKEN:
                        continue
                    refusal = f"the connection broke at it {broken} times"
            except RefusedError as error:
                refusal = str(error)
                sender.works(f"events {receiver}", retry)
            broken, sent_before = 0, sender.sent
            if output.most_per_hour is not None:
                hour.append(time.monotonic())
            for each in batch:
                if refusal:
                    name = output.context.name
                    log.warning("%s: event %d is a dead letter: %s", name, each.id, refusal)
                    await heart.patiently(store.run(outbox.refused, each.id, refusal))
                else:
                    await heart.patiently(store.run(outbox.delivered, each.id))
        except StoreFailedError as error:
            await sender.wait(f"events {receiver}", str(error), heart, retry)


def due(output: Output, waiting: Sequence[StoredEvent], hour: deque[float]) -> list[StoredEvent]:
    """Events that are handed over together now; none while they are gathered.

    Args:
        hour: monotonic times at which some were handed over, s.
    """
    if not waiting or not output.gather_s:
        return list(waiting[:1])
    now_s = time.monotonic()
    while hour and now_s - hour[0] > 3600.0:
        hour.popleft()
    is_full = output.most_per_hour is not None and len(hour) >= output.most_per_hour
    age_s = (now_ns() - waiting[0].event.time_ns) / 1e9
    return [] if is_full or 0.0 <= age_s < output.gather_s else list(waiting)


async def send_test(config: EdgeConfig, name: str) -> dict[str, str]:
    """Problem of each receiver of an output that was sent a test message, "" without one.

    Empty where the output takes no events. Raises ConfigError.
    """
    output = make_output(config, name, is_test=True)
    message = "a test message of the edge service; nothing has happened"
    test = Event(axis="", kind="test", severity=Severity.ERROR, message=message, time_ns=now_ns())
    problems = {}
    for receiver in output.receivers:
        problems[receiver] = ""
        try:
            await within(output.open_s, output.open())
            await within(TAKE_S, output.take(Events(receiver, (test,))))
        except (OutputUnavailableError, RefusedError) as error:
            problems[receiver] = str(error)
        finally:
            await output.close()
    return problems
