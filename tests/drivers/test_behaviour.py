"""Behaviour of every driver; one enrols by being installed.

Its folder here has a `bench.py` with one function, `bench(folder)`: an asynchronous context manager
that yields a `DriverBench`.
"""

import asyncio
import gc
import importlib
import math
from collections.abc import AsyncIterator, Callable
from contextlib import aclosing
from importlib.metadata import distribution, entry_points
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pytest_asyncio
from pydantic import ValidationError

from drivers.base import (
    ENTRY_POINT_GROUP,
    Driver,
    DriverMisconfiguredError,
    DriverUnavailableError,
    driver_names,
)
from edge_service.messages.samples import CHANNELS, is_bad

from .bench import PATIENCE_S, DriverBench, take

pytestmark = pytest.mark.asyncio(loop_scope="module")
NEW_RUN_S = 2.0
OURS = {entry.name for entry in distribution("edge-service").entry_points}


@pytest_asyncio.fixture(params=driver_names(), scope="module", loop_scope="module")
async def bench(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> AsyncIterator[DriverBench]:
    if request.param not in OURS:
        pytest.skip(f"driver {request.param!r} belongs to another package")
    module = importlib.import_module(f".{request.param}.bench", __package__)
    async with module.bench(tmp_path_factory.mktemp(request.param)) as built:
        yield built


@pytest_asyncio.fixture(loop_scope="module")
async def driver(bench: DriverBench) -> AsyncIterator[Driver]:
    made = bench.make()
    yield made
    await made.close()


def open_files() -> set[str]:
    gc.collect()
    held = set()
    for name in Path("/proc/self/fd").iterdir():
        try:
            held.add(f"{name} {name.readlink()}")
        except FileNotFoundError:
            continue
    return held


async def left_of(held: Callable[[], set[Any]], before: set[Any]) -> set[Any]:
    """Files or tasks beyond `before`, once event loop and source have ended what they were to."""
    for _ in range(50):
        if not held() - before:
            break
        await asyncio.sleep(0.01)
    return held() - before


async def test_samples_are_known_channels_in_rising_time(driver: Driver) -> None:
    await driver.open()
    frames = await take(driver, 5)
    assert len(frames) == 5
    assert {tuple(frame.channels) for frame in frames} == {tuple(frames[0].channels)}
    assert set(frames[0].channels) <= set(CHANNELS)
    time_s = np.concatenate([frame.time_s for frame in frames])
    assert (np.diff(time_s) > 0.0).all()
    assert all(np.isfinite(frame.channels["torque_command_nm"]).any() for frame in frames)


async def test_open_and_close_are_safe_twice_and_in_any_order(driver: Driver) -> None:
    await driver.close()
    await driver.open()
    await driver.open()
    assert await take(driver, 2)
    await driver.close()
    await driver.close()
    await driver.open()
    assert await take(driver, 2)


async def test_frames_without_open_say_so(driver: Driver) -> None:
    with pytest.raises(DriverUnavailableError, match="not open"):
        await anext(driver.frames())


async def test_close_ends_a_read_that_is_under_way(driver: Driver) -> None:
    await driver.open()
    frames = driver.frames()
    await anext(frames)
    for pause in range(5):
        waiting = asyncio.create_task(anext(frames, None))
        for _ in range(pause):
            await asyncio.sleep(0)
        await driver.close()
        async with asyncio.timeout(PATIENCE_S):
            last = await waiting
        assert last is None or len(last)
        assert await anext(frames, None) is None
        await driver.open()
        frames = driver.frames()
        await anext(frames)


async def test_nothing_is_left_after_a_cancelled_read(bench: DriverBench) -> None:
    await asyncio.sleep(0)
    files, tasks = open_files(), asyncio.all_tasks()
    driver = bench.make()
    for turns in range(8):
        reading = asyncio.create_task(_open_and_take(driver))
        for _ in range(turns**2):
            await asyncio.sleep(0)
        reading.cancel()
        with pytest.raises(asyncio.CancelledError):
            await reading
        await driver.close()
    await asyncio.sleep(0.05)
    assert await left_of(asyncio.all_tasks, tasks) == set()
    assert await left_of(open_files, files) == set()


async def _open_and_take(driver: Driver) -> None:
    await driver.open()
    await take(driver, 10_000)


async def test_nothing_is_left_open(bench: DriverBench) -> None:
    files, tasks = open_files(), asyncio.all_tasks()
    for _ in range(3):
        driver = bench.make()
        await driver.probe()
        await driver.open()
        await take(driver, 2)
        await driver.close()
    assert await left_of(open_files, files) == set()
    assert await left_of(asyncio.all_tasks, tasks) == set()


async def test_probe_and_readings_say_what_there_is(driver: Driver) -> None:
    probe = await driver.probe()
    await driver.open()
    (frame,) = await take(driver, 1)
    assert set(probe.channels) == set(frame.channels)
    assert probe.description
    assert probe.rate_hz is None or probe.rate_hz > 0.0
    assert all(math.isfinite(value) for value in driver.readings.values())
    assert all(count >= 0 for count in driver.counters.values())


async def test_a_source_that_is_lost_is_unavailable_and_comes_back(
    bench: DriverBench, driver: Driver
) -> None:
    if bench.lose is None or bench.bring_back is None:
        pytest.skip("its source cannot be lost")
    await driver.open()
    await take(driver, 2)
    await bench.lose()
    with pytest.raises(DriverUnavailableError):
        await take(driver, 10_000)
    for ask in (driver.open, driver.open, driver.probe):
        with pytest.raises(DriverUnavailableError):
            await ask()
    await bench.bring_back()
    await driver.open()
    assert np.isfinite((await take(driver, 3))[-1].channels["torque_command_nm"]).any()


async def test_bad_values_are_nan_and_are_counted(bench: DriverBench, driver: Driver) -> None:
    if bench.spoil is None or bench.heal is None:
        pytest.skip("its values cannot be spoiled")
    await driver.open()
    await take(driver, 2)
    await driver.close()
    await bench.spoil()
    try:
        await driver.open()
        frames = await take(driver, 10)
    finally:
        await bench.heal()
    bad = [np.isnan(frame.channels["torque_command_nm"]).all() for frame in frames]
    assert all(bad[5:])  # the first ones may have been sampled before
    for frame in frames:
        for name, codes in frame.quality.items():
            assert np.isnan(frame.channels[name][is_bad(codes)]).all()
    assert sum(count for name, count in driver.counters.items() if "bad" in name) > 0


@pytest.mark.parametrize("step_s", [30.0, -7200.0, -30.0])
async def test_a_step_of_the_source_clock_is_soon_a_new_run(
    step_s: float, bench: DriverBench, driver: Driver
) -> None:
    if bench.step is None:
        pytest.skip("its source has no clock that anybody sets")
    await driver.open()
    loop = asyncio.get_running_loop()
    async with asyncio.timeout(PATIENCE_S), aclosing(driver.frames()) as frames:
        time_s = (await anext(frames)).time_s
        bench.step(step_s)
        stepped_s = loop.time()
        while (np.diff(time_s) > 0.0).all() and (np.diff(time_s) < 0.9).all():
            time_s = np.append(time_s[-1:], (await anext(frames)).time_s)
        assert loop.time() - stepped_s < NEW_RUN_S
        time_s = np.concatenate([(await anext(frames)).time_s for _ in range(3)])
    assert (np.diff(time_s) > 0.0).all()


@pytest.mark.parametrize("name", sorted(OURS & set(driver_names())))
async def test_unknown_keys_are_refused_by_name(name: str) -> None:
    (entry,) = entry_points(group=ENTRY_POINT_GROUP, name=name)
    with pytest.raises(ValidationError, match="nosuchkey"):
        entry.load().config_model.model_validate({"nosuchkey": 1})


async def test_every_driver_has_a_bench() -> None:
    for name in sorted(OURS & set(driver_names())):
        assert (Path(__file__).parent / name / "bench.py").is_file(), name


async def test_errors_name_the_key() -> None:
    assert str(DriverMisconfiguredError("path", "no such file")) == "path: no such file"
