"""Names of variables as people write them, and as a server knows them."""

import re

from asyncua import ua
from asyncua.ua.uaerrors import UaError

_URI = re.compile(r"\{([^}]*)\}")
_NSU = re.compile(r"^nsu=[^;]*;")


def is_path(name: str) -> bool:
    """Tell whether a name is a path of browse names and not a node id."""
    return name.startswith("{") or "=" not in name.partition(";")[0]


def check_name(name: str) -> str:
    """Return a name that can be one whatever the server; raise ValueError if it cannot."""
    example = "expected ns=2;s=X.torque, nsu=URI;s=X.torque or {URI}Machines/{URI}Lathe"
    try:
        if is_path(name):
            browse_path(name, [*_URI.findall(name)])
        else:
            ua.NodeId.from_string(_NSU.sub("ns=1;", name))
    except (ValueError, UaError):
        raise ValueError(f"{name!r} is no node: {example}") from None
    return name


def browse_path(name: str, namespaces: list[str]) -> list[str]:
    """`{URI}Machines/Name` -> ["3:Machines", "0:Name"]; a URI may hold slashes.

    Raises:
        ValueError: a namespace that the server does not have, or a brace too few.
    """
    steps, rest = [], name
    while rest:
        index = 0
        if rest.startswith("{"):
            uri, closed, rest = rest[1:].partition("}")
            if not closed:
                raise ValueError("a { without its }")
            index = _namespace(uri, namespaces)
        step, _, rest = rest.partition("/")
        steps.append(f"{index}:{step}")
    return steps


def node_id(name: str, namespaces: list[str]) -> ua.NodeId:
    """`ns=2;s=X` or `nsu=URI;s=X`. Raises ValueError and the library's parsing error."""
    if name.startswith("nsu="):
        uri, _, rest = name.removeprefix("nsu=").partition(";")
        name = f"ns={_namespace(uri, namespaces)};{rest}"
    return ua.NodeId.from_string(name)


def _namespace(uri: str, namespaces: list[str]) -> int:
    if uri not in namespaces:
        raise ValueError(f"the server has no namespace {uri!r}")
    return namespaces.index(uri)
