"""A recording of the simulated axis."""

import asyncio
from contextlib import aclosing
from pathlib import Path

from drivers.base import DriverContext
from drivers.simulated import SimulatedConfig, SimulatedDriver
from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.messages.samples import CHANNELS
from edge_service.recordings.writer import TraceWriter


def write_recording(path: Path, duration_s: float, rate_hz: float = 1000.0) -> None:
    """Record the healthy axis of the default machine for whole seconds of axis time."""

    async def record() -> None:
        config = SimulatedConfig(scenario="healthy", speed=0.0, rate_hz=rate_hz)
        driver = SimulatedDriver(config, DriverContext("X", load_machine(DEFAULT_MACHINE)))
        driver.frame_s = 1.0
        await driver.open()
        with TraceWriter(path, tuple(CHANNELS)) as writer:
            async with aclosing(driver.frames()) as frames:
                async for frame in frames:
                    writer.write(frame.part(frame.time_s < duration_s))
                    if frame.time_s[-1] + 0.5 > duration_s:
                        break
        await driver.close()

    asyncio.run(record())
