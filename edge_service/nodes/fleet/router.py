"""Process of one router of a plant."""

import asyncio
from collections.abc import Callable, Sequence

from ...bus.plant.router import open_router
from ...bus.settings import TlsSettings
from ..supervision.signals import install_stop


async def run_router(
    listen: Sequence[str],
    above: Sequence[str],
    certificates: TlsSettings | None,
    allow_plain: bool,
    announce: Callable[[str], None],
) -> None:
    """Pass on between all who connect, until SIGINT or SIGTERM.

    Raises PlantSettingsError: before anything is announced.
    """
    stop = install_stop()
    session = await asyncio.to_thread(
        open_router, listen, above, certificates, certificates, allow_plain
    )
    try:
        for endpoint in listen:
            announce(endpoint)
        await stop.wait()
    finally:
        await asyncio.to_thread(session.close)
