"""Raw samples from the bus into trace files: on request, around a disagreement, of a test."""

import asyncio
import logging
import math
import signal
import sys
import tempfile
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

from ..bus.session import Bus
from ..bus.settings import BusSettings
from ..command_answer import progress
from ..config import ConfigError, EdgeConfig
from ..downsample.rows import SampleRing
from ..messages.event import Event
from ..messages.features import FeatureBlock
from ..messages.samples import TIME, SampleFrame
from ..messages.topics import RAW
from ..models.commissioned import Notch
from ..process import finished
from ..recordings.writer import TraceWriter
from ..threads import Threads

log = logging.getLogger(__name__)
KEEP_S = 45.0
"""Samples of every axis that are held in memory."""
BEFORE_S, AFTER_S = 2.0, 60.0
"""Of the beginning of a disagreement, and of the moment at which it was sure."""
LONGEST_S, MOST_ROWS = 150.0, 200_000
MOST_WAITING = 4
"""Recordings that wait for the disk; further ones are lost."""
MOST_KEPT = 5
"""Recordings of one axis that the service makes by itself; the oldest go."""
FIRST_FRAME_S = 5.0
TEST_S, LONGEST_READING_S = 90.0, 120.0
"""Samples that may belong to a test by shaking; time in which it must be read."""
SHAKEN, SHAKEN_TORQUE, FASTEST = 0.05, 0.1, 1.5
"""Of a test: swing of the speed within an interval, over the feed at commissioning; deviation of
the torque, over the friction: a coarse encoder swings at rest; greatest speed, over that feed."""
CREDIT, QUIET_S = 2.0, 12.0
"""Gain of a second that is shaken; gain that makes a test, and loss that ends it: without
feedforward an axis hardly follows the upper half of the sweep, 10 s each way."""


async def record_axis(
    config: EdgeConfig, axis: str, out: Path, duration_s: float | None
) -> tuple[int, int]:
    """Record so many seconds of the axis, or until a signal; returns rows and payloads lost.

    Raises ConfigError: nothing is published for the axis; BusUnavailableError: no service runs.
    """
    place, key = config.bus, config.keys.key(axis, RAW)
    bus = await Bus.open(BusSettings(place.endpoint, "client", zenoh_file=place.zenoh_file))
    try:
        subscriber = bus.subscribe(key, RAW, depth=4096)
        for number in (signal.SIGINT, signal.SIGTERM):
            with suppress(NotImplementedError, RuntimeError):  # not the main thread: a test
                asyncio.get_running_loop().add_signal_handler(number, subscriber.close)
        frames, nothing = aiter(subscriber), (axis, None, None)
        try:
            async with asyncio.timeout(FIRST_FRAME_S):
                _, _, frame = await anext(frames, nothing)
        except TimeoutError:
            frame = None
        if frame is None:
            raise ConfigError(f"{key}: nothing is published; check the name of the axis")
        rows, begun_s, told = 0, float(frame.time_s[0]), 0
        end_s = math.inf if duration_s is None else begun_s + duration_s
        with TraceWriter(out, tuple(frame.channels)) as writer:
            while frame is not None and len(frame := frame.part(frame.time_s < end_s)):
                writer.write(frame)
                rows += len(frame)
                tenths = 10.0 * (frame.time_s[-1] - begun_s) / (end_s - begun_s)
                if tenths >= told + 1:
                    told = int(tenths)
                    progress(f"recording axis {axis}: {10 * told} %")
                _, _, frame = await anext(frames, nothing)
        return rows, subscriber.counts()["lost_payloads"]
    finally:
        await bus.close()


class DisagreementRecorder:
    """Records any axis around disagreements; tells axis and name of what is ready."""

    def __init__(self, folder: Path, on_kept: Callable[[str, str], Awaitable[None]]) -> None:
        self._folder, self._on_kept = folder, on_kept
        self._rings: dict[str, SampleRing] = {}
        self._cuts: dict[str, tuple[str, float, float]] = {}
        """By axis: name of what is being recorded, its beginning and end, s."""
        self._ready = asyncio.Queue[tuple[str, str, list[SampleFrame]]](MOST_WAITING)
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
            self._cuts[event.axis] = name, from_s, to_s
            ring.keep_s = to_s - from_s + 1.0

    def follow(self, axis: str, frame: SampleFrame) -> None:
        """Take samples in; what is complete is written by `run`."""
        ring = self._rings.setdefault(axis, SampleRing(KEEP_S, MOST_ROWS))
        ring.push(frame)
        name, from_s, to_s = self._cuts.get(axis, ("", -math.inf, math.inf))
        if name and not from_s <= ring.newest_s < to_s:
            del self._cuts[axis]
            ring.keep_s = KEEP_S
            frames = ring.cut(from_s, to_s)
            if frames and not self._ready.full():
                self._ready.put_nowait((axis, name, frames))

    async def run(self) -> None:
        """Write what is complete until cancelled; the disk holds up no sample."""
        while True:
            axis, name, frames = await self._ready.get()
            if await self._keep(axis, name, frames):
                await self._on_kept(axis, name)
            self._ready.task_done()

    async def _keep(self, axis: str, name: str, frames: list[SampleFrame]) -> bool:
        """Write a recording; one that is there stays; a full disk is logged and stops nothing."""
        path = self._folder / name
        try:
            await self._threads.run(lambda: self._folder.mkdir(parents=True, exist_ok=True))
            if await self._threads.run(path.exists):
                return False
            with tempfile.TemporaryDirectory(prefix="edge-recording-") as folder:
                rows = Path(folder) / "rows.npz"
                await self._threads.run(_save, rows, frames)
                program = (sys.executable, "-m", TraceWriter.__module__, str(rows), str(path))
                status, said = await finished(program=program, limit_s=LONGEST_READING_S)
            if status:
                raise OSError(said)
            await self._threads.run(self._drop_oldest, axis)
        except OSError as error:
            log.warning("%s: the recording of the disagreement cannot be saved: %s", path, error)
            return False
        return True

    def _drop_oldest(self, axis: str) -> None:
        for old in sorted(self._folder.glob(f"disagreement_{axis}_*.parquet"))[:-MOST_KEPT]:
            old.unlink(missing_ok=True)


class Shaking:
    """Tests by shaking of one axis, seen by feed and Coulomb friction, and its newest samples."""

    def __init__(self, feed_rad_s: float, friction_nm: float) -> None:
        self._feed_rad_s, self._friction_nm = feed_rad_s, friction_nm
        self.samples = SampleRing(TEST_S, 2 * MOST_ROWS)
        self._begun_s, self._gained_s, self._is_test = 0.0, 0.0, False

    def over(self, block: FeatureBlock) -> list[SampleFrame]:
        """Take the next interval in; samples of a test that is over with it, empty without one."""
        speed = abs(block.angle_end_rad - block.angle_start_rad) / block.duration_s
        swing = block.speed_max_rad_s - block.speed_min_rad_s
        swing -= abs(block.speed_end_rad_s - block.speed_start_rad_s)
        shaken = speed < FASTEST * self._feed_rad_s and swing > SHAKEN * self._feed_rad_s
        shaken &= block.torque_std_nm > SHAKEN_TORQUE * self._friction_nm
        gain_s = block.duration_s * (CREDIT if shaken else -1.0)
        self._gained_s = min(max(self._gained_s + gain_s, 0.0), QUIET_S)
        self._is_test |= self._gained_s == QUIET_S
        if self._gained_s > 0.0:
            return []
        begun_s, was_test = self._begun_s, self._is_test
        self._begun_s, self._is_test = block.time_s, False
        return self.samples.cut(begun_s - BEFORE_S, block.time_s) if was_test else []


async def notch_in(frames: list[SampleFrame]) -> Notch | None:
    """Notch of a test, None of none, read by a process that ends. ValueError: it cannot be used."""
    with tempfile.TemporaryDirectory(prefix="edge-test-") as folder:
        path = Path(folder) / "test.npz"
        await Threads("test").run(_save, path, frames)
        program = (sys.executable, "-m", "edge_service.fingerprint.response.notch", str(path))
        status, said = await finished(program=program, limit_s=LONGEST_READING_S)
    if status:
        raise ValueError(said.partition(": ")[2] or f"it cannot be read ({said})")
    return Notch.model_validate_json(said) if said else None


def _save(path: Path, frames: list[SampleFrame]) -> None:
    """Write frames for `handed` in another process: 50 MB of Arrow would stay in this one."""
    names = list(dict.fromkeys(name for each in frames for name in each.channels))
    held = [(np.full(len(e), np.nan), {TIME: e.time_s, **e.channels}) for e in frames]
    rows = {n: np.concatenate([each.get(n, no) for no, each in held]) for n in (TIME, *names)}
    np.savez(path, allow_pickle=False, **rows)
