"""MTConnect: an adapter that tells agents by SHDR, and the description of the machine for them.

Sources: Adapter Agent Protocol Version 2.0 (https://mtcup.org/Protocol); quoting as the agent reads
it (`ShdrTokenizer` of https://github.com/mtconnect/cppagent).
"""

import asyncio
import re
import socket
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from xml.etree import ElementTree

from pydantic import model_validator

from .. import __version__
from ..atomic import replaced_file
from ..clock import now_ns
from ..messages.addresses import is_loopback
from ..messages.answer import AxisAnswer
from ..messages.interval import Interval
from .base import (
    Message,
    Output,
    OutputConfig,
    OutputContext,
    OutputUnavailableError,
    host_and_port,
)

CLIENTS = 10
"""Agents that there may be at once."""
HEARTBEAT_S = 10.0
"""An agent that has asked once asks again within this time; after twice as long it is cut off."""
UNREAD_BYTES = 1_000_000
"""Bytes that may wait for a client that does not read; then it is cut off."""
LINE_BYTES = 1024
HEARTBEAT_BYTES = 16_384
"""Bytes that a client may send within a heartbeat."""
DEVICES_FILE = "mtconnect-devices.xml"
NAMESPACE = "urn:mtconnect.org:MTConnectDevices:2.0"
OWN = "urn:edge-service:MTConnectDevices:2.0"
UNAVAILABLE = "UNAVAILABLE"
_CONDITION_CODE = "PRELOAD"  # one native code, so that a new condition replaces the last
_HEALTH_MISSING = ("no_health:", "stale_health:")
_CONTROL = re.compile(r"[\x00-\x1f\x7f\x85\u2028\u2029]+")
_ESCAPED = re.compile(r'([\\|"])')
Values = dict[tuple[str, str], tuple[str, ...]]
"""Fields of data items, by name and, of a condition, native code."""


class MtconnectConfig(OutputConfig):
    """`[outputs.mtconnect]`.

    Attributes:
        endpoint: where agents connect.
        allow_plain: also beyond loopback, where others may read along; the protocol has neither
            encryption nor login.
    """

    endpoint: str = "tcp://127.0.0.1:7878"
    allow_plain: bool = False

    @model_validator(mode="after")
    def _guarded(self) -> "MtconnectConfig":
        host, _ = self.place
        if not (self.allow_plain or is_loopback(host)):
            raise ValueError(
                f"endpoint: {host!r} is not a loopback address: anyone may read there; it needs"
                " allow_plain"
            )
        return self

    @property
    def place(self) -> tuple[str, int]:
        """Host and port."""
        return host_and_port(self.endpoint, "tcp", 7878)


@dataclass(frozen=True, slots=True)
class Item:
    """One data item of an axis; its name is followed by that of the axis.

    Attributes:
        kind: its type; with a prefix one that MTConnect does not have.
        read: number in an answer; None where there is none.
    """

    kind: str
    units: str
    read: Callable[[AxisAnswer], float | None]
    subtype: str = ""


def _bound(interval: Interval | None, bound: str) -> float | None:
    return None if interval is None else float(getattr(interval, bound))


SAMPLES = {
    "preload": Item("x:PRELOAD", "PERCENT", lambda each: _bound(each.of_fresh, "value")),
    "preloadLow": Item("x:PRELOAD", "PERCENT", lambda each: _bound(each.of_fresh, "low"), "x:LOW"),
    "preloadHigh": Item(
        "x:PRELOAD", "PERCENT", lambda each: _bound(each.of_fresh, "high"), "x:HIGH"
    ),
    "preloadForce": Item("LINEAR_FORCE", "NEWTON", lambda each: each.estimate.preload_n),
    "dragTorque": Item(
        "TORQUE", "NEWTON_METER", lambda each: _bound(each.estimate.drag_torque_nm, "value")
    ),
}
"""Numbers of an axis by name; no name holds an underscore, which ends it."""
CONDITIONS = {"condition": "ACTUATOR", "alarms": "SYSTEM"}


class MtconnectOutput(Output):
    """Adapter for bounded clients, which can ask for nothing but a sign of life.

    Args:
        clock: monotonic, s.
    """

    config_model = MtconnectConfig

    def __init__(
        self,
        config: MtconnectConfig,
        context: OutputContext,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(config, context)
        self.now_s = clock
        self._clients: set[_Client] = set()
        self._server: asyncio.Server | None = None
        self._told: dict[str, tuple[Values, int | None]] = {}
        self.cut_off = 0

    @property
    def readings(self) -> dict[str, float]:
        """Agents that are connected."""
        return {"clients": float(len(self._clients))}

    @property
    def port(self) -> int:
        """The port at which it listens; 0 before."""
        return 0 if self._server is None else int(self._server.sockets[0].getsockname()[1])

    async def open(self) -> None:
        """Write the description of the machine, and listen."""
        if self._server is not None:
            return
        host, port = self.config.place
        try:
            if self.context.folder is not None:
                with replaced_file(self.context.folder / DEVICES_FILE) as file:
                    file.write(devices_xml(self.context, now_ns()))
            loop = asyncio.get_running_loop()
            server = await loop.create_server(lambda: _Client(self), host, port)
        except OSError as error:
            raise OutputUnavailableError(f"{host}:{port}: {error.strerror}") from None
        self._server = server

    async def take(self, message: Message) -> None:
        """Tell all agents what has changed on an axis, and cut off those that are silent."""
        if self._server is None:
            raise OutputUnavailableError("not open")
        assert isinstance(message, AxisAnswer)
        before, _ = self._told.get(message.axis, ({}, None))
        values = values_of(message)
        self._told[message.axis] = values, message.measured_ns
        news = list(lines(changes(before, values), now_ns(), message.measured_ns))
        for client in tuple(self._clients):
            client.look()
            client.tell(news)

    async def close(self) -> None:
        """End all connections."""
        server, self._server = self._server, None
        if server is not None:
            server.close()
        for client in tuple(self._clients):
            client.cut_off()

    def admit(self, client: "_Client") -> Sequence[str]:
        """Lines that a new client is told first; none if there are too many."""
        if len(self._clients) >= CLIENTS:
            return ()
        self._clients.add(client)
        greeting = [
            f"* adapterVersion: {__version__}",
            "* shdrVersion: 2.0",
            "* mtconnectVersion: 2.0",
            *lines({("avail", ""): ("AVAILABLE",)}, now_ns()),
        ]
        for values, measured_ns in self._told.values():
            greeting += lines(values, now_ns(), measured_ns)
        return greeting

    def leave(self, client: "_Client") -> None:
        """Forget a client."""
        self._clients.discard(client)


class _Client(asyncio.Protocol):
    """Connection of one agent."""

    def __init__(self, output: MtconnectOutput) -> None:
        self._output = output
        self._transport: asyncio.Transport | None = None
        self._begun = b""
        self._asked_s: float | None = None
        self._came, self._since_s = 0, output.now_s()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Greet, or refuse what is too much."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        first = self._output.admit(self)
        if not first:
            transport.abort()
            return
        transport.set_write_buffer_limits(high=UNREAD_BYTES)
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self.tell(first)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._output.leave(self)

    def pause_writing(self) -> None:
        """Cut off whoever does not read."""
        self.cut_off()

    def data_received(self, data: bytes) -> None:
        """Answer signs of life; all else is ignored, and too much of it ends the connection."""
        self._came += len(data)
        *whole, self._begun = (self._begun + data).split(b"\n")
        if self._came > HEARTBEAT_BYTES or len(self._begun) > LINE_BYTES:
            self.cut_off()
            return
        if any(line.strip() == b"* PING" for line in whole):
            self._asked_s = self._output.now_s()
            self.tell([f"* PONG {HEARTBEAT_S * 1000.0:.0f}"])

    def tell(self, told: Sequence[str]) -> None:
        """Send lines."""
        if self._transport is not None and told and not self._transport.is_closing():
            self._transport.write(("\n".join(told) + "\n").encode())

    def look(self) -> None:
        """Cut off whoever has asked for a sign of life and asks no more."""
        now_s = self._output.now_s()
        if now_s - self._since_s > HEARTBEAT_S:
            self._came, self._since_s = 0, now_s
        if self._asked_s is not None and now_s - self._asked_s > 2.0 * HEARTBEAT_S:
            self.cut_off()

    def cut_off(self) -> None:
        """End the connection at once."""
        if self._transport is not None and not self._transport.is_closing():
            self._output.cut_off += 1
            self._transport.abort()


def values_of(answer: AxisAnswer) -> Values:
    """All that an answer says, by data item."""
    axis, health = answer.axis, answer.health
    values: Values = {}
    for name, item in SAMPLES.items():
        number = item.read(answer) if answer.is_heard else None
        values[f"{name}_{axis}", ""] = (UNAVAILABLE if number is None else f"{number:.6g}",)
    advice = ("", UNAVAILABLE) if not answer.is_heard else ("", "")
    if answer.is_heard and answer.advice is not None:
        due = "" if answer.due_ns is None else f" ({_moment(answer.due_ns):%Y-%m-%d})"
        advice = answer.advice.task.value, answer.advice.text + due
    values[f"advice_{axis}", ""] = advice
    level = health.condition.value
    if level in (UNAVAILABLE, "NORMAL"):
        values[f"condition_{axis}", ""] = level, "", "", "", ""
    else:
        text = "" if health.headline is None else health.headline.text
        values[f"condition_{axis}", ""] = level, _CONDITION_CODE, "", "LOW", text
    active = [alarm for alarm in health.alarms if alarm.active]
    if any(reason.startswith(_HEALTH_MISSING) for reason in health.reasons):
        values[f"alarms_{axis}", ""] = UNAVAILABLE, "", "", "", ""
    elif not active:
        values[f"alarms_{axis}", ""] = "NORMAL", "", "", "", ""
    else:
        for alarm in active:
            level, code = alarm.level.value, alarm.kind.value
            fields = level if level != UNAVAILABLE else "WARNING", code, "", "", alarm.text
            values[f"alarms_{axis}", code] = fields
    return values


def changes(before: Values, after: Values) -> Values:
    """Fields that tell the changes to an agent that knows the values before."""
    told = {key: fields for key, fields in after.items() if before.get(key) != fields}
    for name, code in before.keys() - after.keys():
        if code and (name, "") not in after:  # another is active still, and this one is over
            told[name, code] = ("NORMAL", code, "", "", "")
    return told


def lines(values: Values, at_ns: int, measured_ns: int | None = None) -> Iterator[str]:
    """Lines without their ends: one for all numbers, one for each condition and message.

    Args:
        at_ns: UNIX time of what is judged, ns.
        measured_ns: that of the sample behind the numbers; None where there is none.
    """
    known: list[str] = []
    missing: list[str] = []
    for (name, _), fields in values.items():
        if len(fields) == 1:
            pairs = missing if fields == (UNAVAILABLE,) else known
            pairs += (name, *fields)
    if missing:
        yield _joined(at_ns, missing)
    if known:
        yield _joined(at_ns if measured_ns is None else measured_ns, known)
    for (name, _), fields in values.items():
        if len(fields) > 1:
            yield _joined(at_ns, (name, *fields))


def field(text: str) -> str:
    """Text as a field: on one line, quoted where it holds what would end or begin one."""
    plain = _CONTROL.sub(" ", text).strip()
    if "|" not in plain and not plain.startswith('"'):
        return plain
    return '"' + _ESCAPED.sub(r"\\\1", plain) + '"'


def _joined(time_ns: int, parts: Iterable[str]) -> str:
    moment = f"{_moment(time_ns):%Y-%m-%dT%H:%M:%S}.{time_ns % 1_000_000_000 // 1000:06d}Z"
    return "|".join((moment, *(field(part) for part in parts)))


def _moment(time_ns: int) -> datetime:
    return datetime.fromtimestamp(time_ns // 1_000_000_000, UTC)


def devices_xml(context: OutputContext, at_ns: int) -> str:
    """Description of the machine for an agent, `Devices.xml` of MTConnect 2.0: its axes, and the
    data items of each.
    """
    root = ElementTree.Element("MTConnectDevices", {"xmlns": NAMESPACE, "xmlns:x": OWN})
    created = f"{_moment(at_ns):%Y-%m-%dT%H:%M:%SZ}"
    header = {"creationTime": created, "sender": "edge-service", "instanceId": "1"}
    header |= {"version": "2.0", "deviceModelChangeTime": created, "assetBufferSize": "1024"}
    header |= {"assetCount": "0", "bufferSize": "131072"}
    ElementTree.SubElement(root, "Header", header)
    names = {"name": context.machine, "uuid": f"{context.site}.{context.machine}"}
    devices = ElementTree.SubElement(root, "Devices")
    device = ElementTree.SubElement(devices, "Device", {"id": "machine"} | names)
    _item(ElementTree.SubElement(device, "DataItems"), "avail", "EVENT", "AVAILABILITY")
    components = ElementTree.SubElement(device, "Components")
    axes = ElementTree.SubElement(components, "Axes", {"id": "axes", "name": "axes"})
    place = ElementTree.SubElement(axes, "Components")
    for axis in context.axes:
        linear = ElementTree.SubElement(place, "Linear", {"id": f"axis_{axis}", "name": axis})
        items = ElementTree.SubElement(linear, "DataItems")
        screw = {"compositionId": f"screw_{axis}"}
        for name, kind in CONDITIONS.items():
            _item(items, f"{name}_{axis}", "CONDITION", kind, screw)
        for name, item in SAMPLES.items():
            facts = {"units": item.units} | ({"subType": item.subtype} if item.subtype else {})
            _item(items, f"{name}_{axis}", "SAMPLE", item.kind, facts | screw)
        _item(items, f"advice_{axis}", "EVENT", "MESSAGE", screw)
        parts = ElementTree.SubElement(linear, "Compositions")
        ElementTree.SubElement(parts, "Composition", {"id": f"screw_{axis}", "type": "BALLSCREW"})
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _item(
    items: ElementTree.Element,
    name: str,
    category: str,
    kind: str,
    facts: dict[str, str] | None = None,
) -> None:
    known = {"id": name, "name": name, "category": category, "type": kind}
    ElementTree.SubElement(items, "DataItem", known | (facts or {}))
