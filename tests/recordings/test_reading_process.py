"""A trace read in a process of its own: the same frames; whatever the process does, one line."""

import sys
from pathlib import Path

import numpy as np
import pytest

from edge_service.limited_process import ProcessLimits
from edge_service.messages.channels import TIME, TORQUE
from edge_service.recordings import reading_process
from edge_service.recordings.columns import ColumnMap, TraceError
from edge_service.recordings.reader import read_trace
from edge_service.recordings.reading_process import ReadingProcess

ROWS = 20_000


def _trace(folder: Path) -> Path:
    path = folder / "a.csv"
    lines = [f"{row / 1000},{row % 7},{'' if row % 100 == 5 else row}\n" for row in range(ROWS)]
    path.write_text("t,torque_command_nm,motor_angle_rad\n" + "".join(lines))
    return path


COLUMNS = {TIME: ColumnMap("t"), TORQUE: ColumnMap(TORQUE, 2.0, 1.0)}


def test_the_frames_are_those_of_the_reader(tmp_path: Path) -> None:
    path = _trace(tmp_path)
    here = read_trace(path, COLUMNS)
    with ReadingProcess(path, COLUMNS) as there:
        frames = list(there)
    for name in there.channels:
        joined = np.concatenate([frame.channels[name] for frame in frames])
        np.testing.assert_array_equal(joined, here.channels[name])
    np.testing.assert_array_equal(np.concatenate([frame.time_s for frame in frames]), here.time_s)
    assert (there.rows_read, sum(there.bad_cells.values())) == (ROWS, ROWS // 100)


@pytest.mark.parametrize("skip", [1, 5000, ROWS - 1, ROWS, ROWS + 1])
def test_rows_that_were_read_before_are_left_out(tmp_path: Path, skip: int) -> None:
    with ReadingProcess(_trace(tmp_path), COLUMNS, skip_rows=skip) as there:
        times_s = [time_s for frame in there for time_s in frame.time_s]
    assert times_s == [row / 1000 for row in range(skip, ROWS)]


def test_what_is_no_trace_is_told_as_by_the_reader(tmp_path: Path) -> None:
    for path in (tmp_path / "none.csv", tmp_path):
        with pytest.raises(TraceError) as here:
            read_trace(path)
        with pytest.raises(TraceError) as there:
            ReadingProcess(path)
        assert str(there.value) == str(here.value)


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("", "it ended without a message"),
        ("import os; os.abort()", "ended by SIGABRT"),
        ("import os; os.kill(os.getpid(), 9)", "as by a lack of memory"),
        ("while True: pass", "more than 1 s of processor time"),
        ("import time; time.sleep(60)", "nothing could be read for 0.2 s"),
        ("print('no json')", "sends no frames"),
        ("print('[]')", "sends no frames"),
        ("print('{}')", "sends no frames"),
        ("print('x' * 10**6)", "sends no frames"),
        ('print(\'{"channels": ["rm -rf"]}\')', "sends no frames"),
        ('print(\'{"channels": []}\\n{"rows": 1000000000000}\')', "sends no frames"),
        ('print(\'{"channels": []}\\n{"rows": -1}\')', "sends no frames"),
        ('print(\'{"channels": []}\\n{"rows": "1"}\')', "sends no frames"),
        ('print(\'{"channels": []}\\n{"rows": 9}\\n\')', "it ended without a message"),
        ('print(\'{"error": "a.csv: no trace"}\')', "a.csv: no trace"),
    ],
)
def test_whatever_the_process_does_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, said: str
) -> None:
    monkeypatch.setattr(reading_process, "limited_command", lambda _line, *_, **__: _limited(code))
    limits = ProcessLimits(memory_mb=500.0, cpu_s=1.0)
    patience_s = 0.2 if "sleep" in code else 20.0
    with pytest.raises(TraceError, match=said) as told:
        _read_all(tmp_path / "a.csv", limits, patience_s)
    assert "\n" not in str(told.value)


def _read_all(path: Path, limits: ProcessLimits, patience_s: float) -> None:
    with ReadingProcess(path, limits=limits, patience_s=patience_s) as there:
        list(there)


def _limited(code: str) -> list[str]:
    limits = ["0", "500000000", "1", "10"]
    return [
        sys.executable,
        "-m",
        "edge_service.limited_process",
        *limits,
        sys.executable,
        "-c",
        code,
    ]


def test_one_that_was_closed_is_at_its_end(tmp_path: Path) -> None:
    there = ReadingProcess(_trace(tmp_path), COLUMNS)
    there.close()
    there.release()
    there.release()
    with pytest.raises((StopIteration, ValueError)):
        for _ in range(100):
            next(there)
