"""Settings with which a process takes part in the bus, and the Zenoh configuration made of them."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import zenoh

from ..exit_status import BadInputError
from ..messages.keys import COMPONENT, ROOT
from ..messages.topics import OUTCOME, TOPICS

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
    "timestamping/enabled": True,  # or the cache of a publisher cannot order what it holds
}
_ROUTER: dict[str, Any] = {
    "transport/link/rx/max_message_size": MOST_MESSAGE_BYTES,
    "transport/unicast/max_sessions": MOST_SESSIONS,
}


class BusConfigurationError(BadInputError):
    """The bus cannot be set up as asked."""


@dataclass(frozen=True, slots=True)
class BusSettings:
    """Settings with which a process takes part in the bus."""

    endpoint: str  # `tcp/<loopback address>:<port>`; port 0 takes any free one
    # `router` listens there and passes on between all who connect; `client` connects there, to a
    # process with the role `router` or to any other Zenoh router
    role: Literal["router", "client"]
    read_only: bool = True  # who connects to a router may read, and neither publish nor answer
    # Zenoh's own configuration, on which all this is laid: further endpoints, TLS, access control.
    # What it says of rights holds in place of `read_only`, and a client connects where it says
    zenoh_file: Path | None = None


def zenoh_config(settings: BusSettings) -> zenoh.Config:
    """Configuration of the session; the endpoint's port is a real one. BusConfigurationError."""
    try:
        path = settings.zenoh_file
        config = zenoh.Config() if path is None else zenoh.Config.from_file(str(path))
        stated = {key: json.loads(config.get_json(key)) for key in _ENDPOINTS}
    except zenoh.ZError as error:
        reason = " ".join(str(error).split()).partition(" at /")[0]
        raise BusConfigurationError(f"bus.zenoh_file: {settings.zenoh_file}: {reason}") from None
    if settings.role == "router":
        listened = _of_mode(stated["listen/endpoints"], "router")
        place = _ROUTER | {"mode": "router", "listen/endpoints": [settings.endpoint, *listened]}
        if settings.read_only and not json.loads(config.get_json("access_control/enabled")):
            place["access_control"] = _READ_ONLY
    else:
        connected = _of_mode(stated["connect/endpoints"], "client") or [settings.endpoint]
        place = {"mode": "client", "listen/endpoints": [], "connect/endpoints": connected}
    for key, value in (_COMMON | place).items():
        config.insert_json5(key, json.dumps(value))
    return config


_ENDPOINTS = ("listen/endpoints", "connect/endpoints")
"""Of a Zenoh configuration: a list, or lists by mode."""


def _of_mode(endpoints: Any, mode: str) -> list[str]:
    found: list[str] = endpoints.get(mode, []) if isinstance(endpoints, dict) else endpoints
    return [each for each in found if each != "tcp/[::]:7447"]  # Zenoh's own default


_CACHES = [f"{ROOT}/*/*/*/{topic.name}/@adv/**" for topic in TOPICS.values() if topic.cached]
"""Keys on which Zenoh's advanced publishers show presence and hand over what was missed."""
_EVERYTHING = ["**", f"{ROOT}/*/*/{COMPONENT}/**", f"{ROOT}/*/*/@alive", *_CACHES]
_RULE = ("id", "permission", "flows", "messages", "key_exprs")
_HEARD = ["put", "reply", "liveliness_token", "declare_subscriber", "declare_queryable", "query"]
_ASKED = ["declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query"]
_RULES = (
    ("hear", "allow", ["egress"], _HEARD, _EVERYTHING),
    ("read", "allow", ["ingress"], _ASKED, _EVERYTHING),
    # The question for an outcome is a command.
    ("command", "deny", ["ingress"], ["query"], [f"{ROOT}/*/*/*/{OUTCOME.name}"]),
)
_READ_ONLY: dict[str, Any] = {
    "enabled": True,
    "default_permission": "deny",
    "rules": [dict(zip(_RULE, rule, strict=True)) for rule in _RULES],
    "subjects": [{"id": "anybody"}],
    "policies": [{"rules": ["hear", "read", "command"], "subjects": ["anybody"]}],
}
"""Zenoh's access control: others may read. Publications of the router's process are not asked."""
