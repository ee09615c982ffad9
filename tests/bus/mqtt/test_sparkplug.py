"""Sparkplug B 3.0, read by a decoder of its own and by a library that nobody here wrote."""

import asyncio
import struct
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import aiomqtt
import pytest

from edge_service.bus.mqtt.axis_metrics import METRICS
from edge_service.bus.mqtt.delivery import MqttDelivery, MqttSettings
from edge_service.bus.mqtt.packet import Packet
from edge_service.bus.mqtt.sparkplug import Sparkplug
from edge_service.bus.spool.message import Message
from edge_service.bus.spool.spool import Spool
from edge_service.config_tables import MqttConfig
from edge_service.messages.advice import Advice, Due, Headline, Level, Subject, Task
from edge_service.messages.alarm import AlarmKind
from edge_service.messages.estimate import EstimateStatus, Interval, PreloadEstimate
from edge_service.messages.event import Event, Severity
from edge_service.messages.header import Header
from edge_service.messages.health import AxisCondition, AxisHealth
from edge_service.messages.topics import EVENT, HEALTH, PRELOAD

from ...nodes.conftest import config_of, running
from .conftest import PATIENCE_S, Broker, empty, needs_broker, stop

NOW_MS = 1_790_000_000_000
REBIRTH = "Node Control/Rebirth"
VALUES = {10: "uint32", 11: "uint64", 13: "double", 14: "bool", 15: "string"}
"""Field numbers of a metric's value, 6.4.5 of the specification."""


def fields(data: bytes) -> Iterator[tuple[int, Any]]:
    """Number and raw value of the fields of a message of Protocol Buffers (wire types 0, 1, 2)."""

    def varint() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = data[at]
            at, value, shift = at + 1, value | (byte & 0x7F) << shift, shift + 7
            if not byte & 0x80:
                return value

    at = 0
    while at < len(data):
        key = varint()
        number, wire = key >> 3, key & 7
        if wire == 0:
            yield number, varint()
        elif wire == 1:
            yield number, struct.unpack_from("<d", data, at)[0]
            at += 8
        else:
            assert wire == 2
            length = varint()
            yield number, data[at : at + length]
            at += length


def metric(data: bytes) -> dict[str, Any]:
    read: dict[str, Any] = {"value": None, "historical": False, "null": False, "unit": None}
    names = {3: "time_ms", 4: "type", 5: "historical", 7: "null"}
    for number, value in fields(data):
        if number == 1:
            read["name"] = value.decode()
        elif number in names:
            read[names[number]] = value
        elif number == 9:
            keys = [text for field, text in fields(value) if field == 1]
            values = [dict(fields(each)) for field, each in fields(value) if field == 2]
            assert keys == [b"engUnit"]
            assert values[0][1] == 12
            read["unit"] = values[0][8].decode()
        else:
            read["value"] = value.decode() if VALUES[number] == "string" else value
    return read


def payload(packet: bytes) -> dict[str, Any]:
    read: dict[str, Any] = {"metrics": {}, "seq": None}
    for number, value in fields(packet):
        if number == 2:
            each = metric(value)
            read["metrics"][each["name"]] = each
        else:
            read[{1: "time_ms", 3: "seq"}[number]] = value
    return read


def header(second: float) -> Header:
    return Header(1, 1, round(second * 1e9), 1)


def estimate(second: float, percent: float | None) -> bytes:
    known = percent is not None
    told = PreloadEstimate(
        time_s=second,
        status=EstimateStatus.ESTIMATED if known else EstimateStatus.INSUFFICIENT_EXCITATION,
        reasons=() if known else ("still: the axis stands",),
        preload_percent=percent,
        drag_torque_nm=Interval(value=0.1, low=0.09, high=0.11) if known else None,
        nis=1.0,
    )
    return PRELOAD.encode("X", header(second), told)


def health(second: float, condition: AxisCondition, **more: Any) -> bytes:
    told = AxisHealth(axis="X", condition=condition, since_time_ns=5_000_000_000, **more)
    return HEALTH.encode(None, header(second), told)


def event(second: float, text: str) -> bytes:
    told = Event(axis="X", kind="note", severity=Severity.INFO, message=text, time_ns=1)
    return EVENT.encode(None, header(second), told)


class EdgeNode:
    """An edge node with the messages that it was given, without a broker."""

    def __init__(self) -> None:
        self.node = Sparkplug("site", "mill", lambda: NOW_MS)
        self.newest: dict[str, Message] = {}
        self._number = 0

    def put(self, topic: str, content: bytes) -> Message:
        self._number += 1
        message = self.newest[topic] = Message(self._number, topic, content)
        return message

    def greet(self) -> list[tuple[str, dict[str, Any]]]:
        return [self._read(packet) for packet in self.node.greeting(self.newest)]

    def send(self, message: Message, *, late: bool = False) -> list[tuple[str, dict[str, Any]]]:
        return [self._read(each) for each in self.node.packets(message, self.newest, late)]

    def say(self, topic: str, content: bytes) -> list[tuple[str, dict[str, Any]]]:
        return self.send(self.put(topic, content))

    @staticmethod
    def _read(packet: Packet) -> tuple[str, dict[str, Any]]:
        assert (packet.qos, packet.retain) == (0, False)
        return packet.topic, payload(packet.payload)


def test_death_and_birth_carry_the_same_number_and_the_next_connection_the_next() -> None:
    edge = EdgeNode()
    for session, number in ((0, 0), (1, 1), (255, 255), (256, 0)):
        will = edge.node.will(session)
        assert (will.topic, will.qos, will.retain) == ("spBv1.0/site/NDEATH/mill", 1, False)
        death = payload(will.payload)
        assert list(death["metrics"]) == ["bdSeq"]
        assert death["seq"] is None
        ((topic, birth),) = edge.greet()
        assert topic == "spBv1.0/site/NBIRTH/mill"
        assert birth["seq"] == 0
        assert birth["time_ms"] == NOW_MS
        assert birth["metrics"]["bdSeq"]["value"] == death["metrics"]["bdSeq"]["value"] == number
        rebirth = birth["metrics"][REBIRTH]
        assert (rebirth["type"], rebirth["value"]) == (11, 0)


def test_a_device_is_born_with_every_metric_it_will_ever_have() -> None:
    edge = EdgeNode()
    edge.greet()
    first = edge.say("X/preload", estimate(1.5, 6.5))
    assert [topic for topic, _ in first] == ["spBv1.0/site/DBIRTH/mill/X"]
    metrics = first[0][1]["metrics"]
    known = {"value": 6.5, "type": 10, "unit": "%", "time_ms": 1500, "null": False}
    assert metrics["preload/preload_percent"].items() >= known.items()
    assert metrics["preload/drag_torque_nm/low"]["value"] == 0.09
    assert metrics["preload/low"]["null"]
    assert metrics["health/condition"]["null"]
    assert {f"health/alarm/{kind}" for kind in AlarmKind} < set(metrics)
    later = [
        edge.say("X/preload", estimate(2.5, None)),
        edge.say("X/health", health(2.6, AxisCondition.NORMAL)),
        edge.say("X/event", event(2.7, "a")),
    ]
    for ((topic, data),) in later:
        assert topic == "spBv1.0/site/DDATA/mill/X"
        assert set(data["metrics"]) <= set(metrics)
        assert not any(each["historical"] for each in data["metrics"].values())
    gone = later[0][0][1]["metrics"]["preload/preload_percent"]
    assert gone["null"]
    assert gone["value"] is None
    assert later[1][0][1]["metrics"]["health/since"]["value"] == 5000


def test_headline_and_first_task_are_metrics_member_by_member() -> None:
    due = Due(earliest_ns=7_000_000_000, latest_ns=9_000_000_000)
    plan, grease = (
        Advice(task=task, subject=Subject.PRELOAD, text=task, now=False, due=due)
        for task in (Task.PLAN_NUT, Task.REGREASE)
    )
    headline = Headline(level=Level.ATTENTION, code="warning", text="The preload is low.")
    edge = EdgeNode()
    edge.greet()
    edge.say("X/preload", estimate(1.5, 6.5))
    told = health(2.0, AxisCondition.WARNING, headline=headline, advice=(plan, grease))
    ((_, data),) = edge.say("X/health", told)
    got = {name: each["value"] for name, each in data["metrics"].items()}
    for name, value in headline.model_dump(mode="json").items():
        assert got[f"health/headline/{name}"] == value
    for name in ("task", "text", "now"):
        assert got[f"health/advice/{name}"] == getattr(plan, name)
    dates = {f"health/advice/due_{name.removesuffix('_ns')}" for name in Due.model_fields}
    assert dates <= METRICS.keys()
    assert {name: got[name] for name in dates if name in got} == {
        "health/advice/due_earliest": 7000,
        "health/advice/due_latest": 9000,
    }
    ((_, data),) = edge.say("X/health", health(3.0, AxisCondition.NORMAL))
    gone = {name: each for name, each in data["metrics"].items() if "/advice/" in name}
    assert all(each["null"] for each in gone.values())
    assert len(gone) == 5  # all that had a value


def test_only_what_has_changed_is_told_but_every_event_is() -> None:
    edge = EdgeNode()
    edge.greet()
    edge.say("X/preload", estimate(1.0, 6.5))
    ((_, changed),) = edge.say("X/preload", estimate(2.0, 6.25))
    assert list(changed["metrics"]) == ["preload/preload_percent"]
    assert edge.say("X/preload", estimate(3.0, 6.25)) == []
    for second in (4.0, 5.0):
        ((_, told),) = edge.say("X/event", event(second, "the same"))
        assert told["metrics"]["event/message"]["time_ms"] == round(1000 * second)


def test_numbers_run_to_255_and_begin_again() -> None:
    edge = EdgeNode()
    edge.greet()
    edge.say("X/preload", estimate(1.0, 6.0))
    numbers = [edge.say("X/event", event(n, str(n)))[0][1]["seq"] for n in range(600)]
    assert numbers == [(n + 2) % 256 for n in range(600)]
    births = edge.greet()
    assert [each["seq"] for _, each in births] == [0, 1]


def test_what_is_late_goes_whole_and_historical_after_births_with_the_newest() -> None:
    edge = EdgeNode()
    waiting = [edge.put("X/preload", estimate(float(n), 6.0)) for n in range(1, 4)]
    births = edge.greet()
    assert [topic for topic, _ in births] == [
        "spBv1.0/site/NBIRTH/mill",
        "spBv1.0/site/DBIRTH/mill/X",
    ]
    assert births[1][1]["metrics"]["preload/preload_percent"]["time_ms"] == 3000
    for message, second in zip(waiting, (1000, 2000, 3000), strict=True):
        ((_, data),) = edge.send(message, late=True)
        assert len(data["metrics"]) > 5
        assert all(each["historical"] for each in data["metrics"].values())
        assert {each["time_ms"] for each in data["metrics"].values()} == {second}
    assert edge.say("X/preload", estimate(4.0, 6.0)) == []


def test_an_axis_that_falls_silent_dies_and_is_born_again_by_its_next_estimate() -> None:
    edge = EdgeNode()
    edge.greet()
    edge.say("X/preload", estimate(1.0, 6.0))
    ((topic, death),) = edge.say("X/gone", b"")
    assert topic == "spBv1.0/site/DDEATH/mill/X"
    assert death["seq"] == 2
    assert edge.say("X/health", health(2.0, AxisCondition.UNAVAILABLE)) == []
    assert [topic for topic, _ in edge.greet()] == ["spBv1.0/site/NBIRTH/mill"]
    ((topic, birth),) = edge.say("X/preload", estimate(3.0, 5.0))
    assert topic == "spBv1.0/site/DBIRTH/mill/X"
    assert birth["metrics"]["health/condition"]["value"] == "UNAVAILABLE"


def test_a_silence_that_was_over_before_the_connection_kills_nothing() -> None:
    edge = EdgeNode()
    waiting = [
        edge.put("X/preload", estimate(1.0, 6.0)),
        edge.put("X/gone", b""),
        edge.put("X/preload", estimate(9.0, 5.0)),
    ]
    edge.greet()
    topics = [topic for each in waiting for topic, _ in edge.send(each, late=True)]
    assert topics == ["spBv1.0/site/DDATA/mill/X"] * 2


def test_a_silence_that_lasts_is_told_after_what_waited() -> None:
    edge = EdgeNode()
    waiting = [edge.put("X/preload", estimate(1.0, 6.0)), edge.put("X/gone", b"")]
    waiting.append(edge.put("X/health", health(2.0, AxisCondition.UNAVAILABLE)))
    edge.greet()
    kinds = [topic.split("/")[2] for each in waiting for topic, _ in edge.send(each, late=True)]
    assert kinds == ["DBIRTH", "DDATA", "DDEATH"]


@pytest.mark.parametrize("garbage", [b"", b"\xff\xff", b"{}", b"\x12\x05hello", bytes(range(256))])
def test_garbage_is_no_command(garbage: bytes) -> None:
    assert not Sparkplug("s", "n").asks_for_greeting(garbage)


@pytest.mark.parametrize(
    "content", [b"", b"[]", b"{}", b'{"source_time_ns": 1}', b'{"source_time_ns": "x"}']
)
def test_a_message_of_another_version_in_the_buffer_is_left_out(content: bytes) -> None:
    edge = EdgeNode()
    edge.greet()
    kinds = [topic.split("/")[2] for topic, _ in edge.say("X/preload", content)]
    assert kinds == ["DBIRTH"]
    assert edge.say("X/nosuch", b"{}") == []


@pytest.fixture(name="foreign")
def foreign_library() -> ModuleType:
    return pytest.importorskip("pysparkplug", reason="pysparkplug is not installed")


def test_a_foreign_library_reads_the_same(foreign: Any) -> None:
    node = Sparkplug("site", "mill", lambda: NOW_MS)
    newest = {"X/preload": Message(1, "X/preload", estimate(1.5, 6.5))}
    node.will(7)
    birth, device = node.greeting(newest)
    told = foreign.NBirth.decode(birth.payload)
    assert told.seq == 0
    assert {each.name: each.value for each in told.metrics} == {"bdSeq": 7, REBIRTH: False}
    told = foreign.DBirth.decode(device.payload)
    assert told.seq == 1
    values = {each.name: each for each in told.metrics}
    assert values["preload/preload_percent"].value == 6.5
    assert values["preload/preload_percent"].timestamp == 1500
    assert values["preload/preload_percent"].datatype is foreign.DataType.DOUBLE
    assert values["preload/status"].value == "estimated"
    assert values["health/condition"].is_null
    death = foreign.NDeath.decode(node.farewell().payload)
    assert death.bd_seq_metric.value == 7
    ask = foreign.Metric(None, REBIRTH, foreign.DataType.BOOLEAN, value=True)
    assert node.asks_for_greeting(foreign.NCmd(NOW_MS, (ask,)).encode(include_dtypes=True))
    ask = foreign.Metric(None, REBIRTH, foreign.DataType.BOOLEAN, value=False)
    assert not node.asks_for_greeting(foreign.NCmd(NOW_MS, (ask,)).encode(include_dtypes=True))


def rebirth_command() -> bytes:
    """A payload with one metric, put together by hand: name, data type Boolean, true."""
    name = REBIRTH.encode()
    told = b"\x0a" + bytes([len(name)]) + name + b"\x20\x0b\x70\x01"
    return b"\x12" + bytes([len(told)]) + told


class Host:
    """Everything that a host application hears, checked for the order of the numbers."""

    def __init__(self, port: int) -> None:
        self._port = port
        self.heard: list[tuple[str, dict[str, Any]]] = []
        self._seq: int | None = None
        self._ready = asyncio.Event()
        self.client: aiomqtt.Client | None = None

    async def run(self) -> None:
        async with aiomqtt.Client("127.0.0.1", self._port) as client:
            await client.subscribe("spBv1.0/#", qos=1)
            self.client = client
            self._ready.set()
            async for message in client.messages:
                assert isinstance(message.payload, bytes)
                kind = str(message.topic).split("/")[2]
                if kind != "NCMD":
                    self._take(kind, payload(message.payload))

    async def ready(self) -> None:
        await self._ready.wait()

    def _take(self, kind: str, told: dict[str, Any]) -> None:
        if kind == "NBIRTH":
            assert told["seq"] == 0
        elif kind != "NDEATH":
            assert self._seq is not None
            assert told["seq"] == (self._seq + 1) % 256
        self._seq = told["seq"]
        self.heard.append((kind, told))

    def kinds(self) -> list[str]:
        return [kind for kind, _ in self.heard]

    async def until(self, kind: str, count: int = 1) -> dict[str, Any]:
        async with asyncio.timeout(PATIENCE_S):
            while self.kinds().count(kind) < count:
                await asyncio.sleep(0.01)
        return [told for each, told in self.heard if each == kind][count - 1]


@needs_broker
async def test_a_session_from_birth_to_death(broker: Broker, tmp_path: Path) -> None:
    spool, problems = await Spool.open(tmp_path / "spool", 1000), []  # type: ignore[var-annotated]
    for second in (1.0, 2.0):
        await spool.put("X/preload", estimate(second, 6.0))
    host = Host(broker.port)
    hosting = asyncio.create_task(host.run())
    await host.ready()
    settings = MqttSettings("127.0.0.1", broker.port, "edge", timeout_s=2.0)
    make = partial(MqttDelivery, settings, Sparkplug("site", "mill"), spool, problems.append)
    delivering = asyncio.create_task(make().run())
    await host.until("DDATA", 2)
    assert host.kinds() == ["NBIRTH", "DBIRTH", "DDATA", "DDATA"]
    assert all(m["historical"] for m in host.heard[-1][1]["metrics"].values())
    await spool.put("X/preload", estimate(3.0, 5.0))
    live = await host.until("DDATA", 3)
    assert {n: m["value"] for n, m in live["metrics"].items()} == {"preload/preload_percent": 5.0}
    await empty(spool)

    assert host.client is not None
    await host.client.publish("spBv1.0/site/NCMD/mill", b"garbage")
    await host.client.publish("spBv1.0/site/NCMD/mill", rebirth_command())
    again = await host.until("NBIRTH", 2)
    assert again["metrics"]["bdSeq"]["value"] == 0
    reborn = await host.until("DBIRTH", 2)
    assert reborn["metrics"]["preload/preload_percent"]["value"] == 5.0

    await stop(delivering)
    death = await host.until("NDEATH")
    assert death["metrics"]["bdSeq"]["value"] == 0
    delivering = asyncio.create_task(make().run())
    third = await host.until("NBIRTH", 3)
    assert third["metrics"]["bdSeq"]["value"] == 1
    assert problems == ["", ""]
    await stop(delivering)
    await stop(hosting)
    spool.close()


@needs_broker
async def test_it_ends_when_asked_to_at_whatever_moment(broker: Broker, tmp_path: Path) -> None:
    """Python 3.11 may swallow a cancellation that meets an acknowledgement."""
    spool = await Spool.open(tmp_path / "spool", 1000)
    settings = MqttSettings("127.0.0.1", broker.port, "edge", timeout_s=2.0)
    for number in range(40):
        await spool.put("X/preload", estimate(float(number), 6.0))
        node = Sparkplug("site", "mill")
        delivering = asyncio.create_task(MqttDelivery(settings, node, spool, lambda _: None).run())
        await asyncio.sleep(0.0005 * number)
        delivering.cancel()
        done, _ = await asyncio.wait([delivering], timeout=PATIENCE_S)
        assert done
        assert delivering.cancelled()
    spool.close()


@needs_broker
async def test_what_was_on_the_way_when_the_broker_was_killed_comes_as_history(
    broker: Broker, tmp_path: Path
) -> None:
    spool, problems = await Spool.open(tmp_path / "spool", 10_000), []  # type: ignore[var-annotated]
    settings = MqttSettings("127.0.0.1", broker.port, "edge", timeout_s=2.0)
    delivery = MqttDelivery(settings, Sparkplug("site", "mill"), spool, problems.append)
    delivering = asyncio.create_task(delivery.run())
    await spool.put("X/preload", estimate(1.0, 6.0))
    await empty(spool)
    await broker.stop(kill=True)
    for number in range(500):
        await spool.put("X/event", event(10.0 + number, str(number)))
    assert len(spool) == 500
    await broker.start()
    host = Host(broker.port)
    hosting = asyncio.create_task(host.run())
    await host.ready()
    await empty(spool)
    await spool.put("X/event", event(1000.0, "live"))
    async with asyncio.timeout(PATIENCE_S):
        while not (host.heard and "live" in str(host.heard[-1])):
            await asyncio.sleep(0.01)
    # The host may have come after the births; what it heard is in order, and the last one is live.
    told = [each["metrics"]["event/message"] for kind, each in host.heard if kind == "DDATA"]
    assert [each["historical"] for each in told] == [1] * (len(told) - 1) + [0]
    assert told[-1]["value"] == "live"
    assert [int(each["value"]) for each in told[:-1]] == list(range(500))[500 - len(told) + 1 :]
    await stop(delivering)
    await stop(hosting)
    spool.close()


@needs_broker
async def test_the_service_is_an_edge_node_and_a_silent_axis_a_dead_device(
    broker: Broker, tmp_path: Path
) -> None:
    mqtt = MqttConfig(
        host="127.0.0.1",
        port=broker.port,
        payload="sparkplug",
        buffer=tmp_path / "spool",
        period_s=0.0,
    )
    config = config_of("simulated", {}, mqtt=mqtt)
    host = Host(broker.port)
    hosting = asyncio.create_task(host.run())
    await host.ready()
    async with running(config, ("mqtt",)) as service:
        publisher = service.bus.publisher(config.keys.key("X", PRELOAD), PRELOAD, "X")
        await host.until("NBIRTH")

        async def say(percent: float, kind: str, count: int) -> dict[str, Any]:
            told = PreloadEstimate(
                time_s=1.0, status=EstimateStatus.ESTIMATED, preload_percent=percent
            )
            publisher.publish(told, 10**9)
            return await host.until(kind, count)

        await say(6.0, "DBIRTH", 1)
        data = await say(5.0, "DDATA", 1)
        assert data["metrics"]["preload/preload_percent"]["value"] == 5.0
        await host.until("DDEATH")
        again = await say(4.0, "DBIRTH", 2)
        assert again["metrics"]["preload/preload_percent"]["value"] == 4.0
    death = await host.until("NDEATH")
    assert death["metrics"]["bdSeq"]["value"] == host.heard[0][1]["metrics"]["bdSeq"]["value"]
    assert host.kinds() == ["NBIRTH", "DBIRTH", "DDATA", "DDEATH", "DBIRTH", "NDEATH"]
    await stop(hosting)
