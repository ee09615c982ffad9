"""Events in order to whoever takes them: kept on disk, tried again with pauses, or set aside."""

import asyncio
import logging
import random
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import ClassVar

from ...bus.spool.message import DeadLetter, Message, SpoolError
from ...bus.spool.spool import Spool
from ...clock import now_ns
from ...config_tables import EventOutputConfig
from ...health.store.events import StoredEvent
from ...messages.answer import AxisAnswer
from ...messages.event import Event
from ..supervision.heartbeat import THREAD_LIMIT_S, Heartbeat
from .reply import Outcome, Reply

log = logging.getLogger(__name__)
FIRST_PAUSE_S = 1.0
LONGEST_PAUSE_S = 60.0
SHORTENED = 0.25
"""Share by which a pause may be shorter, so that many services do not return at one moment."""
MOST_WITNESSES = 16
"""Events behind a refused one that are tried before its receiver is taken for sick."""


Answers = Callable[[str], AxisAnswer | None]
"""Answer that holds now of an axis; None of one that is not known."""


def jittered(seconds: float) -> asyncio.Timeout:
    """Time limit of a pause, shorter by chance."""
    return asyncio.timeout(seconds * (1.0 - SHORTENED * random.random()))


class OrderedOutput(ABC):
    """Sends the events of a spool, the oldest first, as many together as go in one sending.

    A receiver that cannot be reached, or says that it is busy, is waited for with growing pauses.
    Once it has refused an event `tries` times, the next ones are tried: if one is taken, and the
    first refused once more, the first is a dead letter; else the receiver is sick and waited for.

    Args:
        name: of the output.
        settings: which events, how often and how long.
        spool: where events wait.
        on_change: called with "" when an event has arrived, else with what is wrong.
        pause: limits a pause, s.
        tries: see above.

    Attributes:
        spool: as given.
        delivered: events that arrived.
    """

    LIMIT_S: ClassVar[float]
    """Longest time of one sending."""
    BELIEVED: ClassVar[bool] = False
    """True if a refusal for good is believed without trying others."""

    def __init__(
        self,
        name: str,
        settings: EventOutputConfig,
        spool: Spool,
        on_change: Callable[[str], None] = lambda _problem: None,
        pause: Callable[[float], asyncio.Timeout] = jittered,
        tries: int = 1,
    ) -> None:
        self._name = name
        self._kinds = frozenset(settings.kinds)
        self._tries = tries
        self._most_pauses = round(settings.give_up_h * 3600.0 / LONGEST_PAUSE_S)
        self._on_change = on_change
        self._pause = pause
        self._pause_s = FIRST_PAUSE_S
        self.spool = spool
        self.delivered = 0

    @property
    @abstractmethod
    def place(self) -> str:
        """Address of the receiver, without what only it should know."""

    @abstractmethod
    async def send(self, messages: Sequence[Message]) -> Reply:
        """Send once; whatever the other side does ends in a reply."""

    @abstractmethod
    def payload(self, event: Event) -> bytes:
        """Content to keep of an event."""

    async def together(self, first: Message) -> list[Message]:
        """Messages that go in one sending, beginning with the oldest."""
        return [first]

    def due_in_s(self, first: Message) -> float:
        """Time for which the oldest is to wait yet."""
        return 0.0

    def wants(self, event: Event) -> bool:
        """Tell whether an event is of a configured kind."""
        return event.kind in self._kinds

    def put(self, logged: StoredEvent) -> None:
        """Keep an event, if it is wanted, on disk to be sent; never waits."""
        event = logged.event
        if self.wants(event):
            topic = f"{event.axis}/{event.kind}"
            self.spool.put_soon(topic, self.payload(event), mark=logged.id)

    async def run(self, heart: Heartbeat) -> None:
        """Send until cancelled."""
        while True:
            try:
                with heart.idle(lambda: len(self.spool) == 0):
                    await self.spool.wait()
                rests = await self._round(heart)
            except SpoolError as error:
                self._on_change(str(error))
                rests = True
            if rests:
                await self._rest(heart)

    async def _round(self, heart: Heartbeat) -> bool:
        """Try the oldest event, and another if it was refused too often; tells if it rests now."""
        (first,) = await heart.patiently(self.spool.oldest(1)) or (None,)
        if first is None:
            return False
        if (due_in_s := self.due_in_s(first)) > 0.0:
            await self._hold(heart, min(due_in_s, LONGEST_PAUSE_S))
            return False
        _, *others = await heart.patiently(self.together(first))
        sent = [first, *others]
        reply = await self._try(heart, sent)
        if reply.outcome is Outcome.TAKEN:
            return False
        if self._is_suspect(first, reply) and await self._is_to_blame(heart, first, reply):
            again = reply if reply.outcome is Outcome.NEVER else await self._try(heart, sent)
            if again.outcome is Outcome.TAKEN:
                return False
            if again.outcome is not Outcome.LATER:
                await heart.patiently(self._bury(sent, again, 2 - (again is reply)))
                return False
        return await heart.patiently(self._wait_for(sent, reply))

    def _is_suspect(self, message: Message, reply: Reply) -> bool:
        often = reply.outcome is Outcome.REFUSED and message.refusals + 1 >= self._tries
        return often or reply.outcome is Outcome.NEVER

    async def _is_to_blame(self, heart: Heartbeat, first: Message, reply: Reply) -> bool:
        believed = self.BELIEVED and reply.outcome is Outcome.NEVER
        return believed or await self._takes_another(heart, first.refusals + 1)

    async def _takes_another(self, heart: Heartbeat, tries: int) -> bool:
        """Tell whether the receiver takes one of those behind the first; more of them each time.

        All within one round and in their order: what stands before the one that is taken was
        refused by a receiver that is well.
        """
        _, *others = await heart.patiently(self.spool.oldest(1 + min(tries, MOST_WITNESSES)))
        for witness in others:
            if (await self._try(heart, [witness])).outcome is Outcome.TAKEN:
                return True
        return False

    async def _try(self, heart: Heartbeat, messages: Sequence[Message]) -> Reply:
        return await heart.patiently(self._deliver(messages), limit_s=self.LIMIT_S + THREAD_LIMIT_S)

    async def _deliver(self, messages: Sequence[Message]) -> Reply:
        """Try to send once; what has arrived is forgotten."""
        reply = await self.send(messages)
        if reply.outcome is Outcome.TAKEN:
            self.delivered += len(messages)
            await self.spool.remove(messages)
            self._pause_s = FIRST_PAUSE_S
        is_well = reply.outcome is Outcome.TAKEN and not reply.reason
        self._on_change("" if is_well else f"{self.place}: {reply.reason}")
        return reply

    async def _wait_for(self, messages: Sequence[Message], reply: Reply) -> bool:
        """Count a try that failed, and give up after too many; tells whether a pause is due."""
        first = messages[0]
        if first.refusals + first.delays + 1 >= self._most_pauses:
            await self._bury(messages, reply, 1)
            return False
        await self.spool.count(first, refused=reply.outcome is not Outcome.LATER)
        return True

    async def _bury(self, messages: Sequence[Message], reply: Reply, tries: int) -> None:
        tries += messages[0].refusals + messages[0].delays
        self._pause_s = FIRST_PAUSE_S
        for each in messages:
            said = (each.key, each.topic, each.payload, tries, reply.reason, now_ns())
            await self.spool.bury(DeadLetter(*said))
            log.warning("%s: event %s is a dead letter: %s", self._name, each.key, reply.reason)

    async def _hold(self, heart: Heartbeat, pause_s: float) -> None:
        """Let the oldest wait."""
        heart.beat(pause_s)
        with suppress(TimeoutError):
            async with self._pause(pause_s):
                await asyncio.Event().wait()

    async def _rest(self, heart: Heartbeat) -> None:
        """Pause; less if only now there is another event by which to judge the receiver."""
        pause_s, self._pause_s = self._pause_s, min(2.0 * self._pause_s, LONGEST_PAUSE_S)
        heart.beat(pause_s)
        enough = 2 if len(self.spool) == 1 else sys.maxsize
        with suppress(TimeoutError):
            async with self._pause(pause_s):
                await self.spool.wait(enough)


async def open_spool(settings: EventOutputConfig, name: str) -> Spool:
    """The spool of an output as configured."""
    path = settings.buffer or Path(f"{name}-buffer.sqlite")
    return await Spool.open(path, settings.buffer_events, round(1e6 * settings.buffer_mb))
