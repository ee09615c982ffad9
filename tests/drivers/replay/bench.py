"""A recording: it can be missing, and hold cells without a number."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from drivers.replay import ReplayConfig, ReplayDriver

from ..bench import CONTEXT, DriverBench


def write(path: Path, torque: str) -> None:
    rows = "".join(f"{row / 1000},{torque},{row / 100}\n" for row in range(20_000))
    path.write_text("time_s,torque_command_nm,motor_angle_rad\n" + rows)


@asynccontextmanager
async def bench(folder: Path) -> AsyncIterator[DriverBench]:
    path = folder / "trace.csv"
    write(path, "0.2")

    async def spoil() -> None:
        write(path, "")

    async def heal() -> None:
        write(path, "0.2")

    config = ReplayConfig(path=path, speed=10.0, loop=True)
    yield DriverBench(lambda: ReplayDriver(config, CONTEXT), spoil=spoil, heal=heal)
