"""Replay: every row in order, kept to time without drift, nothing left open."""

import asyncio
import gc
import tomllib
from collections.abc import Awaitable, Callable
from contextlib import aclosing
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from drivers.base import DriverContext, DriverMisconfiguredError, DriverUnavailableError
from drivers.replay import LONGEST_STEP_S, ReplayConfig, ReplayDriver
from edge_service.messages.samples import Floats, SampleFrame
from edge_service.models.machine import Machine
from edge_service.nodes.stages import make_downsampler

ROOT = Path(__file__).parents[3]
EMPS = ROOT.parent / "shared" / "data" / "emps" / "emps_estimation.csv"
PLAIN = {"axis": {"lead_m": 0.02}, "model": {"inertia_kg_m2": 1.5e-3}}


class FakeTime:
    """A clock that moves only when somebody sleeps; work takes `work_s` per frame."""

    def __init__(self, work_s: float = 0.0) -> None:
        self.now_s = 100.0
        self.slept_s: list[float] = []
        self.work_s = work_s

    def clock(self) -> float:
        return self.now_s

    async def sleep(self, wait_s: float) -> None:
        self.slept_s.append(wait_s)
        self.now_s += wait_s + self.work_s
        await asyncio.sleep(0)


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    def _write(times_s: list[float] | Floats, name: str = "trace.csv") -> Path:
        path = tmp_path / name
        rows = "".join(f"{time_s!r},{row}\n" for row, time_s in enumerate(map(float, times_s)))
        path.write_text("time_s,torque_command_nm\n" + rows)
        return path

    return _write


def _driver(
    path: Path, time: FakeTime | None = None, frame_s: float = 0.1, **settings: object
) -> ReplayDriver:
    config = ReplayConfig.model_validate({"path": path, **settings})
    context = DriverContext("X", Machine.model_validate(PLAIN))
    driver = ReplayDriver(config, context)
    if time is not None:
        driver = ReplayDriver(config, context, clock=time.clock, sleep=time.sleep)
    driver.frame_s = frame_s
    return driver


async def _play(driver: ReplayDriver, count: int | None = None) -> list[SampleFrame]:
    frames: list[SampleFrame] = []
    await driver.open()
    try:
        async with aclosing(driver.frames()) as source:
            async for frame in source:
                frames.append(frame)
                if len(frames) == count:
                    break
    finally:
        await driver.close()
    return frames


def _times(frames: list[SampleFrame]) -> Floats:
    return np.concatenate([frame.time_s for frame in frames])


async def test_flat_out_yields_every_row_in_order(write: Callable[..., Path]) -> None:
    times_s = np.arange(20_000) / 1000.0
    driver = _driver(write(times_s), speed=0, frame_s=0.02)
    assert not driver.paced
    frames = await _play(driver)
    np.testing.assert_array_equal(_times(frames), times_s)
    torque = np.concatenate([frame.channels["torque_command_nm"] for frame in frames])
    np.testing.assert_array_equal(torque, np.arange(20_000))
    assert [len(frame) for frame in frames] == [5, *[20] * 999, 15]
    assert driver.counters == {"rows": 20_000, "bad_cells": 0, "ragged_rows": 0, "restarts": 0}


@pytest.mark.parametrize("rate_hz", [250.0, 500.0, 1000.0, 4000.0])
async def test_an_interval_is_complete_with_a_frame_of_its_length(
    write: Callable[..., Path], rate_hz: float
) -> None:
    """The downsampler looks ahead a little; the frame holds what it looks at."""
    rows = round(2.0 * rate_hz)
    frames = await _play(_driver(write(7.03 + np.arange(rows) / rate_hz), speed=0))
    downsampler = make_downsampler(Machine.model_validate(PLAIN))
    complete = [[block.time_s for block in downsampler.push(frame)] for frame in frames]
    assert len(frames) == 21
    for frame, ends_s in zip(frames[2:-1], complete[2:-1], strict=True):
        assert len(ends_s) == 1
        assert frame.time_s[-1] - ends_s[0] < 0.01


async def test_faults_of_the_recording_are_handed_on_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "trace.csv"
    path.write_text("time_s,torque_command_nm\n0,1\n1,\n1,3\n7200,4\n0.5,5\n0.6\n0.7,7\n")
    driver = _driver(path, speed=0)
    frames = await _play(driver)
    np.testing.assert_array_equal(_times(frames), [0.0, 1.0, 1.0, 7200.0, 0.5, 0.7])
    assert driver.counters == {"rows": 6, "bad_cells": 1, "ragged_rows": 1, "restarts": 0}


@pytest.mark.parametrize("speed", [1.0, 4.0, 0.5])
async def test_a_frame_comes_when_its_last_sample_is_due_without_drift(
    write: Callable[..., Path], speed: float
) -> None:
    time = FakeTime(work_s=0.003 / speed)
    driver = _driver(write(np.arange(5000) / 1000.0 + 7.0), time, speed=speed, frame_s=0.02)
    assert driver.paced
    await driver.open()
    late_s = []
    async for frame in driver.frames():
        due_s = 100.0 + (frame.time_s[-1] - 7.0) / speed
        late_s.append(time.now_s - time.work_s - due_s)
    await driver.close()
    assert len(late_s) == 251
    np.testing.assert_allclose(late_s, 0.0, atol=1e-9)


async def test_jumps_of_the_clock_do_not_stall_the_replay(write: Callable[..., Path]) -> None:
    first = np.arange(100) * 0.01
    times_s = [*first, *(3600.0 + first), *first, 1e300, *first]
    time = FakeTime()
    frames = await _play(_driver(write(times_s), time))
    np.testing.assert_array_equal(_times(frames), times_s)
    assert max(time.slept_s) <= LONGEST_STEP_S
    assert sum(time.slept_s) == pytest.approx(4 * 0.99 + 2 * LONGEST_STEP_S, abs=0.1)


async def test_after_a_long_delay_the_missed_time_is_let_go(write: Callable[..., Path]) -> None:
    time = FakeTime()
    driver = _driver(write(np.arange(3000) / 1000.0), time, frame_s=0.02)
    await driver.open()
    waits = []
    async for _ in driver.frames():
        if len(time.slept_s) == 10:
            time.now_s += 60.0
        waits.append(time.slept_s[-1])
    await driver.close()
    assert waits.count(0.0) == 1
    np.testing.assert_allclose(waits[11:-1], 0.02, atol=0.0011)


async def test_a_loop_goes_on_in_time_after_a_gap_of_one_second(
    write: Callable[..., Path],
) -> None:
    times_s = 5.0 + np.arange(100) / 100.0
    driver = _driver(write(times_s), speed=0, loop=True, frame_s=0.1)
    played_s = _times(await _play(driver, 35))
    expected_s = np.concatenate([times_s + turn * (0.99 + 1.0) for turn in range(4)])
    np.testing.assert_allclose(played_s, expected_s[: len(played_s)])
    assert len(played_s) > 300
    assert driver.counters["restarts"] == 3


async def test_a_clock_that_stands_still_does_not_fill_one_frame(
    write: Callable[..., Path],
) -> None:
    frames = await _play(_driver(write([0.0] * 10_000), speed=0))
    assert len(_times(frames)) == 10_000
    assert max(map(len, frames)) <= 4096


async def test_probe_says_channels_and_rate(write: Callable[..., Path]) -> None:
    driver = _driver(write(np.arange(1000) / 250.0))
    probe = await driver.probe()
    assert probe.channels == ("torque_command_nm",)
    assert probe.rate_hz == pytest.approx(250.0)
    single = await _driver(write([0.0], "single.csv")).probe()
    assert single.rate_hz is None


@pytest.mark.parametrize("method", ["open", "probe"])
async def test_what_cannot_be_played_is_misconfigured(tmp_path: Path, method: str) -> None:
    missing = _driver(tmp_path / "missing.csv")
    with pytest.raises(DriverMisconfiguredError, match="no such file") as caught:
        await getattr(missing, method)()
    assert caught.value.key == "path"
    (tmp_path / "page.csv").write_text("<html></html>")
    with pytest.raises(DriverMisconfiguredError, match="HTML"):
        await getattr(_driver(tmp_path / "page.csv"), method)()


async def test_a_trace_that_turns_out_bad_is_misconfigured(tmp_path: Path) -> None:
    (tmp_path / "empty.csv").write_text("time_s,torque_command_nm\n")
    driver = _driver(tmp_path / "empty.csv", speed=0, loop=True)
    with pytest.raises(DriverMisconfiguredError, match="no rows"):
        await _play(driver)
    with pytest.raises(DriverMisconfiguredError, match="no rows"):
        await driver.probe()


async def test_open_and_close_in_any_order(write: Callable[..., Path]) -> None:
    driver = _driver(write(np.arange(100) / 100.0), speed=0)
    await driver.close()
    with pytest.raises(DriverUnavailableError, match="not open"):
        await anext(driver.frames())
    await driver.open()
    await driver.open()
    await driver.close()
    await driver.close()
    assert len(_times(await _play(driver))) == 100
    assert len(_times(await _play(driver))) == 100
    gc.collect()  # a file left open is a ResourceWarning, and warnings are errors


async def test_close_ends_a_replay_that_is_under_way(write: Callable[..., Path]) -> None:
    driver = _driver(write(np.arange(100_000) / 1000.0), speed=0)
    await driver.open()
    seen = 0
    async for _ in driver.frames():
        seen += 1
        if seen == 3:
            await driver.close()
    assert seen == 3
    assert len(_times(await _play(driver))) == 100_000


async def test_cancelling_while_reading_leaves_nothing_open(write: Callable[..., Path]) -> None:
    path = write(np.arange(50_000) / 1000.0)
    for turns in range(12):
        driver = _driver(path, speed=0)
        task = asyncio.create_task(_play(driver))
        for _ in range(turns):
            await asyncio.sleep(0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        await driver.close()
    gc.collect()


async def test_the_event_loop_gets_its_turn_between_frames(write: Callable[..., Path]) -> None:
    driver = _driver(write(np.arange(5000) / 1000.0), speed=0)
    turns = 0

    async def _count() -> None:
        nonlocal turns
        while True:
            turns += 1
            await asyncio.sleep(0)

    counting = asyncio.create_task(_count())
    frames = await _play(driver)
    counting.cancel()
    assert turns >= len(frames)


@pytest.mark.parametrize("wrong", [{"speed": -1}, {"frame_s": 0.1}, {"speed": "nan"}])
def test_settings_are_checked(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        ReplayConfig.model_validate({"path": "trace.csv", **wrong})


@pytest.mark.skipif(not EMPS.exists(), reason="the EMPS recordings are not here")
async def test_emps_is_played_in_real_time_through_its_machine_file() -> None:
    time = FakeTime()
    machine = Machine.model_validate(tomllib.loads((ROOT / "deploy" / "emps.toml").read_text()))
    sleep: Callable[[float], Awaitable[None]] = time.sleep
    driver = ReplayDriver(
        ReplayConfig(path=EMPS), DriverContext("EMPS", machine), clock=time.clock, sleep=sleep
    )
    frames = await _play(driver)
    assert len(_times(frames)) == 24_841
    assert sum(time.slept_s) == pytest.approx(24.84, abs=1e-3)
    assert set(frames[0].channels) == {
        "torque_command_nm",
        "motor_angle_rad",
        "position_setpoint_m",
    }
