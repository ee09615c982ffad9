"""A session at a router of the plant: what is declared on it holds across any loss of the link."""

import asyncio
import json
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Self

import zenoh

from ...messages.addresses import check_plant_endpoint
from ...threads import Threads
from ..settings import MOST_MESSAGE_BYTES, TlsSettings

OPEN_S = 2.0
"""Time in which a router must answer when a session is opened."""
LEASE_S = 4.0
"""Silence of a link after which whoever is behind it counts as gone."""
_THREADS = Threads("plant session", 4)


class PlantSettingsError(ValueError):
    """The plant cannot be reached as asked, however often that is tried."""


class PlantAwayError(Exception):
    """No router of the plant answers now; another try may succeed."""


@dataclass(frozen=True, slots=True)
class PlantSettings:
    """Settings of a session at a router of the plant.

    Attributes:
        endpoint: `tcp/host:port`, or `tls/host:port` with certificates.
        certificates: files for mutual TLS; the endpoint that stands there is not asked.
        allow_plain: whether TCP may leave this machine.
    """

    endpoint: str
    certificates: TlsSettings | None = None
    allow_plain: bool = False

    def __post_init__(self) -> None:
        check_endpoint(self.endpoint, self.certificates, self.allow_plain)


def check_endpoint(endpoint: str, certificates: TlsSettings | None, allow_plain: bool) -> None:
    """Check that an endpoint is one, and fits the certificates. Raises PlantSettingsError."""
    try:
        check_plant_endpoint(
            endpoint, has_certificates=certificates is not None, allow_plain=allow_plain
        )
    except ValueError as error:
        raise PlantSettingsError(str(error)) from None


class PlantSession:
    """A session at a router, which comes back by itself once it was opened."""

    def __init__(self, session: zenoh.Session) -> None:
        self.zenoh = session

    @classmethod
    async def open(cls, settings: PlantSettings) -> Self:
        """Open a session within `OPEN_S`.

        Raises:
            PlantSettingsError: a certificate cannot be read.
            PlantAwayError: no router answers now, or none that knows our certificate.
        """
        opening = asyncio.ensure_future(_THREADS.run(_open, settings))
        try:
            return cls(await asyncio.shield(opening))
        except asyncio.CancelledError:
            opening.add_done_callback(_close_late)
            raise

    @property
    def is_connected(self) -> bool:
        """Tell whether a router is there now."""
        return not self.zenoh.is_closed() and bool(self.zenoh.info.routers_zid())

    async def close(self) -> None:
        """Close; safe twice."""
        if not self.zenoh.is_closed():
            await _THREADS.run(self.zenoh.close)


def _open(settings: PlantSettings) -> zenoh.Session:
    place: dict[str, Any] = {
        "mode": "client",
        "listen/endpoints": [],
        "connect/endpoints": [settings.endpoint],
        "connect/timeout_ms": round(1e3 * OPEN_S),
    }
    try:
        return zenoh.open(plant_config(place, settings.certificates))
    except zenoh.ZError as error:
        doubt = ", or none that trusts this certificate" if settings.certificates else ""
        raise PlantAwayError(f"no router answers at {settings.endpoint}{doubt}") from error


def _close_late(opening: "asyncio.Future[zenoh.Session]") -> None:
    """Close a session that nobody waits for any more."""
    with suppress(PlantAwayError, PlantSettingsError, asyncio.CancelledError):
        opening.result().close()


def plant_config(
    place: dict[str, Any], connects: TlsSettings | None, listens: TlsSettings | None = None
) -> zenoh.Config:
    """Zenoh's configuration of a session or router of the plant.

    Args:
        connects, listens: certificates of a client and of a server, of one authority.

    Raises PlantSettingsError.
    """
    config = zenoh.Config()
    for key, value in (_COMMON | place | _tls(connects, listens)).items():
        try:
            config.insert_json5(key, json.dumps(value))
        except zenoh.ZError as error:
            raise PlantSettingsError(f"{key}: {str(error).partition(' at /')[0]}") from None
    return config


_COMMON: dict[str, Any] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,
    "transport/link/rx/max_message_size": MOST_MESSAGE_BYTES,
    "transport/shared_memory/enabled": False,  # its pool takes 16 MB, and no plant is one host
    "transport/link/tx/lease": round(1e3 * LEASE_S),
    "timestamping/enabled": True,  # or the cache of a publisher cannot order what it holds
}


def _tls(connects: TlsSettings | None, listens: TlsSettings | None) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for side, files in (("connect", connects), ("listen", listens)):
        if files is not None:
            _check_files(files)
            found["root_ca_certificate"] = str(files.authority)
            found[f"{side}_certificate"] = str(files.certificate)
            found[f"{side}_private_key"] = str(files.key)
    checks = {"verify_name_on_connect": True, "close_link_on_expiration": False}
    return {"transport/link/tls": found | checks | {"enable_mtls": True}} if found else {}


def _check_files(files: TlsSettings) -> None:
    for path in (files.authority, files.certificate, files.key):
        try:
            path.read_bytes()
        except OSError as error:
            raise PlantSettingsError(f"{path}: {error.strerror}") from None
