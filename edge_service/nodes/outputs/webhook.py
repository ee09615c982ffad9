"""Events to another system by HTTP POST: signed, in order, kept on disk until they arrive."""

import asyncio
import json
import logging
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ...bus.spool.message import DeadLetter, Message, SpoolError
from ...bus.spool.spool import Spool
from ...clock import now_ns
from ...config import EdgeConfig
from ...config_tables import WebhookConfig
from ...health.events.log import LoggedEvent
from ...messages.topics import EVENT
from ..supervision.heartbeat import THREAD_LIMIT_S, Heartbeat
from .post import WHOLE_S, Outcome, Poster, Reply
from .signature import signed_headers

log = logging.getLogger(__name__)
FIRST_PAUSE_S = 1.0
LONGEST_PAUSE_S = 60.0
MOST_WITNESSES = 16
"""Events behind a refused one that are tried before its receiver is taken for sick."""


class Webhook:
    """Sends the events of a spool, the oldest first, one at a time.

    A receiver that cannot be reached, or says that it is busy, is waited for with growing pauses.
    Once it has refused an event `tries` times, the next ones are tried: if one is taken, and the
    first refused once more, the first is a dead letter; else the receiver is sick and waited for.

    Args:
        settings: address, secret and limits.
        spool: where events wait.
        on_change: called with "" when an event has arrived, else with what is wrong.
        pause: limits a pause, s.

    Attributes:
        spool: as given.
        delivered: events that arrived.
    """

    def __init__(
        self,
        settings: WebhookConfig,
        spool: Spool,
        on_change: Callable[[str], None] = lambda _problem: None,
        pause: Callable[[float], asyncio.Timeout] = asyncio.timeout,
    ) -> None:
        assert settings.url is not None and settings.secret is not None
        secrets = (settings.secret, settings.previous_secret)
        self._secrets = [secret.get_secret_value() for secret in secrets if secret is not None]
        self._poster = Poster(settings.url.get_secret_value())
        self._kinds = frozenset(settings.kinds)
        self._tries = settings.tries
        self._most_pauses = round(settings.give_up_h * 3600.0 / LONGEST_PAUSE_S)
        self._on_change = on_change
        self._pause = pause
        self._pause_s = FIRST_PAUSE_S
        self.spool = spool
        self.delivered = 0

    def put(self, logged: LoggedEvent) -> None:
        """Keep an event, if it is of a configured kind, on disk to be sent; never waits."""
        event = logged.event
        if event.kind in self._kinds:
            body = json.dumps({"schema": EVENT.payload} | event.model_dump(mode="json"))
            topic = f"{event.axis}/{event.kind}"
            self.spool.put_soon(topic, body.encode(), mark=logged.id)

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
        reply = await self._try(heart, first)
        if reply.outcome is Outcome.TAKEN:
            return False
        if self._is_suspect(first, reply) and await self._takes_another(heart, first.refusals + 1):
            again = reply if reply.outcome is Outcome.NEVER else await self._try(heart, first)
            if again.outcome is Outcome.TAKEN:
                return False
            if again.outcome is not Outcome.LATER:
                await heart.patiently(self._bury(first, again, 2 - (again is reply)))
                return False
        return await heart.patiently(self._wait_for(first, reply))

    def _is_suspect(self, message: Message, reply: Reply) -> bool:
        often = reply.outcome is Outcome.REFUSED and message.refusals + 1 >= self._tries
        return often or reply.outcome is Outcome.NEVER

    async def _takes_another(self, heart: Heartbeat, tries: int) -> bool:
        """Tell whether the receiver takes one of those behind the first; more of them each time.

        All within one round and in their order: what stands before the one that is taken was
        refused by a receiver that is well.
        """
        _, *others = await heart.patiently(self.spool.oldest(1 + min(tries, MOST_WITNESSES)))
        for witness in others:
            if (await self._try(heart, witness)).outcome is Outcome.TAKEN:
                return True
        return False

    async def _try(self, heart: Heartbeat, message: Message) -> Reply:
        return await heart.patiently(self._deliver(message), limit_s=WHOLE_S + THREAD_LIMIT_S)

    async def _deliver(self, message: Message) -> Reply:
        """Try to send an event once; it is forgotten when it has arrived."""
        timestamp = str(int(now_ns() / 1e9))
        headers = {"Content-Type": "application/json", "Connection": "close"}
        headers |= signed_headers(self._secrets, message.key, timestamp, message.payload)
        reply = await self._poster.post(message.payload, headers)
        if reply.outcome is Outcome.TAKEN:
            self.delivered += 1
            await self.spool.remove([message])
            self._pause_s = FIRST_PAUSE_S
            self._on_change("")
        else:
            self._on_change(f"{self._poster.place}: {reply.reason}")
        return reply

    async def _wait_for(self, message: Message, reply: Reply) -> bool:
        """Count a try that failed, and give up after too many; tells whether a pause is due."""
        if message.refusals + message.delays + 1 >= self._most_pauses:
            await self._bury(message, reply, 1)
            return False
        await self.spool.count(message, refused=reply.outcome is not Outcome.LATER)
        return True

    async def _bury(self, message: Message, reply: Reply, tries: int) -> None:
        tries += message.refusals + message.delays
        letter = DeadLetter(
            message.key, message.topic, message.payload, tries, reply.reason, now_ns()
        )
        await self.spool.bury(letter)
        self._pause_s = FIRST_PAUSE_S
        log.warning("webhook: event %s is a dead letter: %s", message.key, reply.reason)

    async def _rest(self, heart: Heartbeat) -> None:
        """Pause; less if only now there is another event by which to judge the receiver."""
        pause_s, self._pause_s = self._pause_s, min(2.0 * self._pause_s, LONGEST_PAUSE_S)
        heart.beat(pause_s)
        enough = 2 if len(self.spool) == 1 else sys.maxsize
        with suppress(TimeoutError):
            async with self._pause(pause_s):
                await self.spool.wait(enough)


async def open_webhook(config: EdgeConfig, on_change: Callable[[str], None]) -> Webhook | None:
    """The webhook as configured; None without a `url`."""
    settings = config.webhook
    if settings.url is None:
        return None
    path = settings.buffer or Path("webhook-buffer.sqlite")
    spool = await Spool.open(path, settings.buffer_events, round(1e6 * settings.buffer_mb))
    return Webhook(settings, spool, on_change)
