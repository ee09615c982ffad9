"""Foreign files in the folder: each told once, and no harm to the traces beside them."""

import os
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet
import pytest

from .test_folder import Watch, torques


@pytest.fixture
def watch(tmp_path: Path) -> Watch:
    return Watch(tmp_path)


async def test_a_small_file_that_holds_gigabytes_is_told_and_does_not_stop_the_others(
    watch: Watch, caplog: pytest.LogCaptureFixture
) -> None:
    huge = ["x" * 40_000_000] * 4  # of a few kB in the file
    numbers = [0.0, 1.0, 2.0, 3.0]
    table = {"time_s": numbers, "torque_command_nm": huge, "motor_angle_rad": numbers}
    pa.parquet.write_table(pa.table(table), watch.folder / "a.parquet", compression="zstd")
    watch.write("b.csv", 1.0)
    driver = watch.driver()
    assert set(torques(await watch.read(driver))) == {1.0}
    assert (driver.counters["files"], driver.counters["bad_files"]) == (1, 1)
    assert caplog.text.count("are not unpacked") == 1
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
