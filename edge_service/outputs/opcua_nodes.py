"""Address space of the OPC UA output: one machine by OPC 40501-1, 40001-1 and 10000-100.

What the companion specifications ask of a machine and nobody here knows is there, and bad.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.resources import files
from typing import Any

from asyncua import ua
from asyncua.common.instantiate_util import instantiate
from asyncua.common.node import Node
from asyncua.server.server import Server
from asyncua.ua.object_ids import ObjectIds
from asyncua.ua.status_codes import StatusCodes

from ..messages.answer import AxisAnswer
from ..messages.estimate import EstimateStatus
from ..messages.event import AxisCondition
from ..messages.health import AlarmKind
from .base import value_at

OWN = "urn:edge-service:axes"
DI = "http://opcfoundation.org/UA/DI/"
MACHINERY = "http://opcfoundation.org/UA/Machinery/"
MACHINE_TOOL = "http://opcfoundation.org/UA/MachineTool/"
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
_UNITS = {"%": "P1", "N": "NEW", "N m": "NU", "N/m": "4P", "m": "MTR", "s": "SEC", "%/h": ""}
"""UNECE code of each unit (OPC 10000-8, 5.6.4); empty where there is none."""
_DEVICE_HEALTH = {
    AxisCondition.NORMAL: 0,  # NORMAL
    AxisCondition.FAULT: 1,  # FAILURE
    AxisCondition.UNAVAILABLE: 2,  # CHECK_FUNCTION: nothing that is shown may be relied upon
    AxisCondition.WARNING: 4,  # MAINTENANCE_REQUIRED
}
"""DeviceHealthEnumeration (OPC 10000-100, 4.5.4) by the headline's level."""
_BY_ALARM = {AlarmKind.SERVICE: 2, AlarmKind.MODEL: 3}  # 3 is OFF_SPEC
_WITHOUT_NUMBER = {
    EstimateStatus.ESTIMATED: StatusCodes.BadConfigurationError,  # the machine file lacks for it
    EstimateStatus.UNESTIMATED: StatusCodes.BadWaitingForInitialData,
    EstimateStatus.INSUFFICIENT_EXCITATION: StatusCodes.BadNoDataAvailable,
    EstimateStatus.INVALID: StatusCodes.BadSensorFailure,
}
_DOUBLE, _STRING, _TEXT = ua.VariantType.Double, ua.VariantType.String, ua.VariantType.LocalizedText
_TIME, _BOOLEAN = ua.VariantType.DateTime, ua.VariantType.Boolean
Nodes = dict[str, list[ua.NodeId]]


@dataclass(frozen=True, slots=True)
class Field:
    """One variable of an axis."""

    kind: ua.VariantType  # type of its value
    # its path in an answer, or what finds it there; None where there is none
    read: str | Callable[[AxisAnswer], Any]
    unit: str = ""  # of a number
    default: str | None = None  # in place of None


def _device_health(answer: AxisAnswer) -> int | None:
    headline = answer.health.headline
    if headline is None or not answer.is_heard:
        return None
    for alarm in answer.health.alarms:
        if alarm.active and alarm.code == headline.code and alarm.kind in _BY_ALARM:
            return _BY_ALARM[alarm.kind]
    return _DEVICE_HEALTH[headline.level]


def _model_fits(answer: AxisAnswer) -> bool | None:
    doubted = any(each.active and each.kind is AlarmKind.MODEL for each in answer.health.alarms)
    return None if (seen := answer.health.consistency) is None else not (seen.channel or doubted)


def _clear_rate(answer: AxisAnswer) -> float | None:
    rate = value_at(answer, "health.trend.rate_fresh_percent_per_h")
    return None if rate is None or rate.low <= 0.0 <= rate.high else float(rate.value)


PRELOAD, HEALTH, ADVICE, DUE, ALARMS = "Preload", "DeviceHealth", "Advice", "Due", "Alarms"
FIELDS: dict[str, Field] = {
    PRELOAD: Field(_DOUBLE, "of_fresh.value", "%"),
    "PreloadLow": Field(_DOUBLE, "of_fresh.low", "%"),
    "PreloadHigh": Field(_DOUBLE, "of_fresh.high", "%"),
    "PreloadOfRating": Field(_DOUBLE, "estimate.preload_percent", "%"),
    "PreloadForce": Field(_DOUBLE, "estimate.preload_n", "N"),
    "DragTorque": Field(_DOUBLE, "estimate.drag_torque_nm.value", "N m"),
    "Stiffness": Field(_DOUBLE, "estimate.stiffness_n_per_m.value", "N/m"),
    "Status": Field(_STRING, "estimate.status"),
    "Method": Field(_STRING, "estimate.method", default=""),
    "ModelFits": Field(_BOOLEAN, _model_fits),
    "Condition": Field(_STRING, "health.condition"),
    HEALTH: Field(ua.VariantType.Int32, _device_health),
    "Headline": Field(_TEXT, "health.headline.text"),
    "AdviceCode": Field(_STRING, "advice.task", default=""),
    ADVICE: Field(_TEXT, "advice.text", default=""),
    DUE: Field(_TIME, "due_ns"),
    ALARMS: Field(_STRING, lambda of: [each.text for each in of.health.alarms if each.active]),
    "PreloadRate": Field(_DOUBLE, _clear_rate, "%/h"),
    "NextLimit": Field(_TIME, "health.next_limit.earliest_ns"),
    "Distance": Field(_DOUBLE, "health.use.distance_m", "m"),
    "MovingTime": Field(_DOUBLE, "health.use.moving_s", "s"),
    "Reversals": Field(_DOUBLE, "health.use.reversals"),
}
"""Variables of an axis by name."""
_OF_ESTIMATE = tuple(FIELDS)[:7]
_CONVERTED: dict[ua.VariantType, Callable[[Any], Any]] = {
    _DOUBLE: float,
    _TEXT: lambda text: ua.LocalizedText(text, "en"),
    _TIME: lambda time_ns: datetime.fromtimestamp(time_ns / 1e9, UTC),
}


def data_values(answer: AxisAnswer) -> dict[str, ua.DataValue]:
    """Values of all variables of an axis, from the moment of the newest sample behind them.

    One that is not there is null, and its status says why.
    """
    at_ns = answer.measured_ns
    measured = None if at_ns is None else ua.DateTime.fromtimestamp(at_ns / 1e9, UTC)
    values = {}
    for name, field in FIELDS.items():
        read = field.read
        value = value_at(answer, read) if isinstance(read, str) else read(answer)
        value = field.default if value is None else value
        if value is not None:
            value = _CONVERTED.get(field.kind, lambda same: same)(value)
            values[name] = ua.DataValue(ua.Variant(value, field.kind), SourceTimestamp=measured)
            continue
        status = StatusCodes.BadNoDataAvailable
        if not answer.is_heard:
            status = StatusCodes.BadNoCommunication
        elif name in _OF_ESTIMATE:
            status = _WITHOUT_NUMBER[answer.estimate.status]
        values[name] = ua.DataValue(StatusCode=ua.StatusCode(ua.UInt32(status)))
    return values


class AddressSpace:
    """Nodes of one machine, and the variables of each axis by name."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self._index: dict[str, int] = {}
        self.shown: dict[str, Nodes] = {}
        self.told = frozenset[ua.NodeId]()

    async def build(self, machine: str, axes: Sequence[str]) -> None:
        """Make the nodes of a machine and of its axes; what is unknown is bad."""
        await self._load_nodesets()
        machines = self._server.get_node(self._known("machines"))
        root = await self._add(machines, machine, OWN, machine, "machine_tool")
        where = f"{machine}.Components"
        place = await self._add(root, where, MACHINERY, "Components", "components")
        notification = await root.get_child(self._name(MACHINE_TOOL, "Notification"))
        where = f"{machine}.Prognoses"
        prognoses = await self._add(notification, where, MACHINE_TOOL, "Prognoses", "prognoses")
        # A type of our own, as that of DI for components is abstract; it has a health.
        base = self._server.get_node(self._known("component"))
        kind = await base.add_object_type(self._id("FeedAxisType"), self._name(OWN, "FeedAxisType"))
        await kind.add_reference(self._known("device_health"), ObjectIds.HasInterface)
        for axis in axes:
            self.shown[axis] = nodes = await self._axis(place, kind.nodeid, axis)
            where = f"{axis}.Prognosis"
            prognosis = await self._add(prognoses, where, OWN, axis, "maintenance_prognosis")
            for name, child in {ADVICE: "Activity", DUE: "PredictedTime"}.items():
                told = await prognosis.get_child(self._name(MACHINE_TOOL, child))
                nodes[name].append(told.nodeid)
        every = (each for nodes in self.shown.values() for each in nodes.values())
        self.told = frozenset(node for each in every for node in each)
        await self._mark_unknown(root, self.told)

    async def _load_nodesets(self) -> None:
        """Load the companion specifications, without what rests on others beyond these."""
        server = self._server
        for name in ("Di", "IA", "Machinery", "MachineTool"):
            text = files(__package__).joinpath("nodesets", f"Opc.Ua.{name}.NodeSet2.xml")
            known = "|".join(re.escape(str(uri)) for uri in await server.get_namespace_array())
            others = rf'<RequiredModel ModelUri="(?!(?:{known})")[^>]*/>'
            xml = re.sub(others, "", text.read_text(encoding="utf-8-sig"))
            await server.import_xml(xmlstring=xml, strict_mode=False)
        await server.register_namespace(OWN)
        self._index = {str(uri): at for at, uri in enumerate(await server.get_namespace_array())}

    async def _axis(self, place: Node, kind: ua.NodeId, axis: str) -> Nodes:
        name = self._name(OWN, axis)
        node = await place.add_object(self._id(axis), name, kind, instantiate_optional=False)
        await node.add_reference(self._known("device_health"), ObjectIds.HasInterface)
        await self._add(node, f"{axis}.Identification", DI, "Identification", "identification")
        health = await self._variable(node, axis, HEALTH, DI, self._known("health_enumeration"))
        where, name = self._id(f"{axis}.ParameterSet"), self._name(DI, "ParameterSet")
        parameters = await node.add_object(where, name)
        counter = await self._lifetime(node, axis)
        await parameters.add_reference(counter, ObjectIds.HasComponent)
        nodes = {HEALTH: [health], PRELOAD: [counter]}
        for each in FIELDS:
            if each not in nodes:
                nodes[each] = [await self._variable(parameters, axis, each, OWN)]
        return nodes

    async def _lifetime(self, node: Node, axis: str) -> ua.NodeId:
        """Preload in percent of fresh, which wears down from 100; its limits are set later."""
        where = f"{axis}.LifetimeCounters"
        counters = await self._add(node, where, DI, "LifetimeCounters", "lifetime_counters")
        placeholders = await counters.get_children()
        await self._server.delete_nodes(placeholders, recursive=True)
        kind = self._server.get_node(self._known("lifetime_variable"))
        place = self._id(f"{axis}.{PRELOAD}"), self._name(OWN, PRELOAD)
        (counter, *_) = await instantiate(counters, kind, *place, instantiate_optional=False)
        start = await counter.get_child(self._name(DI, "StartValue"))
        await start.write_value(ua.Variant(100.0, _DOUBLE))
        unit = await counter.get_child(ua.QualifiedName("EngineeringUnits"))
        await unit.write_value(_unit("%"))
        warning = self._id(f"{axis}.{PRELOAD}.WarningValues"), self._name(DI, "WarningValues")
        await counter.add_property(*warning, ua.Variant([0.0], _DOUBLE))
        nodeid: ua.NodeId = counter.nodeid
        return nodeid

    async def set_limits(self, answer: AxisAnswer) -> None:
        """Say at which preload an axis is to be maintained, and at which it has failed."""
        limits = answer.health.limits
        if limits is None:
            return
        share = 100.0 / limits.fresh_percent
        counter = self._server.get_node(self._id(f"{answer.axis}.{PRELOAD}"))
        limit = await counter.get_child(self._name(DI, "LimitValue"))
        await limit.write_value(ua.Variant(round(share * limits.fault_percent, 6), _DOUBLE))
        warning = await counter.get_child(self._name(DI, "WarningValues"))
        await warning.write_value(ua.Variant([round(share * limits.warning_percent, 6)], _DOUBLE))

    async def _variable(
        self, parent: Node, axis: str, name: str, uri: str, datatype: ua.NodeId | None = None
    ) -> ua.NodeId:
        field = FIELDS[name]
        where, kind = self._id(f"{axis}.{name}"), datatype or ua.NodeId(ua.Int32(field.kind.value))
        variable = await parent.add_variable(where, self._name(uri, name), None, datatype=kind)
        if name == ALARMS:
            await variable.write_value_rank(ua.ValueRank.OneDimension)
        if field.unit:
            where = self._id(f"{axis}.{name}.EngineeringUnits")
            units = ua.QualifiedName("EngineeringUnits")
            await variable.add_property(where, units, _unit(field.unit))
        return variable.nodeid

    async def _add(self, parent: Node, where: str, uri: str, name: str, kind: str) -> Node:
        """An instance of a type of the nodesets, with what is mandatory in it."""
        place = self._id(where), self._name(uri, name)
        return await parent.add_object(*place, self._known(kind), instantiate_optional=False)

    async def _mark_unknown(self, node: Node, known: frozenset[ua.NodeId]) -> None:
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
        return ua.NodeId(ua.String(name), ua.Int16(self._index[OWN]))

    def _name(self, uri: str, name: str) -> ua.QualifiedName:
        return ua.QualifiedName(name, self._index[uri])


def _unit(unit: str) -> ua.Variant:
    number = int.from_bytes(_UNITS[unit].encode()) or -1
    text = ua.LocalizedText(unit, "en")
    namespace = "http://www.opcfoundation.org/UA/units/un/cefact"
    told = ua.EUInformation(namespace, number, text, text)
    return ua.Variant(told, ua.VariantType.ExtensionObject)
