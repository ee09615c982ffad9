"""A client of OPC UA for the behaviour suite."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from asyncua import Client

from edge_service.outputs.base import Output

from ...drivers.bench import free_port
from ..bench import OutputBench, PortTaker, output


@asynccontextmanager
async def bench(folder: Path) -> AsyncIterator[OutputBench]:
    taker = PortTaker(free_port())
    url = f"opc.tcp://127.0.0.1:{taker.port}"

    def make() -> Output:
        return output("opcua", {"endpoint": url})

    async def heard() -> bool:
        async with Client(f"{url}/edge-service/") as client:
            index = await client.get_namespace_index("urn:edge-service:axes")
            condition = client.get_node(f"ns={index};s=X.Condition")
            return (await condition.read_data_value(False)).Value.Value == "NORMAL"

    yield OutputBench(make, heard, taker.start, taker.stop)
    await taker.stop()
