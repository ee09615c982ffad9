"""MTConnect: an adapter that tells agents by SHDR, and the description of the machine for them.

Sources: Adapter Agent Protocol Version 2.0 (https://mtcup.org/Protocol); quoting as the agent reads
it (`ShdrTokenizer` of https://github.com/mtconnect/cppagent).
"""

import asyncio
import re
import socket
from collections.abc import Sequence
from datetime import UTC, datetime
from xml.etree import ElementTree

from pydantic import model_validator

from .. import __version__
from ..atomic import write_whole
from ..clock import now_ns
from ..messages.answer import AxisAnswer
from .base import (
    ListeningConfig,
    Message,
    Output,
    OutputContext,
    OutputUnavailableError,
    value_at,
)

CLIENTS = 10
"""Agents that there may be at once."""
HEARTBEAT_S = 1.5
"""Time within which an agent asks for a sign of life again; after twice that it knows nothing."""
UNREAD_BYTES = 1_000_000
"""Bytes that may wait for a client that does not read; then it is cut off."""
LINE_BYTES = 1024
DEVICES_FILE = "mtconnect-devices.xml"
UNAVAILABLE = "UNAVAILABLE"
SAMPLES = {
    "preload": ("x:PRELOAD", "PERCENT", "", "of_fresh.value"),
    "preloadLow": ("x:PRELOAD", "PERCENT", "x:LOW", "of_fresh.low"),
    "preloadHigh": ("x:PRELOAD", "PERCENT", "x:HIGH", "of_fresh.high"),
    "preloadForce": ("LINEAR_FORCE", "NEWTON", "", "estimate.preload_n"),
    "dragTorque": ("TORQUE", "NEWTON_METER", "", "estimate.drag_torque_nm.value"),
}
"""Type, units, subtype and path in an answer of each number, by name; none holds an underscore."""
_CONDITIONS = {"condition": "ACTUATOR", "alarms": "SYSTEM"}
_CONTROL = re.compile(r"[\x00-\x1f\x7f\x85\u2028\u2029]+")
Values = dict[tuple[str, str], tuple[str, ...]]
"""Fields of data items, by name and, of a condition, native code."""


class MtconnectConfig(ListeningConfig):
    scheme, usual_port = "tcp", 7878
    endpoint: str = "tcp://127.0.0.1:7878"  # where agents connect
    # also beyond loopback, where others may read along; the protocol has neither encryption nor
    # login
    allow_plain: bool = False

    @model_validator(mode="after")
    def _guarded(self) -> "MtconnectConfig":
        if not (self.is_local or self.allow_plain):
            problem = "is not a loopback address: anyone may read there; it needs allow_plain"
            raise ValueError(f"endpoint: {self.place[0]!r} {problem}")
        return self


class MtconnectOutput(Output):
    """Adapter for bounded clients, which can ask for nothing but a sign of life."""

    config_model = MtconnectConfig

    def __init__(self, config: MtconnectConfig, context: OutputContext) -> None:
        super().__init__(config, context)
        self.clients: set[_Client] = set()
        self.told: dict[str, tuple[Values, int | None]] = {}
        self._server: asyncio.Server | None = None

    @property
    def readings(self) -> dict[str, float]:
        return {"clients": float(len(self.clients))}

    @property
    def port(self) -> int:
        """The port at which it listens; 0 before."""
        return 0 if self._server is None else int(self._server.sockets[0].getsockname()[1])

    async def open(self) -> None:
        if self._server is not None:
            return
        host, port = self.config.place
        try:
            if self.context.folder is not None:
                write_whole(self.context.folder / DEVICES_FILE, devices_xml(self.context, now_ns()))
            loop = asyncio.get_running_loop()
            self._server = await loop.create_server(lambda: _Client(self), host, port)
        except OSError as error:
            raise OutputUnavailableError(f"{host}:{port}: {error.strerror}") from None

    async def take(self, message: Message) -> None:
        """Tell all agents what has changed on an axis."""
        if self._server is None:
            raise OutputUnavailableError("not open")
        assert isinstance(message, AxisAnswer)
        before, values = self.told.get(message.axis, ({}, None))[0], values_of(message)
        self.told[message.axis] = values, message.measured_ns
        news = lines(changes(before, values), now_ns(), message.measured_ns)
        for client in tuple(self.clients):
            client.tell(news)

    async def close(self) -> None:
        server, self._server = self._server, None
        if server is not None:
            server.close()
        for client in tuple(self.clients):
            client.transport.abort()


class _Client(asyncio.Protocol):
    transport: asyncio.Transport

    def __init__(self, output: MtconnectOutput) -> None:
        self._output = output
        self._begun = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Greet with all that is known, or refuse one too many."""
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        if len(self._output.clients) >= CLIENTS:
            transport.abort()
            return
        self._output.clients.add(self)
        transport.set_write_buffer_limits(high=UNREAD_BYTES)
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        greeting = [f"* adapterVersion: {__version__}", "* shdrVersion: 2.0"]
        greeting += ["* mtconnectVersion: 2.0", _line(now_ns(), "avail", "AVAILABLE")]
        for values, measured_ns in self._output.told.values():
            greeting += lines(values, now_ns(), measured_ns)
        self.tell(greeting)

    def connection_lost(self, exc: Exception | None) -> None:
        self._output.clients.discard(self)

    def pause_writing(self) -> None:
        """Cut off whoever does not read."""
        self.transport.abort()

    def data_received(self, data: bytes) -> None:
        """Answer signs of life; all else is ignored, and a line without end ends the connection."""
        *whole, self._begun = (self._begun + data).split(b"\n")
        if len(self._begun) > LINE_BYTES:
            self.transport.abort()
        elif any(line.strip() == b"* PING" for line in whole):
            self.tell([f"* PONG {HEARTBEAT_S * 1000.0:.0f}"])

    def tell(self, told: Sequence[str]) -> None:
        if told and not self.transport.is_closing():
            self.transport.write(("\n".join(told) + "\n").encode())


def values_of(answer: AxisAnswer) -> Values:
    """All that an answer says, by data item."""
    axis, health = answer.axis, answer.health
    values: Values = {}
    for name, (*_, path) in SAMPLES.items():
        number = value_at(answer, path) if answer.is_heard else None
        values[f"{name}_{axis}", ""] = (UNAVAILABLE if number is None else f"{number:.6g}",)
    advice = ("", "") if answer.is_heard else ("", UNAVAILABLE)
    if answer.is_heard and answer.advice is not None:
        due = "" if answer.due_ns is None else f" ({_moment(answer.due_ns):%Y-%m-%d})"
        advice = answer.advice.task.value, answer.advice.text + due
    values[f"advice_{axis}", ""] = advice
    level, text = health.condition.value, value_at(health, "headline.text") or ""
    # One native code for every bad condition, so that a new one replaces the last.
    told = ("", "", "", "") if level in (UNAVAILABLE, "NORMAL") else ("PRELOAD", "", "LOW", text)
    values[f"condition_{axis}", ""] = level, *told
    is_missing = any(each.startswith(("no_health:", "stale_health:")) for each in health.reasons)
    active = [alarm for alarm in health.alarms if alarm.active and not is_missing]
    for alarm in active:
        level, code = alarm.level.value, alarm.kind.value
        level = "WARNING" if level == UNAVAILABLE else level
        values[f"alarms_{axis}", code] = level, code, "", "", alarm.text
    if not active:
        values[f"alarms_{axis}", ""] = UNAVAILABLE if is_missing else "NORMAL", "", "", "", ""
    return values


def changes(before: Values, after: Values) -> Values:
    """Fields that tell the changes to an agent that knows the values before."""
    told = {key: fields for key, fields in after.items() if before.get(key) != fields}
    for name, code in before.keys() - after.keys():
        if code and (name, "") not in after:  # another is active still, and this one is over
            told[name, code] = ("NORMAL", code, "", "", "")
    return told


def lines(values: Values, at_ns: int, measured_ns: int | None = None) -> list[str]:
    """Lines without their ends: of all numbers, and one for each condition and message.

    Args:
        at_ns: UNIX time of what is judged, ns.
        measured_ns: that of the sample behind the numbers; None where there is none.
    """
    known, missing, others = list[str](), list[str](), list[str]()
    for (name, _), fields in values.items():
        if len(fields) > 1:
            others.append(_line(at_ns, name, *fields))
        else:
            pairs = missing if fields == (UNAVAILABLE,) else known
            pairs += (name, *fields)
    numbers = [_line(at_ns, *missing)] if missing else []
    numbers += [_line(measured_ns or at_ns, *known)] if known else []
    return numbers + others


def field(text: str) -> str:
    """Text as a field: on one line, quoted where it holds what would end or begin one."""
    plain = _CONTROL.sub(" ", text).strip()
    if "|" not in plain and not plain.startswith('"'):
        return plain
    return '"' + re.sub(r'([\\|"])', r"\\\1", plain) + '"'


def _line(time_ns: int, *parts: str) -> str:
    moment = f"{_moment(time_ns):%Y-%m-%dT%H:%M:%S}.{time_ns % 1_000_000_000 // 1000:06d}Z"
    return "|".join((moment, *(field(part) for part in parts)))


def _moment(time_ns: int) -> datetime:
    return datetime.fromtimestamp(time_ns // 1_000_000_000, UTC)


def devices_xml(context: OutputContext, at_ns: int) -> str:
    """Description of the machine for an agent, `Devices.xml` of MTConnect 2.0: all data items."""
    add, space = ElementTree.SubElement, "urn:mtconnect.org:MTConnectDevices:2.0"
    own = "urn:edge-service:MTConnectDevices:2.0"
    root = ElementTree.Element("MTConnectDevices", {"xmlns": space, "xmlns:x": own})
    created = f"{_moment(at_ns):%Y-%m-%dT%H:%M:%SZ}"
    header = {"creationTime": created, "sender": "edge-service", "instanceId": "1"}
    header |= {"version": "2.0", "deviceModelChangeTime": created, "assetBufferSize": "1024"}
    add(root, "Header", header | {"assetCount": "0", "bufferSize": "131072"})
    names = {"name": context.machine, "uuid": f"{context.site}.{context.machine}"}
    device = add(add(root, "Devices"), "Device", {"id": "machine"} | names)

    def item(items: ElementTree.Element, name: str, kind: str, facts: dict[str, str]) -> None:
        add(items, "DataItem", {"id": name, "name": name, "type": kind} | facts)

    item(add(device, "DataItems"), "avail", "AVAILABILITY", {"category": "EVENT"})
    axes = add(add(device, "Components"), "Axes", {"id": "axes", "name": "axes"})
    place = add(axes, "Components")
    for axis in context.axes:
        linear = add(place, "Linear", {"id": f"axis_{axis}", "name": axis})
        items, screw = add(linear, "DataItems"), {"compositionId": f"screw_{axis}"}
        for name, kind in _CONDITIONS.items():
            item(items, f"{name}_{axis}", kind, {"category": "CONDITION"} | screw)
        for name, (kind, units, subtype, _) in SAMPLES.items():
            facts = {"category": "SAMPLE", "units": units} | screw
            facts |= {"subType": subtype} if subtype else {}
            item(items, f"{name}_{axis}", kind, facts)
        item(items, f"advice_{axis}", "MESSAGE", {"category": "EVENT"} | screw)
        parts = add(linear, "Compositions")
        add(parts, "Composition", {"id": f"screw_{axis}", "type": "BALLSCREW"})
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"
