"""Parts of the service that report on themselves, by name."""

import re

NODES = frozenset({"acquire", "downsample", "estimate", "health", "http"})
COMPONENTS = NODES | {"service", "history"}
COMPONENTS |= {f"{node}_process" for node in (*NODES, "bus")}
"""Every part of the service that reports on itself, beside outputs and their processes.

`service` is the process in which all nodes run, `..._process` that of one node alone; `history` is
a part of `http`.
"""


_NAME = re.compile(r"[a-z][a-z0-9_-]{0,40}")


def check_component(name: str) -> str:
    """Return `name` if a part of the service, such as an output, may have it; else ValueError."""
    if not _NAME.fullmatch(name):
        raise ValueError(f"{name!r:.60}: expected a small letter, then small letters, digits, _, -")
    return name
