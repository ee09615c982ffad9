"""Recordings of Industrial Edge: the count as time, several axes, tool and block, CSV and JSON."""

import json
import math
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_service.cli.entry import main
from edge_service.recordings.columns import TraceError
from edge_service.recordings.reader import open_trace
from edge_service.recordings.sinumerik.edge import RESTART_GAP_S, CycleClock
from edge_service.recordings.sinumerik.signals import ControllerAxis

from .form_files import edge_json

AXIS = ControllerAxis(number=1, lead_m=0.01)
TOOL, BLOCK = "HFBlockEvent.ActiveTool", "HFBlockEvent.GCode"


def _csv(path: Path, counts: list[float], axes: tuple[int, ...] = (1,)) -> Path:
    names = [f"{short}|{axis}" for axis in axes for short in ("ENC1_POS", "TORQUE")]
    rows = [f"{count:g}," + ",".join(["1.5", "0.5"] * len(axes)) for count in counts]
    path.write_text("\n".join([",".join(["CYCLE", *names]), *rows, ""]))
    return path


def _read(path: Path, columns: dict | None = None, *, keep_all: bool = False):
    with open_trace(path, columns, AXIS, keep_all=keep_all) as reader:
        frames = list(reader)
    return frames, reader


def test_the_count_is_the_time_from_its_first_value(tmp_path: Path) -> None:
    (frame,), reader = _read(_csv(tmp_path / "a.csv", [5000, 5001, 5002, 5003]))
    assert frame.time_s.tolist() == pytest.approx([0.0, 0.002, 0.004, 0.006])
    assert any(each.startswith("time_s = 0.002 s * CYCLE") for each in reader.remarks)


def test_gaps_and_restarts_of_the_count_are_said_and_time_goes_on(tmp_path: Path) -> None:
    counts = [100, 101, 102, 112, 113, 7, 8, 9]
    (frame,), reader = _read(_csv(tmp_path / "a.csv", counts))
    assert np.all(np.diff(frame.time_s) > 0.0)
    assert frame.time_s[3] - frame.time_s[2] == pytest.approx(0.02)
    assert frame.time_s[5] - frame.time_s[4] == pytest.approx(RESTART_GAP_S)
    said = "\n".join(reader.remarks)
    assert "CYCLE: 1 gaps, 9 samples missing" in said
    assert "CYCLE starts over 1 times (at row 5): each is a new run" in said


@settings(deadline=None)
@given(
    st.lists(st.integers(0, 1000), min_size=1, max_size=60),
    st.lists(st.integers(1, 20), min_size=1),
)
def test_the_clock_does_not_depend_on_how_the_rows_are_parted(counts, lengths) -> None:
    values = np.array(counts, dtype=np.float64)
    whole, parted = CycleClock(0.002), CycleClock(0.002)
    time_s, run = whole.times(values)
    found, start = [], 0
    while start < len(values):
        stop = start + lengths[len(found) % len(lengths)]
        found.append(parted.times(values[start:stop]))
        start = stop
    np.testing.assert_array_equal(np.concatenate([each for each, _ in found]), time_s)
    np.testing.assert_array_equal(np.concatenate([each for _, each in found]), run)
    assert np.all(np.diff(time_s) >= 0.0)
    assert parted.restarts == whole.restarts == np.count_nonzero(np.diff(values) < 0.0)


def test_several_axes_are_listed_by_number_and_name(tmp_path: Path, capsys) -> None:
    path = _csv(tmp_path / "x_hfdata.csv", [1, 2, 3], axes=(2, 5))
    beside = "SignalName,Type,Axis,Address\nA,DOUBLE,Y1,ENC1_POS|2\nB,DOUBLE,,TORQUE|5\n"
    (tmp_path / "x_header.csv").write_text(beside)
    assert main(["convert", str(path), "--out", str(tmp_path / "out.csv")]) == 2
    said = capsys.readouterr().err
    assert "axes there are: 2 (Y1), 5; expected the number of the one wanted" in said
    chosen = ["convert", str(path), "--out", str(tmp_path / "out.csv"), "--axis-number", "5"]
    assert main(chosen) == 0


COMMANDS = {
    "convert": ["--out", "out.csv"],
    "doctor": [],
    "gap": [],
    "fingerprint": ["--out", "out"],
    "diagnose": ["--out", "out"],
    "estimate": ["--out", "out.csv"],
    "commission": ["--out", "out.toml"],
    "motion isolability": [],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_no_command_takes_the_first_of_several_axes(command, tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = _csv(tmp_path / "x.csv", [1, 2, 3], axes=(1, 2))
    assert main([*command.split(), str(path), *COMMANDS[command]]) == 2
    said = capsys.readouterr().err
    assert "axes there are: 1, 2" in said
    assert len(said.splitlines()) == 1


EVENTS = (
    "HFProbeCounter,Channel,SeekOffset,SelectedTool,ActiveTool,GCode,IpoGC,ipoReadError,laBuf\n"
    '102,1,13,0,6,"G1 X1, Y2",G1,,0\n104,1,40,7,6,G1 X3,G1,,0\n'
)


def test_tool_and_block_stand_beside_each_sample(tmp_path: Path) -> None:
    path = _csv(tmp_path / "T_hfdata.csv", [100, 101, 102, 103, 104, 105])
    (tmp_path / "T_hfblockevent.csv").write_text(EVENTS)
    (frame,), reader = _read(path, keep_all=True)
    first, second = crc32(b"G1 X1, Y2"), crc32(b"G1 X3")
    expected = [math.nan, math.nan, first, first, second, second]
    np.testing.assert_array_equal(frame.channels[BLOCK], expected)
    np.testing.assert_array_equal(frame.channels[TOOL][2:], 6.0)
    assert "T_hfblockevent.csv: 2 blocks of the NC program" in reader.remarks


@pytest.mark.parametrize(
    ("content", "what"),
    [(EVENTS, "the NC blocks"), ("SignalName,Type,Axis,Address\nA,B,,C\n", "the list of signals")],
)
def test_a_file_beside_a_recording_says_which_to_open(tmp_path: Path, content, what) -> None:
    path = tmp_path / "a.csv"
    path.write_text(content)
    with pytest.raises(TraceError, match=f"holds {what} of a recording .* expected its"):
        open_trace(path)


def _rows(counts: list[int]) -> list[list[float]]:
    return [[count, float(count), 2.0, 0.5] for count in counts]


def test_json_is_read_with_its_own_period_axes_and_blocks(tmp_path: Path) -> None:
    path = tmp_path / "recording.json"
    events = [(10, "G1 X1"), (12, "G1 X2")]
    path.write_bytes(edge_json(_rows([10, 11, 12, 13]), block=2, events=events, cycle_ms=4))
    (frame,), reader = _read(path, keep_all=True)
    assert frame.time_s.tolist() == pytest.approx([0.0, 0.004, 0.008, 0.012])
    assert frame.channels["table_position_m"].tolist() == [0.002] * 4
    np.testing.assert_allclose(
        frame.channels["motor_angle_rad"], 2 * math.pi / 10 * np.arange(10, 14)
    )
    first, second = crc32(b"G1 X1"), crc32(b"G1 X2")
    np.testing.assert_array_equal(frame.channels[BLOCK], [first, first, second, second])
    assert "time_s = 0.004 s * CYCLE" in reader.remarks


def test_faults_inside_json_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "recording.json"
    rows: list = _rows(list(range(10, 18)))
    rows[1][1] = None
    rows[2] = [12, 1.0]
    rows[3] = "no row"
    rows[4][1] = "off"
    rows[5][1] = [1.0, 2.0]
    rows[6][1] = 10**400
    path.write_bytes(edge_json(rows))
    (frame,), reader = _read(path)
    assert (len(frame), reader.ragged_rows, reader.bad_cells["motor_angle_rad"]) == (6, 2, 4)


def test_json_may_be_cut_at_any_chunk(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("edge_service.recordings.sinumerik.edge.CHUNK_BYTES", 7)
    path = tmp_path / "recording.json"
    content = edge_json(_rows(list(range(10, 40))))
    path.write_bytes(json.dumps(json.loads(content), indent=1).encode())
    (frame,), _ = _read(path)
    assert frame.channels["torque_command_nm"].tolist() == [0.5] * 30
    assert len(frame) == 30
