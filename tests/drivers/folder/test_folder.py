"""Every trace once: when it is complete, in order, across restarts, whatever it is called."""

import asyncio
import os
from contextlib import aclosing
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from drivers.base import DriverUnavailableError
from drivers.folder.driver import BETWEEN_S, Arrivals, FolderConfig, FolderDriver, has_proper_end
from edge_service.messages.samples import TABLE_POSITION, TORQUE, SampleFrame

from ..bench import CONTEXT

XML_HEAD = (
    '<?xml version="1.0" encoding="UTF-8"?><traceSession><traceData>'
    '<dataFrame><frameHeader startTime="2020-01-01T00:00:00"/>'
    '<dataSignal id="s1" name="/Nck/!SEMA/measPos2 [u1, 1]" interval="0.001" unitsType="posn"/>'
)


class Watch:
    """A folder, and drivers that watch it; a look costs no time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "traces"
        self.folder.mkdir()
        self.looks = 0

    def driver(self, **settings: object) -> FolderDriver:
        async def sleep(wait_s: float) -> None:
            self.looks += wait_s > 0.0
            await asyncio.sleep(0.0)

        config = FolderConfig.model_validate({"folder": self.folder, **settings})
        return FolderDriver(config, CONTEXT, sleep=sleep, settle_s=0.0)

    def write(self, name: str, torque: float, rows: int = 500) -> Path:
        path = self.folder / name
        lines = "".join(f"{row / 1000},{torque}\n" for row in range(rows))
        path.write_text("time_s,torque_command_nm\n" + lines)
        return path

    async def read(self, driver: FolderDriver, patience: int = 3) -> list[SampleFrame]:
        """All there is until the driver has looked `patience` times in vain."""
        frames: list[SampleFrame] = []
        await driver.open()
        async with asyncio.timeout(60.0), aclosing(driver.frames()) as source:
            while True:
                waiting = asyncio.ensure_future(anext(source))
                start = self.looks
                while not waiting.done() and self.looks - start < patience:
                    await asyncio.sleep(0.001)
                if not waiting.done():
                    waiting.cancel()
                    await asyncio.gather(waiting, return_exceptions=True)
                    break
                frames.append(waiting.result())
        await driver.close()
        return frames


@pytest.fixture
def watch(tmp_path: Path) -> Watch:
    return Watch(tmp_path)


def torques(frames: list[SampleFrame]) -> list[float]:
    return [] if not frames else np.concatenate([f.channels[TORQUE] for f in frames]).tolist()


async def test_traces_are_read_once_in_the_order_of_their_dates(watch: Watch) -> None:
    second, first = watch.write("a.csv", 2.0), watch.write("b.csv", 1.0)
    os.utime(first, (1000, 1000))
    os.utime(second, (2000, 2000))
    driver = watch.driver()
    frames = await watch.read(driver)
    assert torques(frames) == [1.0] * 500 + [2.0] * 500
    time_s = np.concatenate([frame.time_s for frame in frames])
    np.testing.assert_allclose(time_s[:500], np.arange(500) / 1000.0)
    assert time_s[500] - time_s[499] == pytest.approx(BETWEEN_S)
    assert driver.counters["files"] == 2
    (watch.folder / "c.csv").symlink_to(watch.write(".c.csv", 3.0))  # by who may write here alone
    assert await watch.read(driver) == []


async def test_a_restart_reads_nothing_again_and_goes_on_where_it_was(watch: Watch) -> None:
    watch.write("a.csv", 1.0, rows=1000)
    driver = watch.driver()
    await driver.open()
    frames = driver.frames()
    before = [await anext(frames) for _ in range(4)]
    await frames.aclose()
    await driver.close()
    after = await watch.read(watch.driver())
    assert len(torques(before)) + len(torques(after)) == 1000
    assert len(torques(before)) == 313
    assert await watch.read(watch.driver()) == []


@pytest.mark.parametrize("opened_again", [False, True])
async def test_nothing_more_comes_once_it_is_closed(opened_again: bool, watch: Watch) -> None:
    for number, name in enumerate(("a.csv", "b.csv")):
        os.utime(watch.write(name, float(number)), (1000 + number, 1000 + number))
    driver = watch.driver()
    await driver.open()
    frames = driver.frames()
    first = await anext(frames)
    await driver.close()
    if opened_again:
        await driver.open()
    async with asyncio.timeout(60.0):
        assert [len(frame) async for frame in frames] == []
    rest = torques(await watch.read(driver))
    assert rest == [0.0] * (500 - len(first)) + [1.0] * 500


async def test_another_name_or_date_is_no_new_trace(watch: Watch) -> None:
    path = watch.write("a.csv", 1.0)
    driver = watch.driver()
    await watch.read(driver)
    path.rename(watch.folder / "b.csv")
    (watch.folder / "copy.csv").write_bytes((watch.folder / "b.csv").read_bytes())
    os.utime(watch.folder / "b.csv", (5e9, 5e9))
    assert await watch.read(watch.driver()) == []
    watch.write("b.csv", 3.0)
    assert torques(await watch.read(watch.driver())) == [3.0] * 500


async def test_a_trace_that_grows_is_left_alone_until_it_rests(watch: Watch) -> None:
    arrivals = Arrivals(watch.folder, "*", settle_s=2.0)
    path = watch.write("a.csv", 1.0, rows=10)
    assert (arrivals.complete(0.0), arrivals.complete(1.9)) == ([], [])
    with path.open("a") as file:
        file.write("0.010,1.0\n")
    assert (arrivals.complete(3.0), arrivals.complete(5.0)) == ([], [path])
    assert arrivals.complete(9.0) == []


@pytest.mark.parametrize(
    ("content", "whole"),
    [
        (b"time_s,torque_command_nm\n0,1\n", True),
        (b"time_s,torque_command_nm\n0,1\n0.1,", False),
        (b"", False),
        (XML_HEAD.encode(), False),
        (XML_HEAD.encode() + b"</dataFrame></traceData></traceSession>\n", True),
        (b"\xef\xbb\xbf<?xml?><traceSession></traceSession>", True),
        (b"PAR1" + bytes(100), False),
        (b"PAR1" + bytes(100) + b"PAR1", True),
    ],
)
def test_a_file_without_its_proper_end_is_not_complete(
    content: bytes, whole: bool, tmp_path: Path
) -> None:
    (tmp_path / "trace").write_bytes(content)
    assert has_proper_end(tmp_path / "trace") == whole


async def test_a_file_that_is_no_trace_is_told_and_does_not_stop_the_others(
    watch: Watch, caplog: pytest.LogCaptureFixture
) -> None:
    bad = watch.folder / "notes.csv"
    bad.write_text("<html></html>\n</traceSession>")
    other = watch.folder / "words.csv"
    other.write_text("time_s,torque_command_nm\n0,word\n")
    since_1970 = watch.folder / "milliseconds.csv"
    since_1970.write_text("time_s,torque_command_nm\n1.79e12,1\n")
    for path in (bad, other, since_1970):
        os.utime(path, (1000, 1000))
    watch.write("z.csv", 1.0)
    driver = watch.driver()
    assert len(torques(await watch.read(driver))) == 500
    assert driver.counters["bad_files"] == 3
    assert "notes.csv" in caplog.text
    assert "milliseconds.csv: no clock shows 1.79e+12 s" in caplog.text
    assert await watch.read(watch.driver()) == []
    assert watch.driver().counters["bad_files"] == 0


async def test_a_folder_that_is_not_there_is_unavailable(tmp_path: Path) -> None:
    driver = FolderDriver(FolderConfig(folder=tmp_path / "no"), CONTEXT)
    with pytest.raises(DriverUnavailableError, match="No such file"):
        await driver.open()
    with pytest.raises(DriverUnavailableError, match="No such file"):
        await driver.probe()


async def test_the_ledger_lies_in_the_state_folder_where_there_is_one(
    watch: Watch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    watch.write("a.csv", 1.0)
    assert len(torques(await watch.read(watch.driver()))) == 500
    assert await watch.read(watch.driver()) == []
    assert (tmp_path / "state" / "folder-X.jsonl").is_file()
    assert [path.name for path in watch.folder.iterdir()] == ["a.csv"]


async def test_a_sinumerik_trace_is_read_for_its_axis(watch: Watch) -> None:
    records = "".join(f'<rec time="{k / 1000}" s1="{100.0 + k}"/>' for k in range(200))
    (watch.folder / "trace.xml").write_text(
        XML_HEAD + records + "</dataFrame></traceData></traceSession>"
    )
    frames = await watch.read(watch.driver(pattern="*.xml"))
    position = np.concatenate([frame.channels[TABLE_POSITION] for frame in frames])
    np.testing.assert_allclose(position, 0.1 + 0.001 * np.arange(200))


@pytest.mark.parametrize("restart", [False, True])
async def test_a_trace_that_grows_after_it_was_read_is_read_on(restart: bool, watch: Watch) -> None:
    path = watch.write("a.csv", 1.0, rows=300)
    whole = watch.write("whole", 1.0, rows=800).read_bytes()
    (watch.folder / "whole").unlink()
    driver = watch.driver()
    assert len(torques(await watch.read(driver))) == 300
    assert whole.startswith(path.read_bytes())
    path.write_bytes(whole)
    frames = await watch.read(watch.driver() if restart else driver)
    assert len(torques(frames)) == 500
    assert np.concatenate([f.time_s for f in frames])[-1] - frames[0].time_s[0] == pytest.approx(
        0.499
    )
    watch.write("a.csv", 2.0, rows=900)
    assert torques(await watch.read(driver)) == [2.0] * 900, "another trace of the same name"


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


async def test_no_link_or_pipe_is_a_trace(watch: Watch, caplog: pytest.LogCaptureFixture) -> None:
    os.mkfifo(watch.folder / "pipe.csv")
    (watch.folder / "folder.csv").mkdir()
    (watch.folder / "loop.csv").symlink_to("loop.csv")
    (watch.folder / "zero.csv").symlink_to("/dev/zero")
    watch.write("a.csv", 1.0)
    driver = watch.driver()
    assert set(torques([*await watch.read(driver), *await watch.read(driver)])) == {1.0}
    assert driver.counters["bad_files"] == 0
    assert [caplog.text.count(f"{each}.csv: passed over") for each in ("loop", "zero")] == [1, 1]
