"""Events to another system by HTTP POST: signed, in order, kept on disk until they arrive."""

import asyncio
import json
from collections.abc import Callable, Sequence

from ...bus.spool.message import Message
from ...bus.spool.spool import Spool
from ...clock import now_ns
from ...config import EdgeConfig
from ...config_tables import WebhookConfig
from ...messages.event import Event
from ...messages.topics import EVENT
from .ordered import LONGEST_PAUSE_S, OrderedOutput, jittered, open_spool
from .post import WHOLE_S, Poster
from .reply import Reply
from .signature import signed_headers

__all__ = ["LONGEST_PAUSE_S", "Webhook", "open_webhook"]


class Webhook(OrderedOutput):
    """Posts events, one at a time.

    Args:
        settings: address, secret and limits.
        spool: where events wait.
        on_change: called with "" when an event has arrived, else with what is wrong.
        pause: limits a pause, s.
    """

    LIMIT_S = WHOLE_S

    def __init__(
        self,
        settings: WebhookConfig,
        spool: Spool,
        on_change: Callable[[str], None] = lambda _problem: None,
        pause: Callable[[float], asyncio.Timeout] = jittered,
    ) -> None:
        super().__init__("webhook", settings, spool, on_change, pause, settings.tries)
        assert settings.url is not None and settings.secret is not None
        secrets = (settings.secret, settings.previous_secret)
        self._secrets = [secret.get_secret_value() for secret in secrets if secret is not None]
        self._poster = Poster(settings.url.get_secret_value())

    @property
    def place(self) -> str:
        """Address without path and login."""
        return self._poster.place

    def payload(self, event: Event) -> bytes:
        """The event as on the bus."""
        return json.dumps({"schema": EVENT.payload} | event.model_dump(mode="json")).encode()

    async def send(self, messages: Sequence[Message]) -> Reply:
        """Post one event."""
        (message,) = messages
        timestamp = str(int(now_ns() / 1e9))
        headers = {"Content-Type": "application/json", "Connection": "close"}
        headers |= signed_headers(self._secrets, message.key, timestamp, message.payload)
        return await self._poster.post(message.payload, headers)


async def open_webhook(config: EdgeConfig, on_change: Callable[[str], None]) -> Webhook | None:
    """The webhook as configured; None without a `url`."""
    settings = config.webhook
    if settings.url is None:
        return None
    return Webhook(settings, await open_spool(settings, "webhook"), on_change)
