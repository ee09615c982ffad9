"""Registry of the outputs that take events: a new one is its file and a line here."""

from collections.abc import Awaitable, Callable
from typing import Protocol

from ...bus.spool.spool import Spool
from ...config import EdgeConfig
from ...health.events.log import LoggedEvent
from ..supervision.heartbeat import Heartbeat


class EventOutput(Protocol):
    """Output to which every event is offered.

    Attributes:
        spool: where its events wait, and its dead letters lie.
        delivered: events that arrived.
    """

    spool: Spool
    delivered: int

    def put(self, logged: LoggedEvent) -> None:
        """Keep an event, if it is wanted, on disk to be sent, its number as mark; never waits."""

    async def run(self, heart: Heartbeat) -> None:
        """Send what was kept until cancelled."""


async def _open_webhook(config: EdgeConfig, on_change: Callable[[str], None]) -> EventOutput | None:
    if config.webhook.url is None:
        return None
    from .webhook import open_webhook  # its client takes 8 MB

    return await open_webhook(config, on_change)


OpenOutput = Callable[[EdgeConfig, Callable[[str], None]], Awaitable[EventOutput | None]]
"""Opens an output as configured, None if it is not; told what to call with what is wrong now."""
OPENERS: dict[str, OpenOutput] = {"webhook": _open_webhook}
"""Openers by the name that the output reports under."""
