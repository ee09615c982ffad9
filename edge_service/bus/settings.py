"""Settings with which a process takes part in the bus, and the Zenoh configuration made of them."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self

import zenoh

from ..messages.addresses import Security
from .access import access_control


@dataclass(frozen=True, slots=True)
class TlsSettings:
    """Mutual TLS: both sides prove by certificates of one authority who they are.

    Attributes:
        endpoint: `tls/<address>:<port>`; listened at by the router, connected to by clients.
        authority, certificate, key: files in PEM.
    """

    endpoint: str
    authority: Path
    certificate: Path
    key: Path

    @classmethod
    def of_folder(cls, endpoint: str, folder: Path, name: str) -> Self:
        """Files that `name` needs in a folder of certificates. Raises OSError if one is missing."""
        settings = cls(endpoint, folder / "ca.pem", folder / f"{name}.pem", folder / f"{name}.key")
        for path in (settings.authority, settings.certificate, settings.key):
            path.read_bytes()
        return settings


@dataclass(frozen=True, slots=True)
class BusSettings:
    """Settings with which a process takes part in the bus.

    Attributes:
        endpoint: `tcp/<loopback address>:<port>`; port 0 takes any free one.
        role: `router` listens there and passes on between all who connect; `client` connects
            there, to a process with the role `router` or to any other Zenoh router.
        security: of a router. `readers`: who connects to `endpoint` may only read; `tls`: nobody
            connects there; `open`: whoever connects may do anything.
        tls: how nodes with certificates take part; a client with it connects there instead.
    """

    endpoint: str
    role: Literal["router", "client"]
    security: Security = "readers"
    tls: TlsSettings | None = None

    @property
    def there(self) -> str:
        """The endpoint at which a client takes part, and a router with certificates is found."""
        return self.tls.endpoint if self.tls else self.endpoint


def zenoh_config(settings: BusSettings) -> zenoh.Config:
    """Configuration of the session; the endpoints' ports are real ones."""
    config = zenoh.Config()
    place = _router(settings) if settings.role == "router" else _client(settings)
    for key, value in (_COMMON | place | _tls(settings)).items():
        config.insert_json5(key, json.dumps(value))
    return config


MOST_MESSAGE_BYTES = 4_000_000
"""The longest payload of our own, half a second at 10 kHz, has a tenth of it."""
MOST_SESSIONS = 64
MOST_AT_ONCE = 16
"""Batches that may be under way on a link before messages are dropped; Zenoh's own 2 lose events
that come together."""
_COMMON: dict[str, Any] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 0,
    "transport/link/tx/queue/size/data": MOST_AT_ONCE,
    "transport/link/tx/queue/size/interactive_high": MOST_AT_ONCE,
    "timestamping/enabled": False,
}


def _router(settings: BusSettings) -> dict[str, Any]:
    plain = [] if settings.security == "tls" else [settings.endpoint]
    secure = [settings.tls.endpoint] if settings.tls else []
    place: dict[str, Any] = {"mode": "router", "listen/endpoints": plain + secure}
    place["transport/link/rx/max_message_size"] = MOST_MESSAGE_BYTES
    place["transport/unicast/max_sessions"] = MOST_SESSIONS
    if settings.security != "open":
        place["access_control"] = access_control()
    return place


def _client(settings: BusSettings) -> dict[str, Any]:
    return {"mode": "client", "listen/endpoints": [], "connect/endpoints": [settings.there]}


def _tls(settings: BusSettings) -> dict[str, Any]:
    if settings.tls is None:
        return {}
    side = "listen" if settings.role == "router" else "connect"
    return {
        "transport/link/tls": {
            "root_ca_certificate": str(settings.tls.authority),
            f"{side}_certificate": str(settings.tls.certificate),
            f"{side}_private_key": str(settings.tls.key),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": False,  # or a wrong year would part the nodes
        }
    }
