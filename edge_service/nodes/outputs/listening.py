"""Port of an output that others come to: taken as soon as it is free."""

from collections.abc import Awaitable, Callable

from ...messages.health import ComponentStatus
from ..supervision.heartbeat import Heartbeat
from ..wiring.context import Reporter

RETRY_S = 5.0


async def listen(
    start: Callable[[], Awaitable[None]], place: str, reporter: Reporter, heart: Heartbeat
) -> None:
    """Listen as soon as the port is free; says meanwhile that it is not.

    Args:
        start: raises OSError while it cannot.
        place: host and port.
    """
    while True:
        try:
            await start()
            break
        except OSError as error:
            reporter.to(ComponentStatus.RECOVERABLE_ERROR, f"{place}: {error.strerror}")
            await heart.sleep(RETRY_S)
    reporter.to(ComponentStatus.OK)
