"""Home Assistant finds every axis by itself, and never shows a number that may not be read."""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import aiomqtt
import pytest
from pydantic import ValidationError

from edge_service.bus.mqtt.delivery import MqttDelivery, MqttSettings
from edge_service.bus.mqtt.device_state import (
    COMPONENTS,
    DeviceState,
    axis_of_identifier,
    identifier,
    object_id,
)
from edge_service.bus.mqtt.home_assistant import HomeAssistant
from edge_service.bus.mqtt.packet import GONE
from edge_service.bus.spool.spool import Spool
from edge_service.config_tables import MqttConfig
from edge_service.messages.alarm import Alarm, AlarmKind
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.event import Severity
from edge_service.messages.header import Header
from edge_service.messages.health import AxisCondition, AxisHealth
from edge_service.messages.topics import HEALTH, PRELOAD
from edge_service.messages.trend import Crossing, Trend, TrendStatus

from ...messages.answers import health_of
from ...nodes.conftest import config_of, running, until
from .conftest import Broker, needs_broker, stop
from .home_assistant_reader import UNAVAILABLE, UNKNOWN, home_assistant

FRESH = 5.0
NOW_NS = 1_790_000_000_000_000_000
NUMBERS = ("preload", "preload_low", "preload_high")
NOTHING = dict.fromkeys(COMPONENTS, UNKNOWN)


def header(at_ns: int = NOW_NS) -> Header:
    return Header(1, NOW_NS, at_ns, 1)


def preload(
    status: EstimateStatus = EstimateStatus.ESTIMATED, at_ns: int = NOW_NS, value: float = 3.0
) -> bytes:
    numbers = {"preload_percent": value, "low": value - 0.5, "high": value + 0.5}
    numbers = numbers if status is EstimateStatus.ESTIMATED else {}
    return PRELOAD.encode("X", header(at_ns), PreloadEstimate(time_s=1.0, status=status, **numbers))


def health(condition: AxisCondition = AxisCondition.FAULT, **changes: Any) -> bytes:
    return HEALTH.encode("X", header(), health_of(condition, **changes))


def lost(active: bool = True) -> Alarm:
    return Alarm(
        kind=AlarmKind.PRELOAD_LOST,
        severity=Severity.ERROR,
        active=active,
        message="preload at 17 %",
        raised_time_ns=1,
    )


class Service:
    """The delivery with its spool."""

    def __init__(self, spool: Spool, delivery: MqttDelivery) -> None:
        self.spool, self.delivery = spool, delivery

    async def put(self, topic: str, payload: bytes, axis: str = "X") -> None:
        await self.spool.put(f"{axis}/{topic}", payload)


@asynccontextmanager
async def serving(
    broker: Broker, folder: Path, *axes: str, machine: str = "hall/mill"
) -> AsyncIterator[Service]:
    spool = await Spool.open(folder / "spool", 1000)
    form = HomeAssistant(
        f"feeddrive/{machine}", machine, dict.fromkeys(axes, FRESH), "homeassistant", 1.0
    )
    settings = MqttSettings("127.0.0.1", broker.port, machine.replace("/", "-"), timeout_s=2.0)
    delivery = MqttDelivery(settings, form, spool, lambda _problem: None)
    task = asyncio.create_task(delivery.run())
    try:
        yield Service(spool, delivery)
    finally:
        await stop(task)
        spool.close()


async def shows(home: Any, expected: dict[str, Any], device: str = "hall/mill X") -> None:
    """Wait until a device shows this, at least."""
    seen: dict[str, Any] = {}

    async def there() -> bool:
        seen.update(home.devices().get(device, {}))
        return expected.items() <= seen.items()

    try:
        await until(there)
    except TimeoutError:
        pytest.fail(f"{seen}, not {expected}")


@needs_broker
async def test_an_axis_is_found_and_shows_what_the_service_says(
    broker: Broker, tmp_path: Path
) -> None:
    crossings = (
        Crossing(
            limit="fault", limit_percent=1.0, earliest_ns=NOW_NS, likely_ns=None, latest_ns=None
        ),
    )
    trend = Trend(status=TrendStatus.FALLING, reason="r", since_time_ns=1, crossings=crossings)
    async with home_assistant(broker.port) as home, serving(broker, tmp_path, "X", "Y") as service:
        await shows(home, NOTHING)
        await shows(home, NOTHING, "hall/mill Y")
        await service.put("preload", preload())
        await service.put("health", health(AxisCondition.WARNING, alarms=(lost(),), trend=trend))
        await shows(
            home,
            {"preload": 60.0, "preload_low": 50.0, "preload_high": 70.0, "condition": "WARNING"}
            | {"problem": "on", "next_limit": "2026-09-21T14:13:20+00:00"},
        )
        assert home.attributes("hall/mill X", "problem") == {"preload_lost": "preload at 17 %"}
        assert home.devices()["hall/mill X"]["headline"] == "Preload at 17 %."
        assert home.devices()["hall/mill Y"] == NOTHING
        await service.put("health", health(AxisCondition.NORMAL, alarms=(lost(active=False),)))
        await shows(home, {"condition": "NORMAL", "problem": "off", "next_limit": UNKNOWN})
    async with home_assistant(broker.port) as late:  # one that starts after us
        await shows(late, dict.fromkeys(COMPONENTS, UNAVAILABLE))


@needs_broker
@pytest.mark.parametrize("status", [each for each in EstimateStatus if each != "estimated"])
async def test_a_number_that_may_no_longer_be_read_is_unknown(
    status: EstimateStatus, broker: Broker, tmp_path: Path
) -> None:
    async with home_assistant(broker.port) as home, serving(broker, tmp_path, "X") as service:
        await shows(home, NOTHING)
        await service.put("preload", preload())
        await shows(home, {"preload": 60.0})
        await service.put("preload", preload(status))
        await shows(home, dict.fromkeys(NUMBERS, UNKNOWN))


@needs_broker
async def test_an_axis_that_falls_silent_is_unknown(broker: Broker, tmp_path: Path) -> None:
    async with home_assistant(broker.port) as home, serving(broker, tmp_path, "X") as service:
        await shows(home, NOTHING)
        await service.put("preload", preload())
        await service.put("health", health(AxisCondition.NORMAL))
        await shows(home, {"preload": 60.0, "condition": "NORMAL"})
        await service.put(GONE, b"")
        await shows(home, NOTHING)


@needs_broker
async def test_a_service_or_connection_that_is_lost_is_unavailable_and_then_begins_unknown(
    broker: Broker, tmp_path: Path
) -> None:
    async with home_assistant(broker.port) as home:
        async with serving(broker, tmp_path, "X") as service:
            await shows(home, NOTHING)
            await service.put("preload", preload())
            await shows(home, {"preload": 60.0})
            assert service.delivery._form._states["X"].members["preload"] == 60.0
        await shows(home, dict.fromkeys(COMPONENTS, UNAVAILABLE))
        spool = await Spool.open(tmp_path / "spool", 1000)
        await spool.put("X/preload", preload(value=4.0))  # waited while nobody was there
        spool.close()
        async with serving(broker, tmp_path, "X") as service:
            await shows(home, NOTHING)

            async def sent() -> bool:
                return service.delivery.delivered == 1

            await until(sent)
            await shows(home, NOTHING)
            await service.put("preload", preload(value=4.5))
            await shows(home, {"preload": 90.0})


@needs_broker
async def test_an_axis_that_is_taken_out_is_taken_back_and_nothing_of_others(
    broker: Broker, tmp_path: Path
) -> None:
    foreign = "homeassistant/device/kitchen/config"
    said = {
        "device": {"identifiers": ["kitchen"], "name": "kitchen"},
        "origin": {"name": "somebody"},
        "components": {},
        "state_topic": "a",
    }
    async with home_assistant(broker.port) as home:
        async with aiomqtt.Client("127.0.0.1", broker.port) as client:
            await client.publish(foreign, json.dumps(said), 1, retain=True)
            for garbage in (b"{", b"[]", b"1", b'{"device": 1}', b'{"device": {"identifiers": 1}}'):
                await client.publish("homeassistant/device/odd/config", garbage, 1)

        async def came() -> bool:
            return len(home.refused) == 5

        await until(came)
        home.refused.clear()
        async with (
            serving(broker, tmp_path / "1", "X", "Y"),
            serving(broker, tmp_path / "2", "Y", machine="hall/mill2"),
        ):
            await shows(home, NOTHING, "hall/mill Y")
            await shows(home, NOTHING, "hall/mill2 Y")
        async with serving(broker, tmp_path / "1", "X"):

            async def gone() -> bool:
                return set(home.devices()) == {"hall/mill X", "hall/mill2 Y", "kitchen"}

            await until(gone)
            await shows(home, NOTHING)
        assert "feeddrive/hall/mill/Y/state" not in home.payloads
    async with home_assistant(broker.port) as late:
        await shows(late, {}, "kitchen")

        async def the_same() -> bool:
            return set(late.devices()) == {"hall/mill X", "hall/mill2 Y", "kitchen"}

        await until(the_same)


def test_a_condition_that_is_no_longer_renewed_is_unknown() -> None:
    state = DeviceState(FRESH)
    state.take("health", health(AxisCondition.FAULT, alarms=(lost(),)))
    for after_s, known in ((4.9, True), (5.1, False)):
        state.take("preload", preload(at_ns=NOW_NS + round(1e9 * after_s)))
        assert (state.members["condition"] == "FAULT") is known
        assert (state.members["problem"] == "ON") is known
        assert bool(state.members["alarms"]) is known


def test_without_fresh_preload_there_is_no_percent_of_it() -> None:
    state = DeviceState(None)
    assert state.take("preload", preload())
    assert [state.members[name] for name in NUMBERS] == [None] * 3


def test_words_of_any_length_fit() -> None:
    plain = health_of(AxisCondition.FAULT)
    assert plain.headline is not None
    headline = plain.headline.model_copy(update={"text": "ä" * 1000})
    long: AxisHealth = plain.model_copy(update={"headline": headline})
    state = DeviceState(FRESH)
    state.take("health", HEALTH.encode("X", header(), long))
    assert state.members["headline"] == "ä" * 255


@pytest.mark.parametrize("payload", [b"", b"{", b"[]", b"null", b'{"status": "estimated"}'])
def test_a_message_of_another_version_changes_nothing(payload: bytes) -> None:
    state = DeviceState(FRESH)
    state.take("preload", preload())
    before = dict(state.members)
    for topic in ("preload", "health"):
        assert not state.take(topic, payload)
    assert state.members == before


def test_names_of_devices_are_alike_only_for_the_same_axis() -> None:
    names = [("a.b", "c"), ("a_b", "c"), ("a", "b_c"), ("a", "b.c"), ("a/b", "c"), ("A.b", "c")]
    made = {object_id(identifier(*each)) for each in names}
    assert len(made) == len(names)
    assert all(
        set(each) <= set(object_id("aZ09_-") + "bcA" + "edge-service") | set("0123456789abcdef")
        for each in made
    )
    for machine, axis in names:
        assert axis_of_identifier(machine, [1, identifier(machine, axis)]) == axis
        assert axis_of_identifier(machine + "2", [identifier(machine, axis)]) is None


def test_it_goes_with_json_only() -> None:
    MqttConfig(host="h", home_assistant=True)
    with pytest.raises(ValidationError, match='home_assistant: needs payload = "json"'):
        MqttConfig(host="h", home_assistant=True, payload="sparkplug")
    with pytest.raises(ValidationError, match="discovery_prefix"):
        MqttConfig(host="h", discovery_prefix="home/#")


@needs_broker
async def test_home_assistant_shows_the_preload_of_a_running_service(
    broker: Broker, tmp_path: Path
) -> None:
    mqtt = MqttConfig(
        host="127.0.0.1",
        port=broker.port,
        buffer=tmp_path / "spool",
        period_s=0.1,
        home_assistant=True,
        discovery_prefix="/homeassistant/",
    )
    config = config_of("simulated", {"scenario": "healthy"}, mqtt=mqtt)
    nodes = ("mqtt", "health", "estimate", "downsample", "acquire")
    async with home_assistant(broker.port) as home, running(config, nodes):

        async def known() -> bool:
            states = home.devices().get("bench/lfd X", {})
            return isinstance(states.get("preload"), float) and states["condition"] == "NORMAL"

        await until(known)
        states = home.devices()["bench/lfd X"]
        assert states["preload_low"] < states["preload"] < states["preload_high"]
        assert 70.0 < states["preload"] < 130.0
        assert states["problem"] == "off"
