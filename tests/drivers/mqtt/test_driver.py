"""The driver against a mosquitto that nobody here wrote: the same samples, losses, refusals."""

import asyncio
import gc
import json
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import aiomqtt
import numpy as np
import pytest

from drivers.base import DriverMisconfiguredError, DriverUnavailableError
from drivers.mqtt.driver import MqttDriver
from drivers.stub import Fault, FaultKind
from edge_service.recordings.reader import joined
from tests.certificates import write_certificates

from ..bench import CONTEXT, samples_of, take
from .bench import TOPIC, config_of, stub_of
from .broker import MOSQUITTO, Broker, needs_broker
from .test_edge_stream import BLOCK, ROWS, messages, recorded

pytestmark = needs_broker
PASSWD = shutil.which("mosquitto_passwd")


@pytest.fixture
def collected() -> Iterator[None]:
    """Collect the garbage of a test with it."""
    yield
    gc.collect()


async def send(
    broker: Broker, payloads: list[Any], topic: str = TOPIC, *, retain: bool = False
) -> None:
    """Publish messages, each acknowledged before the next."""
    async with aiomqtt.Client("127.0.0.1", broker.port) as client:
        for each in payloads:
            content = each if isinstance(each, bytes) else json.dumps(each).encode()
            await client.publish(topic, content, qos=1, retain=retain)


@pytest.mark.parametrize(
    ("fault", "counter"), [(FaultKind.DROP, "lost_samples"), (FaultKind.STALE, "repeated_samples")]
)
async def test_what_the_stub_drops_and_repeats_is_counted(
    broker: Broker, fault: FaultKind, counter: str
) -> None:
    config = config_of(broker.port)
    stub, driver = stub_of(config), MqttDriver(config, CONTEXT)
    stub.fault = Fault(fault)
    await stub.start()
    try:
        await driver.open()
        frames = await take(driver, 150, samples_of)
        assert driver.counters[counter] >= 100
        assert driver.counters["restarts"] == 0
        assert (np.diff(joined(frames).time_s) > 0.0).all()
    finally:
        await driver.close()
        await stub.close()


async def test_a_broker_that_starts_again_is_a_gap_and_no_new_clock(broker: Broker) -> None:
    config, sent = config_of(broker.port), messages(recorded())
    driver = MqttDriver(config, CONTEXT)
    await driver.open()
    try:
        await send(broker, sent[:10])
        first = joined(await take(driver, 10 * BLOCK, samples_of)).time_s
        await broker.stop()
        with pytest.raises(DriverUnavailableError):
            await take(driver, 1)
        with pytest.raises(DriverUnavailableError):
            await driver.open()
        await broker.start()
        await driver.open()
        await send(broker, sent[15:])
        second = joined(await take(driver, 15 * BLOCK, samples_of)).time_s
        assert second[0] - first[-1] == pytest.approx(0.002 * (5 * BLOCK + 1))
        assert driver.counters["lost_samples"] == 5 * BLOCK
        assert driver.counters["connections"] == 2
    finally:
        await driver.close()


async def test_an_open_that_was_cancelled_is_done_again(broker: Broker) -> None:
    """Nothing is subscribed to yet, whatever the library has connected."""
    driver = MqttDriver(config_of(broker.port), CONTEXT)
    opening = asyncio.create_task(driver.open())
    await asyncio.sleep(0)  # its turn, up to the handshake
    opening.cancel()
    with pytest.raises(asyncio.CancelledError):
        await opening
    with pytest.raises(DriverUnavailableError, match="not open"):
        await take(driver, 1)
    await driver.open()
    try:
        assert driver.counters["connections"] == 1
        await send(broker, messages(recorded())[:1])
        assert samples_of(await take(driver, BLOCK, samples_of)) == BLOCK
    finally:
        await driver.close()


async def test_what_broker_retained_and_what_nobody_asked_for_is_counted(broker: Broker) -> None:
    sent = messages(recorded())
    await send(broker, sent[1:2], retain=True)
    driver = MqttDriver(config_of(broker.port), CONTEXT)
    await driver.open()
    assert driver._link is not None
    await driver._link.subscribe("another/#")  # as an earlier configuration may have left it
    try:
        await send(broker, sent[2:3], "another/capture")
        await send(broker, [{"Payload": sent[3]["Payload"]}])
        (frame,) = await take(driver, 1)
        np.testing.assert_array_equal(frame.channels["torque_command_nm"], recorded()[30:40, 3])
        assert driver.counters["retained_messages"] == driver.counters["foreign_messages"] == 1
    finally:
        await driver.close()


async def test_installations_have_names_of_their_own_and_one_that_is_taken_is_said(
    broker: Broker,
) -> None:
    boxes = [replace(CONTEXT, service="feeddrive/v1/s/mill", installation=i) for i in ("a", "b")]
    config, elsewhere = (config_of(broker.port, topic=each) for each in ("x", "y"))
    first = MqttDriver(config, boxes[0])
    assert first.client_id.startswith("edge-service-s-mill-X-")
    assert MqttDriver(config, boxes[0]).client_id == first.client_id
    others = {MqttDriver(config, boxes[1]).client_id, MqttDriver(elsewhere, boxes[0]).client_id}
    assert len(others | {first.client_id}) == 3
    second, told = MqttDriver(config, boxes[0]), ""
    for _ in range(3):
        await first.open()
        waiting = asyncio.create_task(take(first, 1))
        await second.open()
        with pytest.raises(DriverUnavailableError) as lost:
            await waiting
        told += str(lost.value)
    assert told.count("closed the connection") == 3
    assert told.count(f"another client seems to be {first.client_id}, too") == 1
    await first.close()
    await second.close()


async def test_the_broker_keeps_what_comes_while_the_session_is_away(broker: Broker) -> None:
    config, sent = config_of(broker.port), messages(recorded())
    driver = MqttDriver(config, CONTEXT)
    await driver.open()
    await driver.close()
    await send(broker, sent)
    await driver.open()
    try:
        assert samples_of(await take(driver, ROWS, samples_of)) == ROWS
        assert driver.counters["lost_samples"] == 0
    finally:
        await driver.close()


async def test_what_tells_no_time_is_not_kept_to_pass_for_new(broker: Broker) -> None:
    signals = [{"channel": "torque_command_nm", "member": "q"}]
    driver = MqttDriver(config_of(broker.port, signals=signals), CONTEXT)
    await driver.open()
    await driver.close()
    await send(broker, [{"q": 1.0}])
    await driver.open()
    try:
        await send(broker, [{"q": 2.0}])
        assert (await take(driver, 1))[0].channels["torque_command_nm"].tolist() == [2.0]
    finally:
        await driver.close()


@pytest.mark.skipif(PASSWD is None, reason="mosquitto_passwd is not installed")
async def test_a_wrong_password_names_a_key_and_a_right_one_is_let_in(tmp_path: Path) -> None:
    users = tmp_path / "users"
    command = [str(PASSWD), "-b", "-c", str(users), "edge", "right"]
    subprocess.run(command, check=True, capture_output=True)  # noqa: ASYNC221 - at once
    broker = Broker(tmp_path, f"password_file {users}\n")
    text = broker._config.read_text().replace("allow_anonymous true", "allow_anonymous false")
    broker._config.write_text(text)
    await broker.start()
    try:
        for changes in ({}, {"user": "edge", "password": "wrong"}):
            driver = MqttDriver(config_of(broker.port, **changes), CONTEXT)
            with pytest.raises(DriverMisconfiguredError) as refused:
                await driver.open()
            assert refused.value.key in ("url", "password")
            assert "wrong" not in str(refused.value)
            await driver.close()
        driver = MqttDriver(config_of(broker.port, user="edge", password="right"), CONTEXT)
        await driver.open()
        await driver.close()
    finally:
        await broker.stop()


@pytest.mark.usefixtures("collected")
async def test_tls_to_a_known_authority_alone(tmp_path: Path) -> None:
    assert MOSQUITTO is not None
    for name in ("ours", "another"):
        (tmp_path / name).mkdir()
        write_certificates(tmp_path / name)
    ours = tmp_path / "ours"
    broker = Broker(tmp_path, f"certfile {ours}/server.pem\nkeyfile {ours}/server.key\n")
    await broker.start()
    try:
        good = MqttDriver(config_of(broker.port, ca_certificate=ours / "ca.pem"), CONTEXT)
        await good.open()
        await good.close()
        for path in (tmp_path / "another" / "ca.pem", tmp_path / "nosuch.pem"):
            driver = MqttDriver(config_of(broker.port, ca_certificate=path), CONTEXT)
            with pytest.raises(DriverMisconfiguredError) as refused:
                await driver.open()
            assert refused.value.key == "ca_certificate"
            await driver.close()
    finally:
        await broker.stop()


async def test_a_probe_says_what_it_hears(broker: Broker, monkeypatch: Any) -> None:
    monkeypatch.setattr("drivers.mqtt.driver.LISTEN_S", 0.5)
    driver = MqttDriver(config_of(broker.port, topic="edge/#"), CONTEXT)
    with pytest.raises(DriverUnavailableError, match="nothing was heard"):
        await driver.probe()
    probing = asyncio.create_task(driver.probe())
    while not probing.done():
        await send(broker, [b"{}", b"what?"], "edge/other")
    with pytest.raises(DriverUnavailableError, match=r"edge/other \(no"):
        await probing
    probing = asyncio.create_task(driver.probe())
    while not probing.done():
        await send(broker, messages(recorded()))
    assert (await probing).rate_hz == pytest.approx(500.0)
    await driver.close()
