"""Address space of the server: one machine with its axes, by OPC 40501-1, 40001-1 and 10000-100.

What the companion specifications ask of a machine and nobody here knows is there, and bad.
"""

import re
from collections.abc import Sequence
from importlib.resources import files

from asyncua import ua
from asyncua.common.instantiate_util import instantiate
from asyncua.common.node import Node
from asyncua.server.server import Server
from asyncua.ua.object_ids import ObjectIds
from asyncua.ua.status_codes import StatusCodes

from ...messages.answer import AxisAnswer
from .values import ADVICE, DOUBLE, DUE, FIELDS, HEALTH, PRELOAD, Field

OWN = "urn:edge-service:axes"
DI, IA = "http://opcfoundation.org/UA/DI/", "http://opcfoundation.org/UA/IA/"
MACHINERY = "http://opcfoundation.org/UA/Machinery/"
MACHINE_TOOL = "http://opcfoundation.org/UA/MachineTool/"
_NODESETS = ("Di", "IA", "Machinery", "MachineTool")
_PERCENT = 20529  # the UNECE code P1 (OPC 10000-8, 5.6.4)
_NUMBERED = {
    "component": (DI, 15063),
    "device_health": (DI, 15051),
    "health_enumeration": (DI, 6244),
    "lifetime_variable": (DI, 468),
    "machines": (MACHINERY, 1001),
    "components": (MACHINERY, 1006),
    "identification": (MACHINERY, 1005),
    "lifetime_counters": (MACHINERY, 1015),
    "prognoses": (MACHINE_TOOL, 2),
    "maintenance_prognosis": (MACHINE_TOOL, 9),
    "machine_tool": (MACHINE_TOOL, 13),
}
"""Nodes of the nodesets by their numbers there."""
Nodes = dict[str, list[ua.NodeId]]


class AddressSpace:
    """Builds the nodes of one machine."""

    def __init__(self, server: Server, namespaces: Sequence[str]) -> None:
        self._server = server
        self._index = {uri: index for index, uri in enumerate(namespaces)}
        self.own = self._index[OWN]

    async def build(self, machine: str, answers: Sequence[AxisAnswer]) -> dict[str, Nodes]:
        """Nodes that show each variable, by axis and name; what is unknown is bad."""
        machines = self._server.get_node(self._known("machines"))
        root = await self._add(machines, machine, OWN, machine, "machine_tool")
        place = await self._add(
            root, f"{machine}.Components", MACHINERY, "Components", "components"
        )
        notification = await root.get_child(self._name(MACHINE_TOOL, "Notification"))
        prognoses = await self._add(
            notification, f"{machine}.Prognoses", MACHINE_TOOL, "Prognoses", "prognoses"
        )
        kind = await self._axis_type()
        shown = {each.axis: await self._axis(place, kind, each) for each in answers}
        for axis, nodes in shown.items():
            await self._prognosis(prognoses, axis, nodes)
        known = {node for nodes in shown.values() for each in nodes.values() for node in each}
        await self._mark_unknown(root, known)
        return shown

    async def _axis_type(self) -> ua.NodeId:
        """Own type of component, as that of DI is abstract; it has a health."""
        base = self._server.get_node(self._known("component"))
        name = self._name(OWN, "FeedAxisType")
        kind = await base.add_object_type(self._id("FeedAxisType"), name)
        await kind.add_reference(self._known("device_health"), ObjectIds.HasInterface)
        return kind.nodeid

    async def _axis(self, place: Node, kind: ua.NodeId, answer: AxisAnswer) -> Nodes:
        axis = answer.axis
        node = await place.add_object(
            self._id(axis), self._name(OWN, axis), kind, instantiate_optional=False
        )
        await node.add_reference(self._known("device_health"), ObjectIds.HasInterface)
        await self._add(node, f"{axis}.Identification", DI, "Identification", "identification")
        health = await self._variable(node, axis, HEALTH, DI, self._known("health_enumeration"))
        parameters = await node.add_object(
            self._id(f"{axis}.ParameterSet"), self._name(DI, "ParameterSet")
        )
        counter = await self._lifetime(node, answer)
        await parameters.add_reference(counter, ObjectIds.HasComponent)
        nodes = {HEALTH: [health], PRELOAD: [counter]}
        for name in (each for each in FIELDS if each not in nodes):
            nodes[name] = [await self._variable(parameters, axis, name, OWN)]
        return nodes

    async def _lifetime(self, node: Node, answer: AxisAnswer) -> ua.NodeId:
        """Preload in percent of fresh, which wears down from 100 to the limit of a fault."""
        axis = answer.axis
        counters = await self._add(
            node, f"{axis}.LifetimeCounters", DI, "LifetimeCounters", "lifetime_counters"
        )
        await self._server.delete_nodes(
            await counters.get_children(), recursive=True
        )  # placeholder
        (counter, *_) = await instantiate(
            counters,
            self._server.get_node(self._known("lifetime_variable")),
            self._id(f"{axis}.{PRELOAD}"),
            self._name(OWN, PRELOAD),
            instantiate_optional=False,
        )
        for name, value in (
            (self._name(DI, "StartValue"), ua.Variant(100.0, DOUBLE)),
            (self._name(DI, "LimitValue"), ua.Variant(answer.fault_of_fresh, DOUBLE)),
            (ua.QualifiedName("EngineeringUnits"), _percent()),
        ):
            await (await counter.get_child(name)).write_value(value)
        warning = ua.Variant([answer.warning_of_fresh], DOUBLE)
        await self._property(counter, self._name(DI, "WarningValues"), warning)
        nodeid: ua.NodeId = counter.nodeid
        return nodeid

    async def _prognosis(self, prognoses: Node, axis: str, nodes: Nodes) -> None:
        where = f"{axis}.Prognosis"
        prognosis = await self._add(prognoses, where, OWN, axis, "maintenance_prognosis")
        for name, child in {ADVICE: "Activity", DUE: "PredictedTime"}.items():
            nodes[name].append((await prognosis.get_child(self._name(MACHINE_TOOL, child))).nodeid)

    async def _variable(
        self, parent: Node, axis: str, name: str, uri: str, datatype: ua.NodeId | None = None
    ) -> ua.NodeId:
        field: Field = FIELDS[name]
        variable = await parent.add_variable(
            self._id(f"{axis}.{name}"),
            self._name(uri, name),
            None,
            datatype=datatype or ua.NodeId(ua.Int32(field.kind.value)),
        )
        if field.is_list:
            await variable.write_value_rank(ua.ValueRank.OneDimension)
        if field.unit:
            await self._property(variable, ua.QualifiedName("EngineeringUnits"), _percent())
        return variable.nodeid

    async def _property(self, node: Node, name: ua.QualifiedName, value: ua.Variant) -> None:
        where = f"{node.nodeid.Identifier!s}.{name.Name}"
        await node.add_property(self._id(where), name, value)

    async def _add(self, parent: Node, where: str, uri: str, name: str, kind: str) -> Node:
        """An instance of a type of the nodesets, with what is mandatory in it."""
        return await parent.add_object(
            self._id(where),
            self._name(uri, name),
            self._known(kind),
            instantiate_optional=False,
        )

    async def _mark_unknown(self, node: Node, known: set[ua.NodeId]) -> None:
        """Say of all variables below a node that have no value that there is none."""
        for child in await node.get_children():
            if await child.read_node_class() == ua.NodeClass.Variable and child.nodeid not in known:
                read = await child.read_data_value(raise_on_bad_status=False)
                if read.Value is None or read.Value.Value is None:
                    status = ua.StatusCode(ua.UInt32(StatusCodes.BadNoDataAvailable))
                    await child.write_value(ua.DataValue(StatusCode=status))
            await self._mark_unknown(child, known)

    def _known(self, name: str) -> ua.NodeId:
        uri, number = _NUMBERED[name]
        return ua.NodeId(ua.Int32(number), ua.Int16(self._index[uri]))

    def _id(self, name: str) -> ua.NodeId:
        return ua.NodeId(ua.String(name), ua.Int16(self.own))

    def _name(self, uri: str, name: str) -> ua.QualifiedName:
        return ua.QualifiedName(name, self._index[uri])


def _percent() -> ua.Variant:
    text = ua.LocalizedText("%", "en")
    namespace = "http://www.opcfoundation.org/UA/units/un/cefact"
    unit = ua.EUInformation(namespace, _PERCENT, text, text)
    return ua.Variant(unit, ua.VariantType.ExtensionObject)


async def load_nodesets(server: Server) -> list[str]:
    """Load the companion specifications; returns the namespaces.

    Parts that rest on specifications beyond these (jobs and their control) are left out.
    """
    for name in _NODESETS:
        path = files(__package__) / "nodesets" / f"Opc.Ua.{name}.NodeSet2.xml"
        known = [str(uri) for uri in await server.get_namespace_array()]
        text = _without_missing(path.read_text(encoding="utf-8-sig"), known)
        await server.import_xml(xmlstring=text, strict_mode=False)
    await server.register_namespace(OWN)
    return [str(uri) for uri in await server.get_namespace_array()]


def _without_missing(text: str, known: Sequence[str]) -> str:
    """A nodeset that no longer demands the models that are not there."""

    def keep(element: re.Match[str]) -> str:
        return element[0] if element[1] in known else ""

    return re.sub(r'<RequiredModel ModelUri="([^"]+)"[^>]*/>', keep, text)
