"""A plain Zenoh router of a plant; the official `zenohd` does as well."""

from collections.abc import Sequence

import zenoh

from ..settings import TlsSettings
from .session import PlantSettingsError, check_endpoint, plant_config

MOST_SESSIONS = 10_000


def open_router(
    listen: Sequence[str],
    above: Sequence[str] = (),
    certificates: TlsSettings | None = None,
    above_certificates: TlsSettings | None = None,
    allow_plain: bool = False,
) -> zenoh.Session:
    """Open a router: it passes on between all who connect until the session is closed.

    Args:
        listen: endpoints at which machines, readers and routers below it connect.
        above: endpoints of the routers above it; one that is away is tried again and again.
        certificates: of a server, shown to all who connect.
        above_certificates: of a client, shown to the routers above; of the same authority.

    Raises PlantSettingsError, also for an endpoint that is in use.
    """
    for endpoint in listen:
        check_endpoint(endpoint, certificates, allow_plain)
    for endpoint in above:
        check_endpoint(endpoint, above_certificates, allow_plain)
    place = {
        "mode": "router",
        "listen/endpoints": list(listen),
        "listen/exit_on_failure": True,
        "connect/endpoints": list(above),
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "transport/unicast/max_sessions": MOST_SESSIONS,
    }
    try:
        return zenoh.open(plant_config(place, above_certificates, certificates))
    except zenoh.ZError as error:
        where = ", ".join(listen)
        raise PlantSettingsError(f"no router can listen at {where}; is it in use?") from error
