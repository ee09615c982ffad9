"""The simulated axis by itself: a recording of it, and what its equations cost."""

import asyncio
import time
from collections.abc import AsyncGenerator
from contextlib import aclosing
from pathlib import Path

from drivers.base import DriverContext
from drivers.simulated import SimulatedConfig, SimulatedDriver
from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.messages.channels import CHANNELS
from edge_service.messages.samples import SampleFrame
from edge_service.recordings.writer import TraceWriter

LIVE_FRAME_S = 0.1
_RECORDED_FRAME_S = 1.0
_WARM_UP_S = 1.0


def write_recording(path: Path, duration_s: float) -> None:
    """Record the healthy axis of the default machine for whole seconds of axis time."""

    async def record() -> None:
        with TraceWriter(path, tuple(CHANNELS)) as writer:
            async with aclosing(_frames(duration_s, _RECORDED_FRAME_S)) as frames:
                async for frame in frames:
                    writer.write(frame.until(duration_s))

    asyncio.run(record())


def simulation_share(duration_s: float) -> float:
    """Processor time over axis time of one simulated axis, in frames as the live service takes."""

    async def run() -> float:
        begun_s = 0.0
        async with aclosing(_frames(_WARM_UP_S + duration_s, LIVE_FRAME_S)) as frames:
            async for frame in frames:
                if frame.time_s[0] < _WARM_UP_S:
                    begun_s = time.process_time()
        return (time.process_time() - begun_s) / duration_s

    return asyncio.run(run())


async def _frames(duration_s: float, frame_s: float) -> AsyncGenerator[SampleFrame, None]:
    """Frames of the axis, as fast as it can, for `duration_s` of axis time."""
    config = SimulatedConfig(scenario="healthy", speed=0.0, frame_s=frame_s)
    driver = SimulatedDriver(config, DriverContext("X", load_machine(DEFAULT_MACHINE)))
    await driver.open()
    try:
        async with aclosing(driver.frames()) as frames:
            async for frame in frames:
                yield frame
                if frame.time_s[-1] + frame_s / 2.0 > duration_s:
                    return
    finally:
        await driver.close()
