"""A mosquitto that goes and comes back, and a stub that sends a source's samples to it."""

from collections.abc import AsyncGenerator, AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from drivers.mqtt.driver import MqttDriver
from drivers.mqtt.link import MqttSourceConfig
from drivers.mqtt.stub import MqttStub
from drivers.stub import Fault, FaultKind, StubAxis
from edge_service.messages.samples import SampleFrame

from ..bench import CONTEXT, DriverBench, counting_source
from .broker import MOSQUITTO, Broker

TOPIC = "edge/capture/1"


def config_of(port: int, **changes: Any) -> MqttSourceConfig:
    user = f"{changes.pop('user')}@" if "user" in changes else ""
    scheme = "mqtts" if "ca_certificate" in changes else "mqtt"
    settings = {"url": f"{scheme}://{user}127.0.0.1:{port}", "topic": TOPIC}
    return MqttSourceConfig.model_validate(settings | changes)


def stub_of(
    config: MqttSourceConfig, source: AsyncGenerator[SampleFrame, None] | None = None
) -> MqttStub:
    return MqttStub([StubAxis("X", config, CONTEXT, source or counting_source())])


@asynccontextmanager
async def bench(folder: Path) -> AsyncIterator[DriverBench]:
    if MOSQUITTO is None:
        pytest.skip("mosquitto is not installed (apt-get install mosquitto)")
    broker = Broker(folder)
    await broker.start()
    config, ahead = config_of(broker.port), [0.0]
    stub = stub_of(config, counting_source(ahead_s=lambda: sum(ahead)))
    await stub.start()

    async def spoil() -> None:
        stub.fault = Fault(FaultKind.EXCEPTION)

    async def heal() -> None:
        stub.fault = Fault()

    try:
        yield DriverBench(
            lambda: MqttDriver(config, CONTEXT),
            *(broker.stop, broker.start, spoil, heal, ahead.append),
        )
    finally:
        await stub.close()
        await broker.stop()
