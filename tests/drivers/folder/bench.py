"""A folder with one trace; it can be gone, and hold cells without a number."""

import asyncio
import itertools
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from drivers.folder.driver import FolderConfig, FolderDriver

from ..bench import CONTEXT, DriverBench


def write_trace(path: Path, torque: str = "0.2", rows: int = 20_000) -> None:
    lines = "".join(f"{row / 1000},{torque},{row / 100}\n" for row in range(rows))
    path.write_text("time_s,torque_command_nm,motor_angle_rad\n" + lines)


@asynccontextmanager
async def bench(folder: Path) -> AsyncIterator[DriverBench]:
    traces, away = folder / "traces", folder / "away"
    traces.mkdir()
    trace = traces / "trace.csv"
    write_trace(trace)
    numbers = itertools.count()

    async def soon(wait_s: float) -> None:
        await asyncio.sleep(min(wait_s, 0.01))

    def make() -> FolderDriver:
        ledger = folder / f"ledger{next(numbers)}.json"
        config = FolderConfig(folder=traces)
        return FolderDriver(config, CONTEXT, sleep=soon, settle_s=0.0, ledger=ledger)

    async def lose() -> None:
        traces.rename(away)

    async def bring_back() -> None:
        away.rename(traces)
        write_trace(trace, "0.3")

    async def spoil() -> None:
        write_trace(trace, "")

    async def heal() -> None:
        write_trace(trace)

    yield DriverBench(make, lose, bring_back, spoil, heal)
