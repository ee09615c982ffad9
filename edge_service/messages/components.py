"""Parts of the service that report on themselves, by name."""

from .outputs import NODES as OUTPUT_NODES
from .outputs import OF_HTTP

NODES = frozenset({"acquire", "downsample", "estimate", "health", "http", "vibration"})
NODES |= frozenset(OUTPUT_NODES)
COMPONENTS = NODES | {"service", "history", *OF_HTTP}
COMPONENTS |= {f"{node}_process" for node in (*NODES, "bus")}
"""Every part of the service that reports on itself; a report of any other is refused.

`service` is the process in which all nodes run, `..._process` that of one node alone; `history` and
the outputs of events are parts of `http`.
"""


def check_component(name: str) -> str:
    """Return `name` if a part of the service has it; raise ValueError if none has."""
    if name not in COMPONENTS:
        raise ValueError(f"{name!r:.60} is not one of {', '.join(sorted(COMPONENTS))}")
    return name
