"""Recording of an axis that a person asks for."""

import asyncio
import threading
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from edge_service.http_api.jobs import RefusedError
from edge_service.messages.samples import SampleFrame
from edge_service.nodes.jobs import live_recorder
from edge_service.nodes.jobs.live_recorder import LiveRecorder
from edge_service.nodes.supervision.heartbeat import Heartbeat
from edge_service.recordings.reader import read_trace
from edge_service.recordings.writer import TraceWriter
from edge_service.threads import Threads

RATE_HZ, ROWS = 100.0, 50


def frame(number: int) -> SampleFrame:
    time_s = 7.0 + (number * ROWS + np.arange(ROWS)) / RATE_HZ
    return SampleFrame(time_s, {"torque_command_nm": time_s * 2.0})


async def made(recorder: LiveRecorder) -> None:
    """Wait until nothing is being recorded."""
    work = asyncio.ensure_future(recorder.run(Heartbeat("live", 60.0, lambda: 0.0)))
    async with asyncio.timeout(30.0):
        while recorder.live() is not None:
            await asyncio.sleep(0)
    work.cancel()
    await asyncio.gather(work, return_exceptions=True)


@pytest.mark.parametrize(("seconds", "stop_after", "rows"), [(1.2, None, 120), (60.0, 3, 150)])
async def test_what_comes_is_kept_to_the_length_asked_for_or_to_the_stop(
    tmp_path: Path, seconds: float, stop_after: int | None, rows: int
) -> None:
    recorder = LiveRecorder(tmp_path)
    recorder.start("X", "a.parquet", seconds)
    with pytest.raises(RefusedError, match="axis X is already being recorded"):
        recorder.start("Y", "b.parquet", 1.0)
    for number in range(stop_after or 5):
        recorder.follow("X", frame(number))
        recorder.follow("Y", frame(number))
    if stop_after:
        recorder.stop("X")
    await made(recorder)
    assert [path.name for path in tmp_path.iterdir()] == ["a.parquet"]
    kept = read_trace(tmp_path / "a.parquet")
    assert len(kept.time_s) == rows
    assert kept.channels["torque_command_nm"] == pytest.approx(kept.time_s * 2.0)


@pytest.mark.parametrize("heard", [False, True])
async def test_it_ends_by_itself_though_the_samples_stop(tmp_path: Path, heard: bool) -> None:
    recorder = LiveRecorder(tmp_path, latest_s=-0.9)
    recorder.start("X", "a.parquet", 1.0)
    if heard:
        recorder.follow("X", frame(0))
    await made(recorder)
    assert [path.name for path in tmp_path.iterdir()] == ["a.parquet"] * heard
    recorder.start("Y", "b.parquet", 1.0)


async def test_nothing_is_stopped_that_was_not_begun(tmp_path: Path) -> None:
    with pytest.raises(RefusedError, match="not being recorded"):
        LiveRecorder(tmp_path).stop("X")


async def test_one_that_is_given_up_while_it_begins_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As when the service ends: the file is opened in a thread that nobody waits for."""
    begins, goes_on, ended = threading.Event(), threading.Event(), threading.Event()

    class Slow(TraceWriter):
        def __init__(self, path: Path, channels: Sequence[str]) -> None:
            begins.set()
            goes_on.wait(20.0)
            super().__init__(path, channels)

        def abort(self) -> None:
            super().abort()
            ended.set()

    monkeypatch.setattr(live_recorder, "TraceWriter", Slow)
    recorder = LiveRecorder(tmp_path)
    recorder.start("X", "a.parquet", 60.0)
    recorder.follow("X", frame(0))
    work = asyncio.ensure_future(recorder.run(Heartbeat("live", 60.0, lambda: 0.0)))
    async with asyncio.timeout(20.0):
        while not begins.is_set():
            await asyncio.sleep(0)
    work.cancel()
    await asyncio.gather(work, return_exceptions=True)
    goes_on.set()
    assert await Threads("waiting").run(ended.wait, 20.0)
    assert list(tmp_path.iterdir()) == []
