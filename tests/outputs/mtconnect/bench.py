"""An agent for the behaviour suite."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from edge_service.outputs.base import Output
from edge_service.outputs.mtconnect import DEVICES_FILE

from ...drivers.bench import free_port
from ...nodes.conftest import until
from ..bench import OutputBench, PortTaker, output
from .agent import connected


@asynccontextmanager
async def bench(folder: Path) -> AsyncIterator[OutputBench]:
    taker = PortTaker(free_port())

    def make() -> Output:
        return output("mtconnect", {"endpoint": f"tcp://127.0.0.1:{taker.port}"}, folder)

    async def heard() -> bool:
        async with connected(taker.port, (folder / DEVICES_FILE).read_text()) as agent:
            await until(lambda: "condition_X" in agent.conditions)
            return agent.level("condition_X") == "NORMAL"

    yield OutputBench(make, heard, taker.start, taker.stop)
    await taker.stop()
