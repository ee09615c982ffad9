"""Registry of the outputs that take events: a new one is its file and a line here."""

from collections.abc import Callable
from typing import Protocol

from ...config import EdgeConfig
from ...messages.event import Event
from ..supervision.heartbeat import Heartbeat
from .webhook import Webhook


class EventOutput(Protocol):
    """Output to which every event is offered."""

    def put(self, event: Event) -> None:
        """Take an event, if it is wanted; never waits."""
        ...

    async def run(self, heart: Heartbeat) -> None:
        """Send what was taken until cancelled."""
        ...


OUTPUTS: tuple[Callable[[EdgeConfig], EventOutput], ...] = (Webhook.of,)
"""Makers of the outputs as configured. They raise ConfigError."""
