"""Writing: exact, whole or not at all."""

import errno
import os
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from edge_service.messages.samples import ANGLE, CHANNELS, TEMPERATURE, TORQUE, Floats, SampleFrame
from edge_service.recordings.columns import TraceError
from edge_service.recordings.reader import read_trace
from edge_service.recordings.writer import TraceWriter

SUFFIXES = (".csv", ".parquet")
NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
CELLS = st.one_of(st.floats(), NUMBERS)


def _frame(count: int, start: int = 0) -> SampleFrame:
    time_s = np.arange(start, start + count) * np.float64(1e-3)
    return SampleFrame(time_s, {TORQUE: np.sin(time_s), ANGLE: time_s + 1.0})


def _bits(values: Floats) -> list[int]:
    return [int(bits) for bits in np.where(np.isfinite(values), values, np.nan).view(np.uint64)]


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_round_trip_is_exact_to_the_last_bit(suffix: str, data: st.DataObject) -> None:
    names = data.draw(st.lists(st.sampled_from(list(CHANNELS)), unique=True))
    names = [TORQUE, *(name for name in CHANNELS if name in names and name != TORQUE)]
    count = data.draw(st.integers(1, 20))
    time_s = data.draw(arrays(np.float64, count, elements=NUMBERS))
    channels = {name: data.draw(arrays(np.float64, count, elements=CELLS)) for name in names}
    cut = data.draw(st.integers(0, count))
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"trace{suffix}"
        with TraceWriter(path, names) as writer:
            for part in (slice(0, cut), slice(cut, count)):
                parts = {name: values[part] for name, values in channels.items()}
                writer.write(SampleFrame(time_s[part], parts))
        read = read_trace(path)
    assert _bits(read.time_s) == _bits(time_s)
    assert set(read.channels) == set(names)
    for name in names:
        assert _bits(read.channels[name]) == _bits(channels[name])


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_missing_values_and_channels_are_empty(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"trace{suffix}"
    with TraceWriter(path, [TORQUE, TEMPERATURE]) as writer:
        writer.write(SampleFrame(np.array([0.0, 1.0]), {TORQUE: np.array([1.5, np.nan])}))
        writer.write(SampleFrame(np.array([2.0]), {TEMPERATURE: np.array([20.25])}))
    if suffix == ".csv":
        expected = "time_s,torque_command_nm,temperature_c\n0,1.5,\n1,,\n2,,20.25\n"
        assert path.read_text() == expected
    read = read_trace(path)
    np.testing.assert_array_equal(read.channels[TORQUE], [1.5, np.nan, np.nan])
    np.testing.assert_array_equal(read.channels[TEMPERATURE], [np.nan, np.nan, 20.25])


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_nothing_stands_in_place_before_the_end(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"trace{suffix}"
    path.write_text("what was there before")
    with TraceWriter(path, [TORQUE, ANGLE]) as writer:
        writer.write(_frame(70_000))
        assert path.read_text() == "what was there before"
    assert len(read_trace(path)) == 70_000
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_an_exception_leaves_nothing_behind(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"trace{suffix}"
    with pytest.raises(ZeroDivisionError), TraceWriter(path, [TORQUE, ANGLE]) as writer:
        writer.write(_frame(70_000))
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


def test_a_new_channel_after_the_header(tmp_path: Path) -> None:
    with (
        pytest.raises(TraceError, match="'motor_angle_rad' came after the header"),
        TraceWriter(tmp_path / "trace.csv", [TORQUE]) as writer,
    ):
        writer.write(_frame(1))
    assert list(tmp_path.iterdir()) == []


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(TraceError, match=r"ends in '\.txt'"):
        TraceWriter(tmp_path / "trace.txt", [TORQUE])
    (tmp_path / "file").touch()
    with pytest.raises(TraceError, match="cannot be written"):
        TraceWriter(tmp_path / "file" / "trace.csv", [TORQUE])
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(TraceError, match="a folder"):
        TraceWriter(tmp_path / "folder.csv", [TORQUE])


def test_full_disk_is_reported_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_table: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with (
        pytest.raises(TraceError, match="No space left"),
        TraceWriter(tmp_path / "trace.csv", [TORQUE, ANGLE]) as writer,
    ):
        monkeypatch.setattr(writer, "_sink", SimpleNamespace(write_table=refuse, close=list))
        writer.write(_frame(70_000))
    assert list(tmp_path.iterdir()) == []
