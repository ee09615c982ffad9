"""Events to another system by HTTP POST: signed, in order, kept on disk until they arrive."""

import asyncio
import hashlib
import hmac
import json
import logging
from collections.abc import Awaitable, Callable
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

log = logging.getLogger(__name__)
FIRST_PAUSE_S = 1.0
LONGEST_PAUSE_S = 60.0
SIGNATURE = "X-Edge-Signature"
TIMESTAMP = "X-Edge-Timestamp"
DELIVERY = "X-Edge-Delivery"


def sign(secret: bytes, timestamp: str, body: bytes) -> str:
    """`sha256=` and the HMAC-SHA256 of `{timestamp}.{body}` in hex."""
    return "sha256=" + hmac.new(secret, f"{timestamp}.".encode() + body, hashlib.sha256).hexdigest()


class Webhook:
    """Sends the events of a spool, the oldest first, one at a time.

    A receiver that cannot be reached, or says that it is busy, is waited for with growing pauses.
    An event that it refuses is tried `tries` times; then it is a dead letter, and the next goes.

    Args:
        settings: address, secret and limits.
        spool: where events wait.
        on_change: called with "" when an event has arrived, else with what is wrong.
        sleep: pauses.

    Attributes:
        spool: as given.
        delivered: events that arrived.
    """

    def __init__(
        self,
        settings: WebhookConfig,
        spool: Spool,
        on_change: Callable[[str], None] = lambda _problem: None,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        assert settings.url is not None and settings.secret is not None
        self._secret = settings.secret.get_secret_value().encode()
        self._poster = Poster(settings.url.get_secret_value())
        self._kinds = frozenset(settings.kinds)
        self._tries = settings.tries
        self._delays = round(settings.give_up_h * 3600.0 / LONGEST_PAUSE_S)
        self._on_change = on_change
        self._sleep = sleep
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
                (message,) = await heart.patiently(self.spool.oldest(1)) or (None,)
                rests = message is not None and await heart.patiently(
                    self._deliver(message), limit_s=WHOLE_S + THREAD_LIMIT_S
                )
            except SpoolError as error:
                self._on_change(str(error))
                rests = True
            if rests:
                await self._rest(heart)

    async def _deliver(self, message: Message) -> bool:
        """Try to send an event once; tells whether a pause is due."""
        timestamp = str(int(now_ns() / 1e9))
        headers = {
            "Content-Type": "application/json",
            "Connection": "close",
            DELIVERY: message.key,
            TIMESTAMP: timestamp,
            SIGNATURE: sign(self._secret, timestamp, message.payload),
        }
        reply = await self._poster.post(message.payload, headers)
        if reply.outcome is Outcome.TAKEN:
            await self.spool.remove([message])
            self.delivered += 1
            self._pause_s = FIRST_PAUSE_S
            self._on_change("")
            return False
        self._on_change(f"{self._poster.place}: {reply.reason}")
        return await self._refused(message, reply)

    async def _refused(self, message: Message, reply: Reply) -> bool:
        refused = reply.outcome is not Outcome.LATER
        tries = message.refusals + message.delays + 1
        given_up = (
            reply.outcome is Outcome.NEVER
            or message.refusals + refused >= self._tries
            or message.delays + (not refused) >= self._delays
        )
        if not given_up:
            await self.spool.count(message, refused=refused)
            return True
        letter = DeadLetter(
            message.key, message.topic, message.payload, tries, reply.reason, now_ns()
        )
        await self.spool.bury(letter)
        self._pause_s = FIRST_PAUSE_S
        log.warning("webhook: event %s is a dead letter: %s", message.key, reply.reason)
        return False

    async def _rest(self, heart: Heartbeat) -> None:
        pause_s, self._pause_s = self._pause_s, min(2.0 * self._pause_s, LONGEST_PAUSE_S)
        heart.beat(pause_s)
        await self._sleep(pause_s)


async def open_webhook(config: EdgeConfig, on_change: Callable[[str], None]) -> Webhook | None:
    """The webhook as configured; None without a `url`."""
    settings = config.webhook
    if settings.url is None:
        return None
    path = settings.buffer or Path("webhook-buffer.sqlite")
    spool = await Spool.open(path, settings.buffer_events, round(1e6 * settings.buffer_mb))
    return Webhook(settings, spool, on_change)
