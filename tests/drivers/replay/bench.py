"""A recording: it can be missing, and hold cells without a number."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from drivers.replay import ReplayConfig, ReplayDriver

from ..bench import CONTEXT, DriverBench
from ..folder.bench import write_trace


@asynccontextmanager
async def bench(folder: Path) -> AsyncIterator[DriverBench]:
    path = folder / "trace.csv"
    write_trace(path, "0.2")

    async def spoil() -> None:
        write_trace(path, "")

    async def heal() -> None:
        write_trace(path, "0.2")

    config = ReplayConfig(path=path, speed=10.0, loop=True)
    yield DriverBench(lambda: ReplayDriver(config, CONTEXT), spoil=spoil, heal=heal)
