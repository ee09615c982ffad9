"""Delivery to a broker that nobody here wrote: mosquitto."""

import asyncio
import json
import shutil
from collections.abc import AsyncIterator
from pathlib import Path

import aiomqtt
import pytest

from edge_service.config import ConfigError, load_config
from edge_service.config_tables import MqttConfig
from edge_service.outputs.mqtt import MqttDelivery, MqttError, MqttSettings
from edge_service.outputs.spool import Spool

from ..drivers.bench import free_port
from ..nodes.conftest import config_of, running

PATIENCE_S = 20.0
MOSQUITTO = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
needs_broker = pytest.mark.skipif(
    MOSQUITTO is None, reason="mosquitto is not installed (apt-get install mosquitto)"
)


class Broker:
    """A broker as a process of its own, on one port for all its lives."""

    def __init__(self, folder: Path) -> None:
        self.port = free_port()
        self._config = folder / "mosquitto.conf"
        self._config.write_text(f"listener {self.port} 127.0.0.1\nallow_anonymous true\n")
        self._process: asyncio.subprocess.Process | None = None

    async def start(self) -> None:
        assert MOSQUITTO is not None
        self._process = await asyncio.create_subprocess_exec(
            MOSQUITTO,
            "-c",
            str(self._config),
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.DEVNULL,
        )
        async with asyncio.timeout(PATIENCE_S):
            while True:
                try:
                    _, writer = await asyncio.open_connection("127.0.0.1", self.port)
                    writer.close()
                    return
                except OSError:
                    await asyncio.sleep(0.02)

    async def stop(self) -> None:
        if self._process is not None:
            self._process.terminate()
            await self._process.wait()
            self._process = None


@pytest.fixture
async def broker(tmp_path: Path) -> AsyncIterator[Broker]:
    made = Broker(tmp_path)
    await made.start()
    yield made
    await made.stop()


def delivery_of(broker: Broker, spool: Spool, problems: list[str]) -> MqttDelivery:
    settings = MqttSettings("127.0.0.1", broker.port, "test", "t/online", timeout_s=2.0)
    return MqttDelivery(settings, spool, problems.append)


async def hear(broker: Broker, topic: str, count: int) -> list[tuple[str, str]]:
    """The next messages of a topic."""
    heard: list[tuple[str, str]] = []
    async with asyncio.timeout(PATIENCE_S), aiomqtt.Client("127.0.0.1", broker.port) as client:
        await client.subscribe(topic, qos=1)
        async for message in client.messages:
            assert isinstance(message.payload, bytes)
            heard.append((str(message.topic), message.payload.decode()))
            if len(heard) == count:
                break
    return heard


async def empty(spool: Spool) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while len(spool):
            await asyncio.sleep(0.01)


async def stop(task: "asyncio.Task[None]") -> None:
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


@needs_broker
async def test_every_message_arrives_in_order(broker: Broker, tmp_path: Path) -> None:
    spool, problems = Spool(tmp_path / "spool", 1000), []  # type: ignore[var-annotated]
    delivery = delivery_of(broker, spool, problems)
    hearing = asyncio.create_task(hear(broker, "t/#", 301))
    await asyncio.sleep(0.3)
    delivering = asyncio.create_task(delivery.run())
    for number in range(300):
        spool.put("t/x", b"%d" % number)
    heard = await hearing
    assert heard[0] == ("t/online", "true")
    assert heard[1:] == [("t/x", str(number)) for number in range(300)]
    await empty(spool)
    assert delivery.delivered == 300
    assert problems == [""]
    await stop(delivering)
    spool.close()


@needs_broker
async def test_nothing_is_lost_while_the_broker_is_away(broker: Broker, tmp_path: Path) -> None:
    path, problems = tmp_path / "spool", []  # type: ignore[var-annotated]
    spool = Spool(path, 1000)
    delivery = delivery_of(broker, spool, problems)
    delivering = asyncio.create_task(delivery.run())
    spool.put("t/x", b"before")
    await empty(spool)
    await broker.stop()
    for number in range(50):
        spool.put("t/x", b"%d" % number)
    async with asyncio.timeout(PATIENCE_S):
        while problems[-1] == "":
            await asyncio.sleep(0.01)
    await stop(delivering)
    spool.close()

    spool = Spool(path, 1000)  # as after a restart of the service
    assert len(spool) == 50
    await broker.start()
    hearing = asyncio.create_task(hear(broker, "t/x", 50))
    await asyncio.sleep(0.3)
    delivering = asyncio.create_task(delivery_of(broker, spool, problems).run())
    assert [text for _, text in await hearing] == [str(number) for number in range(50)]
    await empty(spool)
    await stop(delivering)
    spool.close()


@needs_broker
async def test_the_service_sends_what_is_on_the_bus(broker: Broker, tmp_path: Path) -> None:
    mqtt = MqttConfig(host="127.0.0.1", port=broker.port, buffer=tmp_path / "spool", period_s=0.5)
    config = config_of("simulated", {"scenario": "healthy", "speed": 20.0}, mqtt=mqtt)
    hearing = asyncio.create_task(hear(broker, "feeddrive/bench/lfd/X/#", 8))
    await asyncio.sleep(0.3)
    async with running(config, ("mqtt", "health", "estimate", "downsample", "acquire")):
        heard = await hearing
    topics = {topic.rpartition("/")[2] for topic, _ in heard}
    assert topics >= {"preload", "health"}
    for topic, text in heard:
        payload = json.loads(text)
        assert payload["schema"].split("/")[0] == topic.rpartition("/")[2]
        assert payload["axis"] == "X"
        assert "sequence" in payload
    presence = await hear(broker, "feeddrive/bench/lfd/online", 1)
    assert presence[0][1] in ("true", "false")


MISTAKES = {
    "unknown key": ("host = 'h'\nprot = 1", "mqtt.prot: unknown key; did you mean 'port'?"),
    "no host": ("port = 1", "mqtt.host: missing"),
    "wildcard": ("host = 'h'\nprefix = 'a/#'", "mqtt: prefix 'a/#'"),
    "password that could be read": (
        "host = '10.0.0.1'\nuser = 'u'\npassword = 'p'",
        "mqtt: user: needs ca_certificate",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_names_its_key(name: str, tmp_path: Path) -> None:
    text, expected = MISTAKES[name]
    path = tmp_path / "edge.toml"
    path.write_text(f'[mqtt]\n{text}\n[[axes]]\nname = "X"\n')
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    assert expected in str(caught.value)


def test_files_are_relative_to_the_configuration(tmp_path: Path) -> None:
    path = tmp_path / "edge.toml"
    path.write_text('[mqtt]\nhost = "h"\nca_certificate = "ca.pem"\n[[axes]]\nname = "X"\n')
    mqtt = load_config(path).mqtt
    assert mqtt is not None
    assert mqtt.buffer == tmp_path / "mqtt-buffer.sqlite"
    assert mqtt.ca_certificate == tmp_path / "ca.pem"


async def test_a_certificate_that_is_none_is_told(tmp_path: Path) -> None:
    spool = Spool(tmp_path / "spool", 10)
    settings = MqttSettings("h", 1, "c", "t", ca_certificate=tmp_path / "no.pem")
    with pytest.raises(MqttError, match=r"mqtt\.ca_certificate: .*cannot be used"):
        MqttDelivery(settings, spool, lambda _: None)
    spool.close()
