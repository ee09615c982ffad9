"""Parts of the service that report on themselves, by name."""

import re

from .outputs import NODES as OUTPUT_NODES
from .outputs import OF_HTTP

NODES = frozenset({"acquire", "downsample", "estimate", "health", "http", "vibration"})
NODES |= frozenset(OUTPUT_NODES)
COMPONENTS = NODES | {"service", "history", *OF_HTTP}
COMPONENTS |= {f"{node}_process" for node in (*NODES, "bus")}
"""Every part of the service that reports on itself, beside outputs and their processes.

`service` is the process in which all nodes run, `..._process` that of one node alone; `history` and
the outputs of events are parts of `http`.
"""


_NAME = re.compile(r"[a-z][a-z0-9_-]{0,40}")


def check_component(name: str) -> str:
    """Return `name` if a part of the service, such as an output, may have it; else ValueError."""
    if not _NAME.fullmatch(name):
        raise ValueError(f"{name!r:.60}: expected a small letter, then small letters, digits, _, -")
    return name
