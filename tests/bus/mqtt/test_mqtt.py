"""Delivery to a broker that nobody here wrote: mosquitto."""

import asyncio
import gc
import json
import ssl
import subprocess
from collections.abc import Sequence
from pathlib import Path

import aiomqtt
import pytest

from edge_service.bus.mqtt.delivery import MqttDelivery, MqttError, MqttSettings
from edge_service.bus.mqtt.plain_json import PlainJson
from edge_service.bus.spool.message import Message, SpoolError
from edge_service.bus.spool.spool import Spool
from edge_service.config import ConfigError, load_config
from edge_service.config_tables import MqttConfig

from ...nodes.conftest import config_of, running
from .conftest import PATIENCE_S, Broker, empty, needs_broker, stop


def delivery_of(broker: Broker, spool: Spool, problems: list[str]) -> MqttDelivery:
    settings = MqttSettings("127.0.0.1", broker.port, "test", timeout_s=2.0)
    return MqttDelivery(settings, PlainJson("t"), spool, problems.append)


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


@needs_broker
async def test_every_message_arrives_in_order(broker: Broker, tmp_path: Path) -> None:
    spool, problems = await Spool.open(tmp_path / "spool", 1000), []  # type: ignore[var-annotated]
    delivery = delivery_of(broker, spool, problems)
    hearing = asyncio.create_task(hear(broker, "t/#", 301))
    await asyncio.sleep(0.3)
    delivering = asyncio.create_task(delivery.run())
    for number in range(300):
        await spool.put("X/x", b"%d" % number)
    heard = await hearing
    assert heard[0] == ("t/online", "true")
    assert heard[1:] == [("t/X/x", str(number)) for number in range(300)]
    await empty(spool)
    async with asyncio.timeout(PATIENCE_S):
        while not delivery.waits:  # the count follows what has left the disk
            await asyncio.sleep(0.01)
    assert delivery.delivered == 300
    assert problems == [""]
    await stop(delivering)
    spool.close()


@needs_broker
async def test_nothing_is_lost_while_the_broker_is_away(broker: Broker, tmp_path: Path) -> None:
    path, problems = tmp_path / "spool", []  # type: ignore[var-annotated]
    spool = await Spool.open(path, 1000)
    delivery = delivery_of(broker, spool, problems)
    delivering = asyncio.create_task(delivery.run())
    await spool.put("X/x", b"before")
    await empty(spool)
    await broker.stop()
    for number in range(50):
        await spool.put("X/x", b"%d" % number)
    async with asyncio.timeout(PATIENCE_S):
        while problems[-1] == "":
            await asyncio.sleep(0.01)
    await stop(delivering)
    spool.close()

    spool = await Spool.open(path, 1000)  # as after a restart of the service
    assert len(spool) == 50
    await broker.start()
    hearing = asyncio.create_task(hear(broker, "t/X/x", 50))
    await asyncio.sleep(0.3)
    delivering = asyncio.create_task(delivery_of(broker, spool, problems).run())
    assert [text for _, text in await hearing] == [str(number) for number in range(50)]
    await empty(spool)
    await stop(delivering)
    spool.close()


class Worn(Spool):
    """A spool on a disk that fails once."""

    failures = 1

    async def remove(self, messages: Sequence[Message]) -> None:
        if self.failures:
            self.failures -= 1
            raise SpoolError("the buffer fails: disk I/O error")
        await super().remove(messages)


@needs_broker
async def test_a_disk_that_fails_costs_a_repetition(broker: Broker, tmp_path: Path) -> None:
    spool, problems = await Worn.open(tmp_path / "spool", 10), []  # type: ignore[var-annotated]
    await spool.put("X/x", b"1")
    hearing = asyncio.create_task(hear(broker, "t/X/x", 2))
    await asyncio.sleep(0.3)
    delivering = asyncio.create_task(delivery_of(broker, spool, problems).run())
    assert [text for _, text in await hearing] == ["1", "1"]
    await empty(spool)
    assert problems == ["", f"127.0.0.1:{broker.port}: the buffer fails: disk I/O error", ""]
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
    assert await hear(broker, "feeddrive/bench/lfd/online", 1) == [
        ("feeddrive/bench/lfd/online", "false")  # retained: the service has said good-bye
    ]


class Certificates:
    """An authority, and what it signed, made with OpenSSL's own command."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._run("req", "-x509", "-subj", "/CN=authority", *self._new("ca"), "-out", "ca.pem")
        for name in ("broker", "client"):
            self._run("req", "-subj", f"/CN={name}", *self._new(name), "-out", f"{name}.csr")
            (folder / "names").write_text("subjectAltName=IP:127.0.0.1\n")
            signer = ("-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-extfile", "names")
            self._run("x509", "-req", "-in", f"{name}.csr", *signer, "-out", f"{name}.pem")

    def __getitem__(self, name: str) -> Path:
        return self._folder / name

    def _new(self, name: str) -> tuple[str, ...]:
        curve = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes")
        return (*curve, "-keyout", f"{name}.key")

    def _run(self, *arguments: str) -> None:
        subprocess.run(["openssl", *arguments], cwd=self._folder, check=True, capture_output=True)


@needs_broker
@pytest.mark.parametrize("with_certificate", [True, False])
async def test_over_tls_the_two_show_each_other_certificates(
    with_certificate: bool, tmp_path: Path
) -> None:
    files = Certificates(tmp_path)
    broker = Broker(
        tmp_path,
        f"cafile {files['ca.pem']}\ncertfile {files['broker.pem']}\n"
        f"keyfile {files['broker.key']}\nrequire_certificate true\n",
    )
    await broker.start()
    shown = (files["client.pem"], files["client.key"]) if with_certificate else (None, None)
    settings = MqttSettings(
        "127.0.0.1",
        broker.port,
        "test",
        ca_certificate=files["ca.pem"],
        client_certificate=shown[0],
        client_key=shown[1],
        timeout_s=2.0,
    )
    spool, problems = await Spool.open(tmp_path / "spool", 10), []  # type: ignore[var-annotated]
    await spool.put("X/x", b"secret")
    delivering = asyncio.create_task(
        MqttDelivery(settings, PlainJson("t"), spool, problems.append).run()
    )
    if with_certificate:
        context = ssl.create_default_context(cafile=files["ca.pem"])
        context.load_cert_chain(files["client.pem"], files["client.key"])
        await empty(spool)
        assert problems == [""]
        async with (
            asyncio.timeout(PATIENCE_S),
            aiomqtt.Client("127.0.0.1", broker.port, tls_context=context) as client,
        ):
            await client.subscribe("t/online")
            assert (await anext(aiter(client.messages))).payload == b"true"
    else:
        async with asyncio.timeout(PATIENCE_S):
            while not problems:
                await asyncio.sleep(0.01)
        assert problems[0].startswith(f"127.0.0.1:{broker.port}: ")
        assert len(spool) == 1
    await stop(delivering)
    await broker.stop()
    spool.close()


@needs_broker
async def test_a_broker_that_another_authority_signed_is_not_trusted(tmp_path: Path) -> None:
    for name in ("ours", "theirs"):
        (tmp_path / name).mkdir()
    ours, theirs = Certificates(tmp_path / "ours"), Certificates(tmp_path / "theirs")
    broker = Broker(tmp_path, f"certfile {theirs['broker.pem']}\nkeyfile {theirs['broker.key']}\n")
    await broker.start()
    settings = MqttSettings(
        "127.0.0.1", broker.port, "test", ca_certificate=ours["ca.pem"], timeout_s=2.0
    )
    spool, problems = await Spool.open(tmp_path / "spool", 10), []  # type: ignore[var-annotated]
    delivering = asyncio.create_task(
        MqttDelivery(settings, PlainJson("t"), spool, problems.append).run()
    )
    async with asyncio.timeout(PATIENCE_S):
        while not problems:
            await asyncio.sleep(0.01)
    assert "certificate verify failed" in problems[0]
    await stop(delivering)
    gc.collect()  # a socket that was left open would be an error here
    await broker.stop()
    spool.close()


MISTAKES = {
    "unknown key": ("host = 'h'\nprot = 1", "mqtt.prot: unknown key; did you mean 'port'?"),
    "no host": ("port = 1", "mqtt.host: missing"),
    "wildcard": ("host = 'h'\nprefix = 'a/#'", "mqtt: prefix 'a/#'"),
    "password that could be read": (
        "host = '10.0.0.1'\nuser = 'u'\npassword = 'p'",
        "mqtt: user: needs ca_certificate",
    ),
    "certificate without its key": (
        "host = 'h'\nca_certificate = 'ca.pem'\nclient_certificate = 'c.pem'",
        "mqtt: client_key: missing",
    ),
    "certificate without TLS": (
        "host = 'h'\nclient_certificate = 'c.pem'\nclient_key = 'c.key'",
        "mqtt: client_certificate: needs ca_certificate",
    ),
    "no such payload": ("host = 'h'\npayload = 'xml'", "mqtt.payload: Input should be"),
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
    path.write_text(
        '[mqtt]\nhost = "h"\nca_certificate = "ca.pem"\nclient_certificate = "c.pem"\n'
        'client_key = "c.key"\n[[axes]]\nname = "X"\n'
    )
    mqtt = load_config(path).mqtt
    assert mqtt is not None
    assert mqtt.buffer == tmp_path / "mqtt-buffer.sqlite"
    assert mqtt.ca_certificate == tmp_path / "ca.pem"
    assert (mqtt.client_certificate, mqtt.client_key) == (tmp_path / "c.pem", tmp_path / "c.key")


async def test_a_key_that_is_none_is_told(tmp_path: Path) -> None:
    files = Certificates(tmp_path)
    spool = await Spool.open(tmp_path / "spool", 10)
    settings = MqttSettings(
        "h",
        1,
        "c",
        ca_certificate=files["ca.pem"],
        client_certificate=files["client.pem"],
        client_key=files["ca.key"],
    )
    with pytest.raises(MqttError, match=r"mqtt\.client_certificate: .*client\.pem: cannot be used"):
        MqttDelivery(settings, PlainJson("t"), spool, lambda _: None)
    spool.close()


async def test_a_certificate_that_is_none_is_told(tmp_path: Path) -> None:
    spool = await Spool.open(tmp_path / "spool", 10)
    settings = MqttSettings("h", 1, "c", ca_certificate=tmp_path / "no.pem")
    with pytest.raises(MqttError, match=r"mqtt\.ca_certificate: .*cannot be used"):
        MqttDelivery(settings, PlainJson("t"), spool, lambda _: None)
    spool.close()
