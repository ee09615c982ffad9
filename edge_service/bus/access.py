"""Rights on the bus: which role may put what; everybody who gets in may read."""

from typing import Any

from ..messages.keys import COMPONENT, ROOT
from ..messages.outputs import HTTP, NODES, OF_HTTP
from ..messages.topics import (
    COMMAND,
    EVENT,
    FEAT,
    HEALTH,
    OUTCOME,
    PRELOAD,
    RAW,
    STATUS,
    VIB,
    WAVE,
    Topic,
)

READER = "reader"
PUTS: dict[str, tuple[Topic[Any], ...]] = {
    READER: (),
    "acquire": (RAW, WAVE),
    "downsample": (FEAT,),
    "estimate": (PRELOAD,),
    "health": (HEALTH, EVENT, OUTCOME),
    "http": (COMMAND,),
    "vibration": (VIB,),
    **dict.fromkeys(NODES, ()),
}
"""Topics that each role may put; nodes also report on themselves and their tasks."""
_PARTS = {HTTP: ("history", *OF_HTTP)}
"""Further components that a role reports on."""

COMMANDER = HTTP
"""The only role that may ask for an outcome: the question is a command."""

_MACHINE = f"{ROOT}/*/*"
_EVERYTHING = ["**", f"{_MACHINE}/{COMPONENT}/**", f"{_MACHINE}/@alive"]
_READS = ["declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query"]
_WRITES = ["put", "declare_queryable", "reply"]
_HEARS = ["put", "reply", "liveliness_token", "declare_subscriber", "declare_queryable", "query"]


def client_name(role: str) -> str:
    """Common name in the certificate of a role."""
    return f"{role}.node.edge-service"


def components_of(role: str) -> tuple[str, ...]:
    """Components that a node reports on: itself, its process, and what else it runs."""
    return (role, f"{role}_process", *_PARTS.get(role, ()))


def may_put(role: str) -> list[str]:
    """Key expressions that a role may put, and answer queries for."""
    if role == READER:
        return []
    topics = [f"{_MACHINE}/*/{topic.name}" for topic in PUTS[role]]
    own = [f"{_MACHINE}/{COMPONENT}/{component}/**" for component in components_of(role)]
    return [*topics, *(f"{each}/{topic.name}" for each in own for topic in (STATUS, EVENT))]


def access_control() -> dict[str, Any]:
    """Zenoh's access control for a router: all is refused but what the table allows.

    What connects by TCP is a reader; by TLS, the role that its certificate names. Publications of
    the router's own process are not asked.
    """
    nodes = [role for role in PUTS if role != READER]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [
            _rule("hear", "egress", _HEARS, _EVERYTHING),
            _rule("read", "ingress", _READS, _EVERYTHING),
            _rule("command", "ingress", ["query"], [f"{_MACHINE}/*/{OUTCOME.name}"], "deny"),
            _rule("presence", "ingress", ["liveliness_token"], [f"{_MACHINE}/@alive"]),
            *(_rule(f"write {role}", "ingress", _WRITES, may_put(role)) for role in nodes),
        ],
        "subjects": [
            {"id": "tcp", "link_protocols": ["tcp"]},
            *(_certified(role) for role in PUTS),
        ],
        "policies": [
            {"rules": ["hear", "read", "command"], "subjects": ["tcp", READER]},
            *({"rules": _rules_of(role), "subjects": [role]} for role in nodes),
        ],
    }


def _rules_of(role: str) -> list[str]:
    refused = [] if role == COMMANDER else ["command"]
    return ["hear", "read", "presence", f"write {role}", *refused]


def _rule(
    name: str, flow: str, messages: list[str], key_exprs: list[str], permission: str = "allow"
) -> dict[str, Any]:
    concerned = {"messages": messages, "key_exprs": key_exprs}
    return {"id": name, "permission": permission, "flows": [flow], **concerned}


def _certified(role: str) -> dict[str, Any]:
    return {"id": role, "link_protocols": ["tls"], "cert_common_names": [client_name(role)]}
