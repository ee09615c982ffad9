"""MQTT as foreign clients see it: a broker, Home Assistant, and a host of Sparkplug."""

import asyncio
import gc
import json
import signal
import weakref
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any

import aiomqtt
import pytest
from pydantic import ValidationError

from edge_service.messages.estimate import ImmEstimate
from edge_service.messages.event import AxisCondition
from edge_service.messages.health import AlarmKind
from edge_service.messages.trend import Crossing, Trend, TrendStatus
from edge_service.outputs import mqtt as module
from edge_service.outputs.base import Events, Output, OutputUnavailableError
from edge_service.outputs.mqtt import COMPONENTS, MqttConfig
from edge_service.outputs.sparkplug import METRICS, REBIRTH

from ...drivers.mqtt.broker import Broker, needs_broker
from ...messages.answers import MEASURED_NS, SILENT, alarm_of, answer, health_of
from ...nodes.conftest import until
from ..bench import event, output
from .home_assistant_reader import UNAVAILABLE, UNKNOWN, home_assistant
from .sparkplug_reader import decode, rebirth

pytestmark = needs_broker
ROOT = "feeddrive/hall/mill"
TOLD = ("X/preload", "X/health", "X/imm")
OPINION = ImmEstimate(axis="X", mode_probability={"10": 0.25, "0": 0.75}, engine="compiled")


@pytest.fixture(autouse=True)
def every_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Answers need not wait for their second."""
    monkeypatch.setattr(module, "PERIOD_S", 0.0)


@asynccontextmanager
async def telling(broker: Broker, form: str = "json", **facts: Any) -> AsyncIterator[Output]:
    made = output("mqtt", {"url": f"mqtt://127.0.0.1:{broker.port}", "format": form}, **facts)
    await made.open()
    try:
        yield made
    finally:
        await made.close()


@asynccontextmanager
async def listening(broker: Broker, topic: str = "#") -> AsyncIterator[list[aiomqtt.Message]]:
    heard: list[aiomqtt.Message] = []
    async with aiomqtt.Client("127.0.0.1", broker.port) as client:
        await client.subscribe(topic, qos=1)

        async def read() -> None:
            async for message in client.messages:
                heard.append(message)

        task = asyncio.create_task(read())
        yield heard
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def there(heard: list[aiomqtt.Message], *topics: str) -> dict[str, Any]:
    """The last payload on each topic, once there is one."""
    await until(lambda: set(topics) <= {str(each.topic) for each in heard})
    return {str(each.topic): each.payload for each in heard}


async def test_the_newest_answers_are_retained_and_events_are_not(broker: Broker) -> None:
    async with listening(broker) as live, telling(broker) as made:
        await made.take(answer(preload_percent=6.7))
        half = answer(preload_percent=3.425, low=3.0, high=4.0)
        await made.take(replace(half, opinion=OPINION))
        await made.take(Events("", (event(),)))
        said = await there(live, f"{ROOT}/X/event")
        assert json.loads(said[f"{ROOT}/X/event"])["kind"] == "alarm_raised"
        async with listening(broker) as late:
            said = await there(late, *(f"{ROOT}/{each}" for each in (*TOLD, "status")))
        assert all(each.retain for each in late)
        assert f"{ROOT}/X/event" not in said
        preload = json.loads(said[f"{ROOT}/X/preload"])
        assert preload["schema"] == "preload/1"
        assert preload["of_fresh"]["value"] == pytest.approx(50.0)
        assert preload["measured_at"] == "2026-09-21T14:13:20.000Z"
        assert json.loads(said[f"{ROOT}/X/health"])["condition"] == "NORMAL"
        opinion = json.loads(said[f"{ROOT}/X/imm"])
        assert (opinion.pop("schema"), ImmEstimate.model_validate(opinion)) == ("imm/1", OPINION)
        assert said[f"{ROOT}/status"] == b"online"
        await made.take(SILENT)
        async with listening(broker, f"{ROOT}/X/preload") as late:
            said = await there(late, f"{ROOT}/X/preload")
        assert json.loads(said[f"{ROOT}/X/preload"])["of_fresh"] is None
    async with listening(broker) as late:
        assert (await there(late, f"{ROOT}/status"))[f"{ROOT}/status"] == b"offline"


async def test_of_an_axis_that_is_gone_nothing_stays_retained(broker: Broker) -> None:
    async with telling(broker, "home-assistant") as made:
        await made.take(answer("X"))
        await made.take(answer("Z"))
    async with telling(broker, "home-assistant", gone=("Z",)), listening(broker) as late:
        await there(late, *(f"{ROOT}/{each}" for each in TOLD))
        assert not [str(each.topic) for each in late if "Z" in str(each.topic)]


async def test_a_test_message_says_nothing_of_the_service_that_runs(broker: Broker) -> None:
    url = {"url": f"mqtt://127.0.0.1:{broker.port}"}
    async with listening(broker) as live, telling(broker) as made:
        tried = output("mqtt", url, is_test=True)
        await tried.open()
        await tried.take(Events("", (event(kind="test", axis=""),)))
        await tried.close()
        await made.take(Events("", (event(),)))
        await there(live, f"{ROOT}/X/event", f"{ROOT}/event/event")
        told = [each.payload for each in live if str(each.topic) == f"{ROOT}/status"]
        assert told == [b"online"]


@pytest.mark.parametrize("hangs", [False, pytest.param(True, marks=pytest.mark.slow)])
async def test_answers_are_sent_once_in_a_period_and_the_will_tells_of_an_end(
    broker: Broker, monkeypatch: pytest.MonkeyPatch, hangs: bool
) -> None:
    monkeypatch.setattr(module, "SILENT_S", 1)
    monkeypatch.setattr(module, "PERIOD_S", 1000.0)
    async with listening(broker) as live:
        made = output("mqtt", {"url": f"mqtt://127.0.0.1:{broker.port}"})
        await made.open()
        for axis in ("X", "X", "X", "Y"):
            await made.take(answer(axis))
        await there(live, f"{ROOT}/Y/preload")
        assert sum(str(each.topic) == f"{ROOT}/X/preload" for each in live) == 1
        client = made._client  # one that hangs sends no sign of life; the broker looks every 5 s
        (client._misc_task.cancel if hangs else client._client._sock_close)()
        await until(lambda: any(each.payload == b"offline" for each in live))
        with pytest.raises(OutputUnavailableError):
            for _ in range(100):
                await made.take(Events("", (event(),)))
                await asyncio.sleep(0.01)
        await made.close()


@pytest.mark.slow
async def test_a_broker_that_hangs_leaves_no_error_in_the_log(
    broker: Broker, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(module, "SILENT_S", 1)  # missed before the answer is
    async with telling(broker) as made:
        left, process = weakref.ref(made._client), broker._process
        process.send_signal(signal.SIGSTOP)
        with pytest.raises(OutputUnavailableError):
            await made.take(answer())
        process.send_signal(signal.SIGCONT)
        await until(lambda: gc.collect() >= 0 and left() is None)
    assert "never retrieved" not in caplog.text


async def shows(home: Any, device: str, **expected: Any) -> None:
    await until(lambda: expected.items() <= home.devices().get(device, {}).items())


async def test_home_assistant_finds_every_axis_and_shows_only_what_may_be_read(
    broker: Broker,
) -> None:
    limit = Crossing(
        limit="fault", limit_percent=1.0, earliest_ns=MEASURED_NS, likely_ns=None, latest_ns=None
    )
    trend = Trend(status=TrendStatus.FALLING, reason="r", since_time_ns=1, crossings=(limit,))
    lost = alarm_of(AlarmKind.PRELOAD_LOST, text='preload at "17 %"')
    worn = health_of(AxisCondition.WARNING, alarms=(lost,), trend=trend)
    async with home_assistant(broker.port) as home:
        async with telling(broker, "home-assistant") as made:
            await made.take(answer(preload_percent=3.425, low=3.0825, high=3.7675, health=worn))
            await shows(home, "hall/mill X", preload=50.0, preload_low=45.0, preload_high=55.0)
            await shows(home, "hall/mill X", condition="WARNING", problem="on")
            await shows(home, "hall/mill X", next_limit="2026-09-21T14:13:20.000Z")
            assert home.attributes("hall/mill X", "problem") == {"preload_lost": lost.text}
            await made.take(answer())
            await shows(home, "hall/mill X", condition="NORMAL", problem="off", next_limit=UNKNOWN)
            await made.take(SILENT)
            await shows(home, "hall/mill X", preload=UNKNOWN, condition=UNKNOWN, problem=UNKNOWN)
        await shows(home, "hall/mill X", **dict.fromkeys(COMPONENTS, UNAVAILABLE))


async def test_sparkplug_is_born_tells_changes_and_dies(broker: Broker) -> None:
    async with listening(broker, "spBv1.0/#") as heard:
        async with telling(broker, "sparkplug") as made:
            await made.take(answer(preload_percent=3.425, low=3.0, high=4.0))
            await made.take(answer(preload_percent=3.425, low=3.0, high=4.0))
            await made.take(answer(preload_percent=3.5, low=3.0, high=4.0))
            await made.take(Events("", (event(),)))
            await made.take(SILENT)
            said = await there(heard, "spBv1.0/hall/DDEATH/mill/X")
            kinds = [str(each.topic).split("/")[2] for each in heard]
            assert kinds == ["NBIRTH", "DBIRTH", "DDATA", "DDATA", "DDEATH"]
            births = [decode(each.payload) for each in heard]
            assert [each.seq for each in births] == [0, 1, 2, 3, 4]
            assert births[0].values[REBIRTH] is False
            assert births[1].values.keys() == METRICS.keys()
            assert births[1].values["preload/of_fresh/value"] == pytest.approx(50.0)
            assert births[1].values["health/condition"] == "NORMAL"
            assert births[1].values["preload/stiffness_n_per_m/value"] is None
            assert births[2].values["preload/preload_percent"] == 3.5
            assert "preload/low" not in births[2].values
            assert births[3].values["event/kind"] == "alarm_raised"
            heard.clear()
            async with aiomqtt.Client("127.0.0.1", broker.port) as host:
                await host.publish("spBv1.0/hall/NCMD/mill", b"no payload")
                await host.publish("spBv1.0/hall/NCMD/mill", rebirth())
            said = await there(heard, "spBv1.0/hall/NBIRTH/mill")
            number = decode(said["spBv1.0/hall/NBIRTH/mill"]).values["bdSeq"]
        said = await there(heard, "spBv1.0/hall/NDEATH/mill")
        assert decode(said["spBv1.0/hall/NDEATH/mill"]).values == {"bdSeq": number}


@pytest.mark.parametrize(
    ("table", "complaint"),
    [
        ({"url": "http://broker"}, "expected mqtt://HOST"),
        ({"url": "mqtt://edge:hush@broker"}, "holds a password"),
        ({"url": "mqtt://edge@broker"}, "a user needs mqtts"),
        ({"url": "mqtt://broker", "password": "x"}, "names no user"),
        ({"url": "mqtts://broker", "client_key": "k"}, "client_certificate: missing"),
        ({"url": "mqtt://broker", "ca_certificate": "c"}, "expected mqtts"),
        ({"url": "mqtt://broker", "prefix": "a/#"}, "without [+], # and"),
    ],
)
def test_what_cannot_work_is_refused(table: dict[str, str], complaint: str) -> None:
    with pytest.raises(ValidationError, match=complaint) as caught:
        MqttConfig.model_validate(table)
    assert "hush" not in str(caught.value)
