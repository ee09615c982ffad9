"""SINUMERIK traces: sparse records of several clocks become rows; fixtures by hand."""

import math
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_service.messages.samples import ColumnMap
from edge_service.recordings.columns import TraceError
from edge_service.recordings.reader import TraceReader, joined, open_trace, read_trace
from edge_service.recordings.sinumerik.signals import ControllerAxis

NAN = math.nan
LEAD_M = 0.02
CURRENT = "/Nck/!SD/nckServoDataActCurr32 [u1, 7]"
POSITION = "/Nck/!SEMA/measPos1 [u1, 7]"
LINEAR = "/Nck/!SEMA/measPos2 [u1, 7]"
STATUS = "/Channel/!SEMA/aaStat [u1, 7]"
SIGNALS = {CURRENT: "current", POSITION: "posn", LINEAR: "posn", STATUS: "none"}
AXIS = ControllerAxis(number=1, lead_m=0.01)
RAD_PER_MM = 2.0 * math.pi / 10.0
EDGE = (
    "time_s,TORQUE|1,ENC1_POS|1,ENC2_POS|1,DES_POS|1,CURRENT|1,LOAD|1,CMD_SPEED|1,ENC1_POS|2\n"
    "0.000,0.5,100.0,99.5,100.5,2.0,10,5.0,7.0\n"
    "0.002,0.6,101.0,100.5,101.5,2.5,11,5.0,8.0\n"
)


def signal(key: str, name: str, interval: str, count: int | None, units: str = "") -> str:
    counted = "" if count is None else f' datapointCount="{count}"'
    units = units or SIGNALS.get(name, "posn")
    return (
        f'<dataSignal id="{key}" key="s{key}" interval="{interval}"{counted} name="{name}" '
        f'unitsType="{units}" dataType="double" description="&lt;no&gt;"/>'
    )


def frame(header: str, signals: str, records: str) -> str:
    return f"<dataFrame><frameHeader {header}/>{signals}{records}</dataFrame>"


def session(*frames: str) -> str:
    return (
        '<?xml version="1.0" encoding="utf-8" ?>\n<!--SINUMERIK Solution Line Trace-->\n'
        '<traceSession version="01.00.03.02"><traceCaptureSetup><signalSettings>'
        f'<signal key="s1" name="{CURRENT}"/></signalSettings></traceCaptureSetup>'
        f"<traceDisplaySetup/><traceData>{''.join(frames)}</traceData></traceSession>\n"
    )


TWO_CLOCKS = session(
    frame(
        'startTime="2026-06-03T17:57:40.613Z" stopInc="0.012000" dropOuts="0"',
        signal("f2", STATUS, "0.004", 3)
        + signal("f7", CURRENT, "0.002000", 7)
        + signal("f8", POSITION, "0.004000", 3),
        '<rec time="0.000000" f7="-0.5"/>'
        '<rec time="0.002000" f2="4" f8="10.0"/>'
        '<rec time="0.004000" f7="0.25"/>'
        '<rec time="0.006000" f2="4" f8="12.0"/>'
        '<rec time="0.012000" f7="1.5"/>',
    )
)
"""Current at 0, 2, ... 12 ms, position and status at 2, 6, 10 ms; nothing changed at 8, 10 ms."""


def write(folder: Path, text: str | bytes, name: str = "trace.xml") -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def read_all(path: Path) -> tuple[TraceReader, dict[str, list[float]]]:
    """Every column of a trace, in the file's own units, by a stand-in torque column."""
    torque = {"torque_command_nm": ColumnMap("ActCurr", 2.0)}
    with open_trace(path, torque, ControllerAxis(lead_m=LEAD_M), keep_all=True) as reader:
        read = joined(list(reader))
    columns = {name: values.tolist() for name, values in read.channels.items()}
    return reader, columns | {"time_s": read.time_s.tolist()}


def same(values: list[float], expected: list[float]) -> None:
    np.testing.assert_allclose(values, expected, rtol=1e-12, atol=0.0)


def test_two_clocks_by_hand(tmp_path: Path) -> None:
    reader, columns = read_all(write(tmp_path, TWO_CLOCKS))
    assert columns["time_s"] == [0.0, 0.002, 0.004, 0.006, 0.008, 0.010, 0.012]
    same(columns["torque_command_nm"], [-1.0, -1.0, 0.5, 0.5, 0.5, 0.5, 3.0])
    rad_per_mm = 2.0 * math.pi / 20.0
    mm = [NAN, 10.0, 10.0, 12.0, 12.0, 12.0, 12.0]
    same(columns["motor_angle_rad"], [rad_per_mm * each for each in mm])
    same(columns[STATUS], [NAN, 4.0, 4.0, 4.0, 4.0, 4.0, 4.0])
    assert "motor_angle_rad = 0.314159 * measPos1 (mm, with a lead of 0.02 m)" in reader.remarks
    assert any(f"held: {STATUS}, {POSITION}" in remark for remark in reader.remarks)


def test_without_drop_outs_silence_is_standstill_and_with_them_a_gap(tmp_path: Path) -> None:
    def text(drop_outs: int) -> str:
        header = f'stopInc="0.010" dropOuts="{drop_outs}"'
        records = (
            '<rec time="0" a="1"/><rec time="0.002" a="2"/>'
            '<rec time="0.008" a="3"/><rec time="0.010" a="4"/>'
        )
        return session(frame(header, signal("a", LINEAR, "0.002", 6 - drop_outs), records))

    still = read_trace(write(tmp_path, text(0)))
    assert still.time_s.tolist() == [0.0, 0.002, 0.004, 0.006, 0.008, 0.010]
    same(still.channels["table_position_m"].tolist(), [1e-3, 2e-3, 2e-3, 2e-3, 3e-3, 4e-3])
    path = write(tmp_path, text(2))
    dropped = read_trace(path)
    assert dropped.time_s.tolist() == [0.0, 0.002, 0.008, 0.010]
    same(dropped.channels["table_position_m"].tolist(), [1e-3, 2e-3, 3e-3, 4e-3])
    with open_trace(path) as reader:
        list(reader)
        assert any("2 drop-outs" in remark for remark in reader.remarks)


def test_frames_follow_at_the_distance_of_their_start_times(tmp_path: Path) -> None:
    def one(start: str, key: str, value: float) -> str:
        signals = signal(key, LINEAR, "0.002", 2)
        return frame(
            f'startTime="{start}" stopInc="0.002"', signals, f'<rec time="0" {key}="{value}"/>'
        )

    text = session(
        one("2026-06-03T17:57:40.000Z", "f1", 1.0),
        one("2026-06-03T17:57:50.500Z", "f9", 2.0),
        one("", "f1", 3.0),
    )
    read = read_trace(write(tmp_path, text))
    same(read.time_s.tolist(), [0.0, 0.002, 10.5, 10.502, 11.502, 11.504])
    same(read.channels["table_position_m"].tolist(), [1e-3, 1e-3, 2e-3, 2e-3, 3e-3, 3e-3])


def test_faults_inside_records_are_data(tmp_path: Path) -> None:
    records = (
        '<rec time="0" a="1"/><rec a="9"/><rec time="x" a="9"/><rec time="0.002" a="?" z="1"/>'
        '<rec time="0.002" a="9"/><rec time="0.001" a="9"/><rec time="0.004" a="3"/>'
    )
    text = session(frame("", signal("a", LINEAR, "0.002", None), records))
    with open_trace(write(tmp_path, text)) as reader:
        (read,) = list(reader)
    same(read.channels["table_position_m"].tolist(), [1e-3, NAN, 3e-3])
    assert (reader.ragged_rows, reader.bad_cells["table_position_m"]) == (4, 1)


ONE = session(frame("", signal("a", LINEAR, "0.002", 9), "<rec time='0' a='1'/>RECORDS"))
LINE = signal("a", LINEAR, "0.002", 9)
ENTITIES = "document type or entities; refused"
LONG, BROKEN = "an element of more than 4194304 bytes", "clock of the file is broken"
NO_DATA = "a trace session without data"


def declared(entities: str) -> str:
    """A trace with entities before its first element."""
    return TWO_CLOCKS.replace("<traceSession", f"<!DOCTYPE a [{entities}]><traceSession", 1)


REFUSED = {
    "billion laughs": (declared('<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">'), ENTITIES),
    "an external entity": (declared('<!ENTITY a SYSTEM "file:///etc/passwd">'), ENTITIES),
    "a parameter": (declared('<!ENTITY % a SYSTEM "file:///etc/passwd"> %a;'), ENTITIES),
    "an undeclared entity": (ONE.replace("RECORDS", "&a;"), "cut off or damaged"),
    "a jump of the clock": (ONE.replace("RECORDS", "<rec time='1e9' a='1'/>"), BROKEN),
    "a promise of endless samples": (ONE.replace('Count="9"', 'Count="1e15"'), BROKEN),
    "deep nesting": (ONE.replace("RECORDS", "<rec>" * 100_000), "more than 64 deep"),
    "an endless attribute": (ONE.replace("RECORDS", f"<rec time='{'0' * (6 << 20)}'/>"), LONG),
    "an endless comment": (ONE.replace("RECORDS", f"<!--{'-a' * (3 << 20)}-->"), LONG),
    "endless signals": (
        ONE.replace(LINE, "".join(LINE.replace('"a"', f'"a{i}"') for i in range(5000))),
        "more than 4096 signals",
    ),
    "another document": ("<html><body>404</body></html>", "HTML or XML"),
    "another root": ("<trace><traceSession/></trace>", "HTML or XML document <trace>"),
    "no frame": ("<traceSession><traceData/></traceSession>", NO_DATA),
    "no signals": (session(frame("", "", "")), NO_DATA),
    "no records": (ONE.replace("<rec time='0' a='1'/>RECORDS", ""), "a header but no rows"),
    "no interval": (ONE.replace('interval="0.002"', ""), "expected an id and seconds above 0"),
    "no interval above 0": (ONE.replace("0.002", "-1"), "interval '-1'"),
    "no channel": (
        session(frame("", signal("a", STATUS, "0.004", 1), "<rec time='0' a='4'/>")),
        "no torque and no position channel",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_hostile_and_foreign_files_are_refused_in_one_line(tmp_path: Path, name: str) -> None:
    text, says = REFUSED[name]
    path = write(tmp_path, text)
    with pytest.raises(TraceError) as caught:
        read_trace(path)
    assert str(caught.value).startswith(str(path))
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


US = 1e-6
FAST_US = 2000


@st.composite
def dense_signals(draw: st.DrawFn) -> list[tuple[int, int, list[float], list[bool]]]:
    """Signals as (interval, phase, samples, written though unchanged), times in us."""
    clocks = draw(st.lists(st.sampled_from([(4000, 0), (4000, 2000), (8000, 6000)]), max_size=3))
    cells = st.integers(-3, 3).map(lambda number: number * 0.125)
    fast_phase = draw(st.sampled_from([0, 2000, 10_000]))
    drawn = []
    for interval, phase in [(FAST_US, fast_phase), *clocks]:
        samples = draw(st.lists(cells, min_size=1, max_size=12))
        written = draw(st.lists(st.booleans(), min_size=len(samples), max_size=len(samples)))
        drawn.append((interval, phase, samples, written))
    return drawn


def encode(signals: list[tuple[int, int, list[float], list[bool]]], counted: bool) -> str:
    """A sparse trace: a value stands where it changed, a record where any value stands."""
    records: dict[int, str] = {}
    headers = ""
    for index, (interval, phase, samples, written) in enumerate(signals):
        name = f"/Nck/!SEMA/{'measPos2' if index == 0 else f'other{index}'} [u1, 3]"
        count = len(samples) if counted else None
        headers += signal(f"f{index}", name, f"{interval * US:.6f}", count)
        for tick, value in enumerate(samples):
            if tick == 0 or written[tick] or value != samples[tick - 1]:
                time_us = phase + tick * interval
                records[time_us] = records.get(time_us, "") + f' f{index}="{value:.6f}"'
    lines = "".join(f'<rec time="{t * US:.6f}"{records[t]}/>\n' for t in sorted(records))
    stop_us = max(phase + (len(s) - 1) * interval for interval, phase, s, _ in signals)
    return session(frame(f'stopInc="{stop_us * US:.6f}" dropOuts="0"', headers, lines))


def decode(
    signals: list[tuple[int, int, list[float], list[bool]]], counted: bool
) -> tuple[list[float], list[list[float]]]:
    """Times and values that the dense samples stand for: each held for an interval of its own."""
    start_us = min(phase for _, phase, _, _ in signals)
    stop_us = max(phase + (len(s) - 1) * interval for interval, phase, s, _ in signals)
    rows_us = range(start_us, stop_us + 1, FAST_US)
    columns = []
    for interval, phase, samples, _ in signals:
        column = []
        for time_us in rows_us:
            tick = (time_us - phase) // interval
            if not counted:
                tick = min(tick, len(samples) - 1)
            column.append(samples[tick] if 0 <= tick < len(samples) else NAN)
        columns.append(column)
    return [time_us / 1e6 for time_us in rows_us], columns


@settings(max_examples=150, deadline=None)
@given(signals=dense_signals(), counted=st.booleans())
def test_what_was_encoded_comes_back(
    signals: list[tuple[int, int, list[float], list[bool]]], counted: bool
) -> None:
    with TemporaryDirectory() as folder:
        path = write(Path(folder), encode(signals, counted))
        with open_trace(path, keep_all=True) as reader:
            frames = list(reader)
    expected_s, expected = decode(signals, counted)
    time_s = np.concatenate([each.time_s for each in frames])
    np.testing.assert_array_equal(time_s, expected_s)
    for name, column in zip(reader.channels, expected, strict=True):
        scale = 1e-3 if name == "table_position_m" else 1.0
        values = np.concatenate([each.channels[name] for each in frames])
        np.testing.assert_array_equal(values, np.array(column) * scale)


def _write(folder: Path, suffix: str, text: str = EDGE) -> Path:
    path = folder / f"edge{suffix}"
    path.write_text(text)
    if suffix == ".parquet":
        names, *rows = [line.split(",") for line in text.splitlines()]
        cells = [[float(cell) for cell in column] for column in zip(*rows, strict=True)]
        pq.write_table(pa.table(dict(zip(names, cells, strict=True))), path)
    return path


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_edge_columns_are_known_by_their_names(tmp_path: Path, suffix: str) -> None:
    path = _write(tmp_path, suffix)
    frame = read_trace(path, axis=AXIS)
    expected = {
        "torque_command_nm": [0.5, 0.6],
        "motor_angle_rad": [100.0 * RAD_PER_MM, 101.0 * RAD_PER_MM],
        "table_position_m": [0.0995, 0.1005],
        "position_setpoint_m": [0.1005, 0.1015],
    }
    assert set(frame.channels) == set(expected)
    for name, values in expected.items():
        np.testing.assert_allclose(frame.channels[name], values, rtol=1e-14)
    with open_trace(path, axis=AXIS) as reader:
        assert set(reader.ignored) == {"CURRENT|1", "LOAD|1", "CMD_SPEED|1", "ENC1_POS|2"}


def test_another_axis_and_one_that_is_not_there(tmp_path: Path) -> None:
    path = _write(tmp_path, ".csv")
    frame = read_trace(path, axis=ControllerAxis(number=2, lead_m=0.02))
    np.testing.assert_allclose(frame.channels["motor_angle_rad"], [0.7 * math.pi, 0.8 * math.pi])
    with pytest.raises(TraceError, match="no signal of axis 3; axes there are: 1, 2"):
        open_trace(path, axis=ControllerAxis(number=3))
    for text, there in ((EDGE, "1, 2"), (EDGE.replace("|1", "|5"), "2, 5")):
        with pytest.raises(TraceError, match=f"axes there are: {there}; expected .*--axis-number"):
            open_trace(_write(tmp_path, ".csv", text))


def test_the_machine_file_comes_first_and_may_use_short_names(tmp_path: Path) -> None:
    path = _write(tmp_path, ".csv")
    columns = {
        "torque_command_nm": ColumnMap("CURRENT", 0.4, 0.1),
        "motor_speed_rad_s": ColumnMap("CMD_SPEED", 3.0),
    }
    with open_trace(path, columns, AXIS) as reader:
        (frame,) = list(reader)
    np.testing.assert_allclose(frame.channels["torque_command_nm"], [0.9, 1.1])
    np.testing.assert_allclose(frame.channels["motor_speed_rad_s"], [15.0, 15.0])
    assert not any(remark.startswith("torque_command_nm") for remark in reader.remarks)


def test_a_current_is_no_torque_without_a_scale(tmp_path: Path) -> None:
    path = _write(tmp_path, ".csv", EDGE.replace("TORQUE|1", "POWER|1"))
    with open_trace(path, axis=AXIS) as reader:
        assert "torque_command_nm" not in reader.channels
        wish = "torque_command_nm could be CURRENT, lacking: the torque constant in N m/A"
        assert wish in reader.remarks
