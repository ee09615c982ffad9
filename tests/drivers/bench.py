"""Contract of a driver's own folder with the behaviour suite, and sources that need no plant."""

import asyncio
import socket
import tomllib
from collections.abc import AsyncGenerator, AsyncIterator, Awaitable, Callable
from contextlib import aclosing, asynccontextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from drivers.base import Driver, DriverContext
from drivers.stub import Fault, FaultKind, Stub
from edge_service.messages.samples import ANGLE, TABLE_POSITION, TEMPERATURE, TORQUE, SampleFrame
from edge_service.models.machine import Machine
from edge_service.recordings.reader import joined

ROOT = Path(__file__).parents[2]
MACHINE = Machine.model_validate(tomllib.loads((ROOT / "deploy" / "machine.toml").read_text()))
CONTEXT = DriverContext("X", MACHINE)
PATIENCE_S = 60.0
Action = Callable[[], Awaitable[None]]


@dataclass(frozen=True, slots=True)
class DriverBench:
    make: Callable[[], Driver]  # a new driver for the source
    lose: Action | None = None  # takes the source away; None where it cannot go
    bring_back: Action | None = None  # puts it back
    spoil: Action | None = None  # from now on the source's values are bad; None where it has none
    heal: Action | None = None  # from now on they are good again
    step: Callable[[float], None] | None = None  # sets its clock by so many seconds


@asynccontextmanager
async def stub_bench(
    stub_of: Callable[[], Stub], make: Callable[[], Driver], fault: FaultKind
) -> AsyncIterator[DriverBench]:
    """A stub over a real socket that goes and comes back, and whose `fault` spoils every value."""
    stubs = [stub_of()]
    await stubs[0].start()

    async def lose() -> None:
        await stubs.pop().close()

    async def bring_back() -> None:
        stubs.append(stub_of())
        await stubs[-1].start()

    async def spoil() -> None:
        stubs[-1].fault = Fault(fault)

    async def heal() -> None:
        stubs[-1].fault = Fault()

    try:
        yield DriverBench(make, lose, bring_back, spoil, heal)
    finally:
        for each in stubs:
            await each.close()


async def take(
    driver: Driver, count: int, size: Callable[[list[SampleFrame]], int] = len
) -> list[SampleFrame]:
    """The next frames of an open driver, until their size is so much."""
    taken: list[SampleFrame] = []
    async with asyncio.timeout(PATIENCE_S), aclosing(driver.frames()) as frames:
        while size(taken) < count and (frame := await anext(frames, None)) is not None:
            taken.append(frame)
    return taken


def samples_of(frames: list[SampleFrame]) -> int:
    return sum(map(len, frames))


def whole(frames: list[SampleFrame]) -> SampleFrame:
    """Frames that follow one another as one, with the quality of every channel."""
    quality = {
        name: np.concatenate([f.quality.get(name, np.zeros(len(f), np.uint8)) for f in frames])
        for name in frames[0].channels
    }
    return replace(joined(frames), quality=quality)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def truth(number: int) -> dict[str, float]:
    """Values of `counting_source` in its sample `number`, in SI units."""
    return {
        TORQUE: 0.25 + 0.001 * (number % 100),
        ANGLE: 0.5 * (number % 1000),
        TABLE_POSITION: 1e-5 * (number % 1000),
        TEMPERATURE: 21.5,
    }


async def counting_source(
    period_s: float = 0.002, ahead_s: Callable[[], float] = lambda: 0.0
) -> AsyncGenerator[SampleFrame, None]:
    """One sample after the other without end; every value follows from the sample's number."""
    number = 0
    while True:
        values = {name: np.array([value]) for name, value in truth(number).items()}
        yield SampleFrame(np.array([number * period_s + ahead_s()]), values)
        number += 1
        await asyncio.sleep(period_s)
