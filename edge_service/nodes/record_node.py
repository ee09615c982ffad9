"""Raw samples from the bus into trace files: on request, and around a disagreement."""

import asyncio
import logging
import signal
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from ..bus.session import Bus
from ..bus.settings import BusSettings
from ..clock import is_future, now_ns
from ..config import ConfigError, EdgeConfig
from ..downsample.rows import SampleRing
from ..messages.event import Event
from ..messages.samples import SampleFrame
from ..messages.topics import RAW
from ..recordings.columns import TraceError
from ..recordings.writer import TraceWriter
from ..threads import Threads

log = logging.getLogger(__name__)
KEEP_S = 45.0
"""Samples of every axis that are held in memory."""
BEFORE_S, AFTER_S = 2.0, 60.0
"""Of the beginning of a disagreement, and of the moment at which it was sure."""
LONGEST_S = 150.0
MOST_ROWS = 200_000
_MOST_WAITING = 4
"""Recordings that wait for the disk; the oldest go."""
MOST_KEPT = 5
"""Recordings of one axis that the service makes by itself; the oldest go."""
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
        return rows, subscriber.counts()["lost_payloads"]
    finally:
        await bus.close()


@dataclass(frozen=True, slots=True)
class _Cut:
    name: str
    from_s: float
    to_s: float


class DisagreementRecorder:
    """Follows samples and events of all axes.

    Args:
        folder: where recordings are kept.
        on_kept: called with axis and name of each recording that is ready.
    """

    def __init__(self, folder: Path, on_kept: Callable[[str, str], None]) -> None:
        self._folder = folder
        self._on_kept = on_kept
        self._rings: dict[str, SampleRing] = {}
        self._cuts: dict[str, _Cut] = {}
        self._ready: deque[tuple[str, str, list[SampleFrame]]] = deque(maxlen=_MOST_WAITING)
        self._wake = asyncio.Event()
        self._threads = Threads("recorder")

    def note(self, event: Event) -> None:
        """Begin to record what an event tells of; one at a time per axis."""
        name, since_s = event.data.get("recording"), event.data.get("since_s")
        ring = self._rings.get(event.axis)
        if event.kind != "model_disagrees" or ring is None or event.axis in self._cuts:
            return
        if isinstance(name, str) and isinstance(since_s, float):
            from_s = max(since_s - BEFORE_S, ring.newest_s - KEEP_S)
            to_s = min(ring.newest_s + AFTER_S, from_s + LONGEST_S)
            self._cuts[event.axis] = _Cut(name, from_s, to_s)
            ring.keep_s = to_s - from_s + 1.0

    def follow(self, axis: str, frame: SampleFrame) -> None:
        """Take samples in; what is complete is written by `run`."""
        ring = self._rings.setdefault(axis, SampleRing(KEEP_S, MOST_ROWS))
        ring.push(frame)
        cut = self._cuts.get(axis)
        if cut is None or cut.from_s <= ring.newest_s < cut.to_s:
            return
        del self._cuts[axis]
        ring.keep_s = KEEP_S
        frames = ring.cut(cut.from_s, cut.to_s)
        if frames:
            self._ready.append((axis, cut.name, frames))
            self._wake.set()

    async def run(self) -> None:
        """Write what is complete until cancelled; the disk holds up no sample."""
        while True:
            await self.write()
            self._wake.clear()
            await self._wake.wait()

    async def write(self) -> None:
        """Write all that is complete now."""
        while self._ready:
            axis, name, frames = self._ready.popleft()
            if await self._threads.run(self._keep, axis, name, frames):
                self._on_kept(axis, name)

    def _keep(self, axis: str, name: str, frames: list[SampleFrame]) -> bool:
        """Write a recording; one that is there stays; a full disk is logged and stops nothing."""
        path = self._folder / name
        if path.exists():
            return False
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with TraceWriter(path, tuple(frames[0].channels)) as writer:
                for frame in frames:
                    writer.write(frame)
            kept = self._folder.glob(f"disagreement_{axis}_*.parquet")
            for old in sorted(kept, key=_rank)[:-MOST_KEPT]:
                old.unlink(missing_ok=True)
        except (TraceError, OSError) as error:
            log.warning("%s: the recording of the disagreement cannot be saved: %s", path, error)
            return False
        return True


def _rank(path: Path) -> tuple[bool, str]:
    """Order in which recordings make room: those dated after now, then the oldest."""
    try:
        stamp = datetime.strptime(path.stem.rpartition("_")[2], "%Y%m%dT%H%M%SZ")
    except ValueError:
        return True, path.name
    return not is_future(stamp.replace(tzinfo=UTC).timestamp(), now_ns() / 1e9), path.name
