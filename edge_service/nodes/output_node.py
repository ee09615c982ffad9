"""One output as a node: hands it what holds now of every axis, and events from its outbox."""

import asyncio
import logging
import time
from collections import deque
from collections.abc import Coroutine, Iterable, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any

from ..clock import now_ns
from ..config import ConfigError, EdgeConfig, check_settings
from ..health.components import ComponentWatch
from ..health.service_state import AxisState
from ..health.store.events import EventLog, StoredEvent
from ..health.store.outbox import Outbox
from ..health.store.store import StoreFailedError
from ..http_api.app import words_in
from ..messages.answer import AxisAnswer
from ..messages.codec import Header, Topic
from ..messages.event import AxisCondition, Event
from ..messages.health import ComponentStatus
from ..messages.topics import HEALTH, IMM, PRELOAD, STATUS
from ..outputs.base import (
    Events,
    Message,
    Output,
    OutputContext,
    OutputUnavailableError,
    RefusedError,
    load_output,
)
from ..plugins import MisconfiguredError, UnknownPluginError
from ..retry import Retry, all_of, heed_cancellation
from .component import Component
from .context import NodeContext
from .http_rights import knows_of

log = logging.getLogger(__name__)
SHOW_PERIOD_S = 0.5
TAKE_S = 30.0
"""Longest time in which an output takes a message."""
new_retry = partial(Retry, 1.0, 60.0)
MOST_TOGETHER = 100
"""Events that are handed over together, at most."""
MOST_BROKEN = 5
"""Times that a connection may break at one event, while it takes other messages in between."""


def make_output(
    config: EdgeConfig, name: str, gone: Iterable[str] = (), *, is_test: bool = False
) -> Output:
    """The output of a table, its settings checked; axes may be `gone`. Raises ConfigError."""
    table, place = config.outputs[name], config.place_of(f"outputs.{name}")
    try:
        kind = load_output(table.get("kind") or name)
    except UnknownPluginError as error:
        raise ConfigError(f"{place}: {error}") from None
    settings = check_settings(kind.config_model, table, place)
    context = OutputContext(
        name=name,
        site=config.service.site,
        machine=config.service.machine,
        axes=tuple(axis.name for axis in config.axes),
        folder=config.store.folder,
        page=config.http.url or "",
        knows=knows_of(config),
        words=words_in,
        is_test=is_test,
        gone=tuple(gone),
    )
    try:
        return kind(settings, context)
    except MisconfiguredError as error:
        raise ConfigError(f"{place}.{error}") from None


async def run(context: NodeContext, name: str) -> None:
    """Tell one output until cancelled; one that raises is begun anew. Raises ConfigError."""
    output = make_output(context.config, name, context.gone)
    component = Component(context, name)
    parts, started_ns = ComponentWatch(HEALTH.stale_after_s), now_ns()
    states = {axis: AxisState(axis, None, parts) for axis in context.machines}
    node, receivers = OutputNode(output, component, context.events, states), output.receivers

    def take(topic: str, axis: str, header: Header, payload: Any) -> None:
        if axis in states:
            getattr(states[axis], topic).hear(header, payload, now_ns())

    async def show() -> None:
        """Hand over what is known of all axes once the output is open, again and again."""
        retry = new_retry()
        while True:
            answers = (state.answer(started_ns, now_ns()) for state in states.values())
            if await node.send("answers", answers, retry):
                await asyncio.sleep(SHOW_PERIOD_S)

    async def life() -> None:
        work = [show()] if output.takes_answers else []
        tasks = [asyncio.create_task(each) for each in (*work, *map(node.deliver, receivers))]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_EXCEPTION)
            for task in done:
                await task
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await output.close()

    async with component.running():
        with ExitStack() as ends:
            answers: tuple[Topic[Any], ...] = (PRELOAD, IMM, HEALTH)
            for topic in answers if output.takes_answers else ():
                heard = context.subscribe(topic)
                ends.callback(heard.close)
                component.follow(heard, partial(take, topic.name))
            reports = context.subscribe_to_components(STATUS)
            ends.callback(reports.close)
            component.follow(reports, lambda _axis, _header, told: parts.on_report(told, now_ns()))
            if output.takes_answers or receivers:
                await component.again(life, new_retry(), OutputUnavailableError)
            component.to(ComponentStatus.OK)  # it is asked, as metrics are
            await context.forever()


class OutputNode:
    """Hands messages to an output that may be away or hang; counts how many it took as `sent`.

    As `age_s` it reads the age of the oldest of the answers about `axes` that the other side has.
    """

    def __init__(
        self, output: Output, component: Component, events: EventLog, axes: Iterable[str]
    ) -> None:
        self._output, self._component, self._events = output, component, events
        self._opening = asyncio.Lock()
        self._problems: dict[str, str] = {}
        self._sent_s = dict.fromkeys(axes if output.takes_answers else (), time.monotonic())
        self.sent = 0
        component.problems = lambda: list(self._problems.values())
        component.readings = lambda: output.readings | self._age()
        component.counters = lambda: {"sent": self.sent}

    async def send(self, who: str, messages: Iterable[Message], retry: Retry) -> bool:
        """Hand messages over at once; False, after a pause, if the output is away. RefusedError."""
        try:
            async with self._opening:
                await within(self._output.open_s, self._output.open())
            await within(TAKE_S, all_of(*map(self._take, messages)))
        except OutputUnavailableError as error:
            await self._wait(who, str(error), retry)
            return False
        finally:
            if self._component.status is not ComponentStatus.OK:
                self._component.to(ComponentStatus.OK)
        self._works(who, retry)
        return True

    def _age(self) -> dict[str, float]:
        oldest_s = min(self._sent_s.values(), default=None)
        return {} if oldest_s is None else {"age_s": time.monotonic() - oldest_s}

    async def _take(self, message: Message) -> None:
        await self._output.take(message)
        self.sent += 1
        if isinstance(message, AxisAnswer):
            self._sent_s[message.axis] = time.monotonic()

    def _works(self, who: str, retry: Retry) -> None:
        retry.reset()
        if self._problems.pop(who, None) is not None:
            log.info("%s: works again", self._component.name)
            self._component.publish()

    async def _wait(self, who: str, problem: str, retry: Retry) -> None:
        heed_cancellation()
        if who not in self._problems:
            log.warning("%s: %s; trying again", self._component.name, problem)
        self._problems[who] = problem
        self._component.publish()
        await asyncio.sleep(retry.pause_s())

    async def deliver(self, receiver: str) -> None:
        """Hand over the events of an outbox in their order; what is refused holds up nobody."""
        who, retry, hour = f"events {receiver}".strip(), new_retry(), deque[float](maxlen=100)
        store, queue = self._events.store, self._output.queue(receiver)
        outbox = Outbox(store, queue, self._output.kinds, self._events)
        run, broken, sent_before = store.run, 0, 0
        while True:
            try:
                batch = due(self._output, await run(outbox.waiting, MOST_TOGETHER), hour)
                if not batch:
                    await asyncio.sleep(SHOW_PERIOD_S)
                    continue
                message, refusal = Events(receiver, tuple(each.event for each in batch)), ""
                try:
                    if not await self.send(who, (message,), retry):
                        broken += self.sent > sent_before
                        sent_before = self.sent
                        if broken < MOST_BROKEN:
                            continue
                        refusal = f"the connection broke at it {broken} times"
                except (RefusedError, ArithmeticError, LookupError, TypeError, ValueError) as error:
                    refusal = " ".join(str(error).split()) or type(error).__name__
                    self._works(who, retry)
                broken, sent_before = 0, self.sent
                hour.append(time.monotonic())
                for each in batch:
                    if refusal:
                        words = "%s: event %d is a dead letter: %s"
                        log.warning(words, self._component.name, each.id, refusal)
                        await run(outbox.refused, each.id, refusal)
                    else:
                        await run(outbox.delivered, each.id)
            except StoreFailedError as error:
                await self._wait(who, str(error), retry)


async def within(limit_s: float, work: Coroutine[Any, Any, None]) -> None:
    """Await what the other side may hold up for ever. Raises OutputUnavailableError."""
    try:
        async with asyncio.timeout(limit_s):
            await work
    except TimeoutError:
        raise OutputUnavailableError(f"no answer within {limit_s:g} s") from None


def due(output: Output, waiting: Sequence[StoredEvent], hour: deque[float]) -> list[StoredEvent]:
    """Events to hand over now, none while they are gathered; the hour's times are monotonic, s."""
    if not waiting or not output.gather_s:
        return list(waiting[:1])
    now_s = time.monotonic()
    while hour and now_s - hour[0] > 3600.0:
        hour.popleft()
    is_full = output.most_per_hour is not None and len(hour) >= output.most_per_hour
    age_s = (now_ns() - waiting[0].event.time_ns) / 1e9
    return [] if is_full or 0.0 <= age_s < output.gather_s else list(waiting)


async def send_test(config: EdgeConfig, name: str) -> dict[str, str]:
    """Problem of each receiver that was sent a test message, "" without one. Raises ConfigError."""
    output = make_output(config, name, is_test=True)
    message = "a test message of the edge service; nothing has happened"
    test = Event(axis="", kind="test", level=AxisCondition.FAULT, text=message, time_ns=now_ns())
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
