"""The one table of outputs: what carries answers out of the house."""

from dataclasses import dataclass

HTTP = "http"


@dataclass(frozen=True, slots=True)
class Output:
    """One row of the table.

    Attributes:
        name: of its component, and of its table in the configuration.
        node: that runs it: one of its own name, or `http`.
        keeps: whether messages wait on the disk, and those refused for good lie there.
    """

    name: str
    node: str
    keeps: bool


_TABLE = (
    Output("webhook", HTTP, keeps=True),
    Output("email", HTTP, keeps=True),
    Output("mqtt", "mqtt", keeps=True),
    Output("opcua", "opcua", keeps=False),
    Output("mtconnect", "mtconnect", keeps=False),
)
OUTPUTS = {output.name: output for output in _TABLE}
OF_HTTP = tuple(output.name for output in _TABLE if output.node == HTTP)
"""Outputs of events, which the node `http` keeps."""
NODES = tuple(output.node for output in _TABLE if output.node != HTTP)
"""Nodes that are outputs."""
KEEPING = frozenset(output.name for output in _TABLE if output.keeps)
