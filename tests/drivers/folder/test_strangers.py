"""What strangers leave in the folder: told once each, and no harm to the traces of others."""

import asyncio
import errno
import os
from contextlib import aclosing
from functools import partial
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet
import pytest

from drivers.base import DriverUnavailableError
from drivers.folder import driver as driver_module
from drivers.folder import ledger as ledger_module
from drivers.folder.ledger import Ledger
from edge_service.limited_process import ProcessLimits
from edge_service.recordings.reading_process import ReadingProcess

from .test_folder import Watch, torques


@pytest.fixture
def watch(tmp_path: Path) -> Watch:
    return Watch(tmp_path)


def _bomb(path: Path) -> None:
    """A few kB that hold 160 MB."""
    huge = ["x" * 40_000_000] * 4
    numbers = [0.0, 1.0, 2.0, 3.0]
    table = {"time_s": numbers, "torque_command_nm": huge, "motor_angle_rad": numbers}
    pa.parquet.write_table(pa.table(table), path, compression="zstd")


async def test_a_small_file_that_holds_gigabytes_is_told_and_does_not_stop_the_others(
    watch: Watch, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    less = partial(ReadingProcess, limits=ProcessLimits(memory_mb=420.0, cpu_s=60.0))
    monkeypatch.setattr(driver_module, "ReadingProcess", less)
    _bomb(watch.folder / "a.parquet")
    watch.write("b.csv", 1.0)
    driver = watch.driver()
    assert set(torques(await watch.read(driver))) == {1.0}
    assert (driver.counters["files"], driver.counters["bad_files"]) == (1, 1)
    assert caplog.text.count("its content needs too much memory") == 1
    assert torques(await watch.read(watch.driver())) == []


async def test_links_pipes_and_folders_are_no_traces(watch: Watch) -> None:
    os.mkfifo(watch.folder / "pipe.csv")
    (watch.folder / "folder.csv").mkdir()
    (watch.folder / "loop.csv").symlink_to("loop.csv")
    (watch.folder / "zero.csv").symlink_to("/dev/zero")
    watch.write("a.csv", 1.0)
    driver = watch.driver()
    assert set(torques(await watch.read(driver))) == {1.0}
    assert driver.counters["bad_files"] == 0


@pytest.mark.parametrize("number", [errno.EMFILE, errno.EAGAIN, errno.ENOMEM])
async def test_a_trace_waits_where_no_process_can_read_it(
    watch: Watch, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    watch.write("a.csv", 1.0)
    driver = watch.driver()
    await driver.open()
    with monkeypatch.context() as refusing:
        refusing.setattr(driver_module, "ReadingProcess", refuse)
        async with aclosing(driver.frames()) as frames:
            with pytest.raises(DriverUnavailableError, match="no process to read it"):
                await anext(frames)
    assert set(torques(await watch.read(driver))) == {1.0}


async def test_a_full_disk_stops_no_reading_and_nothing_is_read_twice(
    watch: Watch, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    watch.write("a.csv", 1.0)
    driver = watch.driver()
    with monkeypatch.context() as refusing:
        refusing.setattr(ledger_module, "write_checked", refuse)
        assert set(torques(await watch.read(driver))) == {1.0}
        assert driver.counters["unsaved_ledger"] > 0
        assert torques(await watch.read(driver)) == []
    watch.write("b.csv", 2.0)
    assert set(torques(await watch.read(driver))) == {2.0}
    assert driver.counters["unsaved_ledger"] == 0
    assert torques(await watch.read(watch.driver())) == []


async def test_a_disk_that_has_room_again_is_written_without_a_new_trace(
    watch: Watch, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    watch.write("a.csv", 1.0)
    driver = watch.driver()
    with monkeypatch.context() as refusing:
        refusing.setattr(ledger_module, "write_checked", refuse)
        await watch.read(driver)
    await watch.read(driver)
    (entry,) = Ledger(driver._ledger_path)._entries.values()
    assert entry.done


async def test_closing_ends_a_read_that_hangs_and_blames_no_file(watch: Watch) -> None:
    watch.write("a.csv", 1.0, rows=100_000)
    driver = watch.driver()
    await driver.open()
    async with aclosing(driver.frames()) as frames:
        await anext(frames)
        os.kill(driver._reader._process.pid, 19)  # SIGSTOP
        hanging = asyncio.create_task(_exhaust(frames))
        while not driver._lock.locked():
            await asyncio.sleep(0.001)
        await asyncio.wait_for(driver.close(), 10.0)
        await asyncio.wait_for(hanging, 10.0)
    assert driver.counters["bad_files"] == 0
    (entry,) = Ledger(driver._ledger_path)._entries.values()
    assert (entry.done, entry.problem) == (False, "")


async def _exhaust(frames) -> None:
    async for _ in frames:
        pass
