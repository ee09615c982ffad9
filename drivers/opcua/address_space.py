"""The address space of the stub: the variables that a configuration names, with their units.

Plain names get objects along their path. Where the Machine Tool companion specification (OPC
40501-1) is loaded, what stands below `Machines` is an instance of its MachineToolType.
"""

import math
import re
from pathlib import Path

from asyncua import ua
from asyncua.common.node import Node
from asyncua.server.server import Server
from asyncua.ua.uaerrors import UaStatusCodeError

from ..base import DriverMisconfiguredError
from .config import NodeConfig
from .names import browse_path, is_path, node_id
from .units import NAMESPACE, code_of_unit

NODESETS = ("Di", "IA", "Machinery", "MachineTool")
"""In the order in which one needs another; files `Opc.Ua.NAME.NodeSet2.xml`."""
MACHINE_TOOL = "http://opcfoundation.org/UA/MachineTool/"
OWN = "urn:edge-service:feed-drive"


async def load_nodesets(server: Server, folder: Path) -> None:
    """Load the companion specifications. Raises DriverMisconfiguredError.

    Parts that rest on specifications beyond these (jobs and their control) are left out.
    """
    for name in NODESETS:
        path = folder / f"Opc.Ua.{name}.NodeSet2.xml"
        if not path.is_file():
            raise DriverMisconfiguredError("nodesets", f"{path}: no such file")
        text = path.read_text(encoding="utf-8-sig")
        known = [str(uri) for uri in await server.get_namespace_array()]
        await server.import_xml(xmlstring=_without_missing(text, known), strict_mode=False)


def _without_missing(text: str, known: list[str]) -> str:
    """A nodeset that no longer demands the models that are not there."""

    def keep(element: re.Match[str]) -> str:
        return element[0] if element[1] in known else ""

    return re.sub(r'<RequiredModel ModelUri="([^"]+)"[^>]*/>', keep, text)


async def add_signal(server: Server, axis: str, signal: NodeConfig) -> Node:
    """The variable that a signal names. Raises DriverMisconfiguredError."""
    try:
        namespaces = await _namespaces(server, signal.node)
        if is_path(signal.node):
            return await _add_at_path(server, browse_path(signal.node, namespaces), signal)
        folder = await _child(server.nodes.objects, f"2:{axis}", server)
        name = ua.QualifiedName(signal.channel or "heartbeat", ua.UInt16(2))
        return await _add_variable(folder, node_id(signal.node, namespaces), name, signal)
    except (ValueError, UaStatusCodeError) as error:
        raise DriverMisconfiguredError("signals", f"{signal.node!r}: {error}") from None


async def _namespaces(server: Server, name: str) -> list[str]:
    """All namespaces, with those that a name brings along."""
    uris = [part.partition("}")[0] for part in name.split("{")[1:]]
    if name.startswith("nsu="):
        uris.append(name.removeprefix("nsu=").partition(";")[0])
    for uri in uris:
        await server.register_namespace(uri)
    return [str(uri) for uri in await server.get_namespace_array()]


async def _add_at_path(server: Server, path: list[str], signal: NodeConfig) -> Node:
    parent = server.nodes.objects
    for step in path[:-1]:
        parent = await _child(parent, step, server)
    name = ua.QualifiedName.from_string(path[-1])
    return await _add_variable(parent, ua.NodeId(ua.Int32(0), name.NamespaceIndex), name, signal)


async def _child(parent: Node, step: str, server: Server) -> Node:
    """The object of that browse name; added where it is not there."""
    try:
        return await parent.get_child(step)
    except UaStatusCodeError:
        name = ua.QualifiedName.from_string(step)
    kind = await _machine_type(parent, server)
    new = ua.NodeId(ua.Int32(0), name.NamespaceIndex)
    return await parent.add_object(new, name, objecttype=kind, instantiate_optional=False)


async def _machine_type(parent: Node, server: Server) -> ua.NodeId | None:
    """MachineToolType for a child of Machines, else nothing."""
    namespaces = await server.get_namespace_array()
    name = await parent.read_browse_name()
    if name.Name != "Machines" or MACHINE_TOOL not in namespaces:
        return None
    index = namespaces.index(MACHINE_TOOL)
    kind = await server.nodes.base_object_type.get_child(f"{index}:MachineToolType")
    return kind.nodeid


async def _add_variable(
    parent: Node, where: ua.NodeId, name: ua.QualifiedName, signal: NodeConfig
) -> Node:
    variable = await parent.add_variable(
        where, name, ua.Variant(math.nan, ua.VariantType.Double), datatype=ua.NodeId(ua.Int32(11))
    )
    if signal.channel is not None:
        unit = signal.declared_unit if signal.scale == 1.0 else ""
        if unit:
            await variable.add_property(
                ua.NodeId(ua.Int32(0), name.NamespaceIndex),
                ua.QualifiedName("EngineeringUnits", ua.UInt16(0)),
                _engineering_unit(unit),
            )
    return variable


def _engineering_unit(unit: str) -> ua.Variant:
    text = ua.LocalizedText(unit)
    information = ua.EUInformation(NAMESPACE, ua.Int32(code_of_unit(unit)), text, text)
    return ua.Variant(information, ua.VariantType.ExtensionObject)
