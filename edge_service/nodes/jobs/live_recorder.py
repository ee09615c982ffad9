"""Recording of an axis that a person has asked for, written as the samples come."""

import asyncio
import logging
import shutil
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock

from ...http_api.jobs import RefusedError
from ...http_api.routes.motions import LiveRecordingAnswer
from ...messages.samples import SampleFrame
from ...recordings.columns import TraceError
from ...recordings.writer import TraceWriter
from ..supervision.heartbeat import Heartbeat
from .recordings import LEFT_FREE_BYTES

log = logging.getLogger(__name__)
MOST_WAITING_ROWS = 2_000_000
"""Rows that wait for the disk; then the recording ends."""
LATEST_S = 10.0
"""Delay after which no more samples of a recording are waited for, s."""


@dataclass(slots=True)
class _Recording:
    axis: str
    name: str
    seconds: float
    waiting: deque[SampleFrame] = field(default_factory=deque)
    first_s: float | None = None
    recorded_s: float = 0.0
    ended: bool = False

    def take(self, frame: SampleFrame) -> None:
        """Add the samples that are within the length asked for."""
        if self.first_s is None:
            self.first_s = float(frame.time_s[0])
        inside = frame.until(self.first_s + self.seconds)
        if len(inside):
            self.waiting.append(inside)
            self.recorded_s = float(inside.time_s[-1]) - self.first_s
        is_late = sum(map(len, self.waiting)) > MOST_WAITING_ROWS
        self.ended = len(inside) < len(frame) or is_late


class LiveRecorder:
    """Makes one recording at a time.

    Args:
        folder: where recordings are kept.
        latest_s: delay of samples that is waited for; then a recording ends without them.
    """

    def __init__(self, folder: Path, latest_s: float = LATEST_S) -> None:
        self._folder, self._latest_s = folder, latest_s
        self._now: _Recording | None = None
        self._wake = asyncio.Event()

    def live(self) -> LiveRecordingAnswer | None:
        """The recording that is being made."""
        now = self._now
        if now is None:
            return None
        return LiveRecordingAnswer(
            axis=now.axis, name=now.name, seconds=now.seconds, recorded_s=now.recorded_s
        )

    def start(self, axis: str, name: str, seconds: float) -> LiveRecordingAnswer:
        """Begin to record. Raises RefusedError."""
        if self._now is not None:
            raise RefusedError(
                409,
                f"axis {self._now.axis} is already being recorded: wait, or stop that recording",
            )
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            free = shutil.disk_usage(self._folder).free
        except OSError as error:
            raise RefusedError(507, f"{name}: cannot be kept ({error.strerror})") from None
        if free < LEFT_FREE_BYTES:
            raise RefusedError(507, "the disk is nearly full: remove some recordings")
        self._now = _Recording(axis, name, seconds)
        loop = asyncio.get_running_loop()
        loop.call_later(seconds + self._latest_s, self._end, self._now)
        return LiveRecordingAnswer(axis=axis, name=name, seconds=seconds, recorded_s=0.0)

    def stop(self, axis: str) -> None:
        """End it early, and keep what there is. Raises RefusedError."""
        if self._now is None or self._now.axis != axis:
            raise RefusedError(409, f"axis {axis} is not being recorded")
        self._end(self._now)

    def _end(self, recording: _Recording) -> None:
        recording.ended = True
        self._wake.set()

    def follow(self, axis: str, frame: SampleFrame) -> None:
        """Take samples in; `run` writes them."""
        now = self._now
        if now is not None and now.axis == axis and not now.ended and len(frame):
            now.take(frame)
            self._wake.set()

    async def run(self, heart: Heartbeat) -> None:
        """Write what comes until cancelled; the disk holds up no sample."""
        output: _Output | None = None
        try:
            while True:
                with heart.idle(lambda: not self._wake.is_set()):
                    await self._wake.wait()
                self._wake.clear()
                now = self._now
                if now is not None:
                    output = output or _Output(self._folder / now.name)
                    if await self._is_over(heart, now, output):
                        self._now = output = None
        finally:
            if output is not None:
                output.give_up()

    async def _is_over(self, heart: Heartbeat, now: _Recording, output: "_Output") -> bool:
        """Write all that waits; whether that was the end of the recording."""
        frames = [now.waiting.popleft() for _ in range(len(now.waiting))]
        is_over = now.ended
        try:
            await heart.in_thread(output.write, frames, is_over)
        except (TraceError, OSError) as error:
            log.warning("%s: the recording cannot be kept: %s", now.name, error)
            return True
        return is_over


class _Output:
    """File of one recording: written in a thread, given up from anywhere without waiting."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._writer: TraceWriter | None = None
        self._at_work = Lock()
        self._given_up = False

    def write(self, frames: list[SampleFrame], is_over: bool) -> None:
        """Write frames, and put the file in place at its end; nothing is left of a failure.

        Raises TraceError, OSError.
        """
        try:
            with self._at_work:
                self._write(frames, is_over)
        except (TraceError, OSError):
            self._given_up = True
            raise
        finally:
            self._remove()

    def give_up(self) -> None:
        """Leave nothing of what is not in place yet; where a thread is at work, at its end."""
        self._given_up = True
        self._remove()

    def _write(self, frames: list[SampleFrame], is_over: bool) -> None:
        if self._writer is None and frames:
            self._writer = TraceWriter(self._path, tuple(frames[0].channels))
        for frame in frames:
            assert self._writer is not None
            self._writer.write(frame)
        if is_over and self._writer is not None:
            self._writer.commit()

    def _remove(self) -> None:
        if self._given_up and self._at_work.acquire(blocking=False):
            try:
                if self._writer is not None:
                    self._writer.abort()
            finally:
                self._at_work.release()
