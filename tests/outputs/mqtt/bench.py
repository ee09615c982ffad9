"""A broker that nobody here wrote, for the behaviour suite."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import aiomqtt
import pytest

from edge_service.outputs.base import Output

from ...drivers.mqtt.broker import MOSQUITTO, Broker
from ..bench import SECRET, OutputBench, output, silent_peer


@asynccontextmanager
async def bench(folder: Path) -> AsyncIterator[OutputBench]:
    if MOSQUITTO is None:
        pytest.skip("mosquitto is not installed (apt-get install mosquitto)")
    broker = Broker(folder)
    await broker.start()

    def make(port: int = broker.port) -> Output:
        return output("mqtt", {"url": f"mqtt://edge@127.0.0.1:{port}", "password": SECRET})

    async def heard() -> bool:
        async with aiomqtt.Client("127.0.0.1", broker.port) as client:
            await client.subscribe("feeddrive/hall/mill/X/preload")
            message = await anext(aiter(client.messages))
            return bool(message.retain) and b'"estimated"' in message.payload

    async with silent_peer() as silent:
        yield OutputBench(make, heard, broker.stop, broker.start, hanging=lambda: make(silent))
    await broker.stop()
