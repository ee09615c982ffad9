"""Process of one router of a plant."""

from collections.abc import Callable, Sequence

from ...bus.plant.router import open_router
from ...bus.settings import TlsSettings
from ...threads import Threads
from ..supervision.signals import install_stop

_THREADS = Threads("plant router")


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
    session = await _THREADS.run(
        open_router, listen, above, certificates, certificates, allow_plain
    )
    try:
        for endpoint in listen:
            announce(endpoint)
        await stop.wait()
    finally:
        await _THREADS.run(session.close)
