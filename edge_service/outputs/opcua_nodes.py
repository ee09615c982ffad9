"""Address space of the OPC UA output: one machine by OPC 40501-1, 40001-1 and 10000-100.

What the companion specifications ask of a machine and nobody here knows is there, and bad.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.resources import files

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
from ..messages.interval import Interval

OWN = "urn:edge-service:axes"
DI, IA = "http://opcfoundation.org/UA/DI/", "http://opcfoundation.org/UA/IA/"
MACHINERY = "http://opcfoundation.org/UA/Machinery/"
MACHINE_TOOL = "http://opcfoundation.org/UA/MachineTool/"
_NODESETS = ("Di", "IA", "Machinery", "MachineTool")
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
_Value = float | int | str | bool | datetime | list[str] | ua.LocalizedText | None
Nodes = dict[str, list[ua.NodeId]]


@dataclass(frozen=True, slots=True)
class Field:
    """One variable of an axis.

    Attributes:
        kind: type of its value.
        read: value in an answer; None where there is none.
        unit: of a number.
        is_list: whether there are several values.
    """

    kind: ua.VariantType
    read: Callable[[AxisAnswer], _Value]
    unit: str = ""
    is_list: bool = False


def _bound(interval: Interval | None, bound: str = "value") -> float | None:
    return None if interval is None else float(getattr(interval, bound))


def _text(said: str | None) -> ua.LocalizedText | None:
    return None if said is None else ua.LocalizedText(said, "en")


def _time(time_ns: int | None) -> datetime | None:
    return None if time_ns is None else datetime.fromtimestamp(time_ns / 1e9, UTC)


def _rate(answer: AxisAnswer) -> float | None:
    trend = answer.health.trend
    return None if trend is None else _bound(trend.rate_fresh_percent_per_h)


def _next_limit_ns(answer: AxisAnswer) -> int | None:
    limit = answer.health.next_limit
    return None if limit is None else limit.earliest_ns


def _headline(answer: AxisAnswer) -> ua.LocalizedText | None:
    headline = answer.health.headline
    return None if headline is None else _text(headline.text)


def _device_health(answer: AxisAnswer) -> int | None:
    headline = answer.health.headline
    if headline is None or not answer.is_heard:
        return None
    for alarm in answer.health.alarms:
        if alarm.active and alarm.code == headline.code and alarm.kind in _BY_ALARM:
            return _BY_ALARM[alarm.kind]
    return _DEVICE_HEALTH[headline.level]


def _model_fits(answer: AxisAnswer) -> bool | None:
    consistency = answer.health.consistency
    return None if consistency is None else consistency.channel is None


def _alarms(answer: AxisAnswer) -> list[str]:
    return [alarm.text for alarm in answer.health.alarms if alarm.active]


def _use(name: str) -> Callable[[AxisAnswer], float | None]:
    def read(answer: AxisAnswer) -> float | None:
        use = answer.health.use
        return None if use is None else float(getattr(use, name))

    return read


PRELOAD, HEALTH, ADVICE, DUE = "Preload", "DeviceHealth", "Advice", "Due"
FIELDS: dict[str, Field] = {
    PRELOAD: Field(_DOUBLE, lambda each: _bound(each.of_fresh), "%"),
    "PreloadLow": Field(_DOUBLE, lambda each: _bound(each.of_fresh, "low"), "%"),
    "PreloadHigh": Field(_DOUBLE, lambda each: _bound(each.of_fresh, "high"), "%"),
    "PreloadOfRating": Field(_DOUBLE, lambda each: each.estimate.preload_percent, "%"),
    "PreloadForce": Field(_DOUBLE, lambda each: each.estimate.preload_n, "N"),
    "DragTorque": Field(_DOUBLE, lambda each: _bound(each.estimate.drag_torque_nm), "N m"),
    "Stiffness": Field(_DOUBLE, lambda each: _bound(each.estimate.stiffness_n_per_m), "N/m"),
    "Status": Field(_STRING, lambda each: each.estimate.status.value),
    "Method": Field(_STRING, lambda each: each.estimate.method or ""),
    "ModelFits": Field(ua.VariantType.Boolean, _model_fits),
    "Condition": Field(_STRING, lambda each: each.health.condition.value),
    HEALTH: Field(ua.VariantType.Int32, _device_health),
    "Headline": Field(_TEXT, _headline),
    "AdviceCode": Field(_STRING, lambda each: each.advice.task.value if each.advice else ""),
    ADVICE: Field(_TEXT, lambda each: _text(each.advice.text if each.advice else "")),
    DUE: Field(ua.VariantType.DateTime, lambda each: _time(each.due_ns)),
    "Alarms": Field(_STRING, _alarms, is_list=True),
    "PreloadRate": Field(_DOUBLE, _rate, "%/h"),
    "NextLimit": Field(ua.VariantType.DateTime, lambda each: _time(_next_limit_ns(each))),
    "Distance": Field(_DOUBLE, _use("distance_m"), "m"),
    "MovingTime": Field(_DOUBLE, _use("moving_s"), "s"),
    "Reversals": Field(_DOUBLE, _use("reversals")),
}
"""Variables of an axis by name."""
_OF_ESTIMATE = tuple(FIELDS)[:7]


def data_values(answer: AxisAnswer) -> dict[str, ua.DataValue]:
    """Values of all variables of an axis, from the moment of the newest sample behind them.

    One that is not there is null, and its status says why.
    """
    measured = None
    if answer.measured_ns is not None:
        measured = ua.DateTime.fromtimestamp(answer.measured_ns / 1e9, UTC)
    values = {}
    for name, field in FIELDS.items():
        value = field.read(answer)
        if value is not None:
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
    """Builds the nodes of one machine."""

    def __init__(self, server: Server, namespaces: Sequence[str]) -> None:
        self._server = server
        self._index = {uri: index for index, uri in enumerate(namespaces)}

    async def build(self, machine: str, axes: Sequence[str]) -> dict[str, Nodes]:
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
        # A type of our own, as that of DI for components is abstract; it has a health.
        base = self._server.get_node(self._known("component"))
        kind = await base.add_object_type(self._id("FeedAxisType"), self._name(OWN, "FeedAxisType"))
        await kind.add_reference(self._known("device_health"), ObjectIds.HasInterface)
        shown = {}
        for axis in axes:
            nodes = await self._axis(place, kind.nodeid, axis)
            where = f"{axis}.Prognosis"
            prognosis = await self._add(prognoses, where, OWN, axis, "maintenance_prognosis")
            for name, child in {ADVICE: "Activity", DUE: "PredictedTime"}.items():
                told = await prognosis.get_child(self._name(MACHINE_TOOL, child))
                nodes[name].append(told.nodeid)
            shown[axis] = nodes
        known = {node for nodes in shown.values() for each in nodes.values() for node in each}
        await self._mark_unknown(root, known)
        return shown

    async def _axis(self, place: Node, kind: ua.NodeId, axis: str) -> Nodes:
        node = await place.add_object(
            self._id(axis), self._name(OWN, axis), kind, instantiate_optional=False
        )
        await node.add_reference(self._known("device_health"), ObjectIds.HasInterface)
        await self._add(node, f"{axis}.Identification", DI, "Identification", "identification")
        health = await self._variable(node, axis, HEALTH, DI, self._known("health_enumeration"))
        parameters = await node.add_object(
            self._id(f"{axis}.ParameterSet"), self._name(DI, "ParameterSet")
        )
        counter = await self._lifetime(node, axis)
        await parameters.add_reference(counter, ObjectIds.HasComponent)
        nodes = {HEALTH: [health], PRELOAD: [counter]}
        for name in FIELDS:
            if name not in nodes:
                nodes[name] = [await self._variable(parameters, axis, name, OWN)]
        return nodes

    async def _lifetime(self, node: Node, axis: str) -> ua.NodeId:
        """Preload in percent of fresh, which wears down from 100; its limits are set later."""
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
        start = await counter.get_child(self._name(DI, "StartValue"))
        await start.write_value(ua.Variant(100.0, _DOUBLE))
        unit = await counter.get_child(ua.QualifiedName("EngineeringUnits"))
        await unit.write_value(_unit("%"))
        await counter.add_property(
            self._id(f"{axis}.{PRELOAD}.WarningValues"),
            self._name(DI, "WarningValues"),
            ua.Variant([0.0], _DOUBLE),
        )
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
        variable = await parent.add_variable(
            self._id(f"{axis}.{name}"),
            self._name(uri, name),
            None,
            datatype=datatype or ua.NodeId(ua.Int32(field.kind.value)),
        )
        if field.is_list:
            await variable.write_value_rank(ua.ValueRank.OneDimension)
        if field.unit:
            where = self._id(f"{axis}.{name}.EngineeringUnits")
            units = ua.QualifiedName("EngineeringUnits")
            await variable.add_property(where, units, _unit(field.unit))
        return variable.nodeid

    async def _add(self, parent: Node, where: str, uri: str, name: str, kind: str) -> Node:
        """An instance of a type of the nodesets, with what is mandatory in it."""
        return await parent.add_object(
            self._id(where), self._name(uri, name), self._known(kind), instantiate_optional=False
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
        return ua.NodeId(ua.String(name), ua.Int16(self._index[OWN]))

    def _name(self, uri: str, name: str) -> ua.QualifiedName:
        return ua.QualifiedName(name, self._index[uri])


def _unit(unit: str) -> ua.Variant:
    number = 0
    for letter in _UNITS[unit]:
        number = 256 * number + ord(letter)
    text = ua.LocalizedText(unit, "en")
    namespace = "http://www.opcfoundation.org/UA/units/un/cefact"
    told = ua.EUInformation(namespace, number or -1, text, text)
    return ua.Variant(told, ua.VariantType.ExtensionObject)


async def load_nodesets(server: Server) -> list[str]:
    """Load the companion specifications; returns the namespaces.

    Parts that rest on specifications beyond these (jobs and their control) are left out.
    """
    for name in _NODESETS:
        path = files(__package__) / "nodesets" / f"Opc.Ua.{name}.NodeSet2.xml"
        known = [str(uri) for uri in await server.get_namespace_array()]

        def kept(element: re.Match[str], known: Sequence[str] = known) -> str:
            return element[0] if element[1] in known else ""

        text = path.read_text(encoding="utf-8-sig")
        text = re.sub(r'<RequiredModel ModelUri="([^"]+)"[^>]*/>', kept, text)
        await server.import_xml(xmlstring=text, strict_mode=False)
    await server.register_namespace(OWN)
    return [str(uri) for uri in await server.get_namespace_array()]
