"""A recording of the simulated axis."""

import asyncio
from collections.abc import AsyncGenerator
from contextlib import aclosing
from pathlib import Path

from drivers.base import DriverContext
from drivers.simulated import SimulatedConfig, SimulatedDriver
from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.messages.samples import CHANNELS, SampleFrame
from edge_service.recordings.writer import TraceWriter

_RECORDED_FRAME_S = 1.0


def write_recording(path: Path, duration_s: float) -> None:
    """Record the healthy axis of the default machine for whole seconds of axis time."""

    async def record() -> None:
        with TraceWriter(path, tuple(CHANNELS)) as writer:
            async with aclosing(_frames(duration_s, _RECORDED_FRAME_S)) as frames:
                async for frame in frames:
                    writer.write(frame.part(frame.time_s < duration_s))

    asyncio.run(record())


async def _frames(duration_s: float, frame_s: float) -> AsyncGenerator[SampleFrame, None]:
    """Frames of the axis, as fast as it can, for `duration_s` of axis time."""
    config = SimulatedConfig(scenario="healthy", speed=0.0)
    driver = SimulatedDriver(config, DriverContext("X", load_machine(DEFAULT_MACHINE)))
    driver.frame_s = frame_s
    await driver.open()
    try:
        async with aclosing(driver.frames()) as frames:
            async for frame in frames:
                yield frame
                if frame.time_s[-1] + frame_s / 2.0 > duration_s:
                    return
    finally:
        await driver.close()
