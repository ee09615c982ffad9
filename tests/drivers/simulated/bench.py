"""The simulated drive is its own source: it cannot be lost or spoiled."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from drivers.simulated import SimulatedConfig, SimulatedDriver

from ..bench import CONTEXT, DriverBench


@asynccontextmanager
async def bench(_folder: Path) -> AsyncIterator[DriverBench]:
    yield DriverBench(lambda: SimulatedDriver(SimulatedConfig(speed=10.0), CONTEXT))
