"""Names of variables as people write them, and as a server knows them."""

from asyncua import ua


def is_path(name: str) -> bool:
    """Whether a name is a path of browse names, and no node id."""
    return name.startswith("{") or "=" not in name.partition(";")[0]


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
