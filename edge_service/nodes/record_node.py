"""Raw samples of one axis from the bus into a trace file."""

import asyncio
import signal
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ..bus.session import Bus
from ..bus.settings import BusSettings
from ..config import ConfigError, EdgeConfig
from ..messages.topics import RAW
from ..recordings.writer import TraceWriter

FIRST_FRAME_S = 5.0


async def record_axis(
    config: EdgeConfig,
    axis: str,
    out: Path,
    duration_s: float | None,
    tell: Callable[[float], None] = lambda _share: None,
) -> tuple[int, int]:
    """Record until `duration_s` of axis time, SIGINT or SIGTERM.

    Args:
        tell: takes the share that is recorded, once a second.

    Returns:
        Rows written and payloads lost on the way.

    Raises:
        ConfigError: nothing is published for the axis. BusUnavailableError: no service runs.
    """
    place = config.bus
    bus = await Bus.open(BusSettings(place.endpoint, "client", zenoh_file=place.zenoh_file))
    try:
        subscriber = bus.subscribe(config.keys.key(axis, RAW), RAW, depth=4096)
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            with suppress(NotImplementedError, RuntimeError):
                loop.add_signal_handler(number, subscriber.close)
        frames = aiter(subscriber)
        try:
            async with asyncio.timeout(FIRST_FRAME_S):
                _, _, frame = await anext(frames)
        except (TimeoutError, StopAsyncIteration):
            raise ConfigError(
                f"{config.keys.key(axis, RAW)}: nothing is published; check the name of the axis"
            ) from None
        rows, first_s = 0, float(frame.time_s[0])
        told_s = first_s
        with TraceWriter(out, tuple(frame.channels)) as writer:
            while True:
                if duration_s is not None:
                    frame = frame.until(first_s + duration_s)
                writer.write(frame)
                rows += len(frame)
                if duration_s and len(frame) and frame.time_s[-1] >= told_s + 1.0:
                    told_s = float(frame.time_s[-1])
                    tell((told_s - first_s) / duration_s)
                if duration_s is not None and frame.time_s.size == 0:
                    break
                try:
                    _, _, frame = await anext(frames)
                except StopAsyncIteration:
                    break
        return rows, subscriber.counters.lost_payloads
    finally:
        await bus.close()
