"""The way through `convert`: any form in, another out, and a true account of it."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from edge_service.command_answer import LISTENER, Answer
from edge_service.models.machine import Machine
from edge_service.offline.convert import convert
from edge_service.offline.recordings import read_recording
from edge_service.recordings.columns import TraceError
from edge_service.recordings.reader import open_trace, read_trace
from tests.programs import printed

LEAD_M = 0.01
SPEED_MM_S = 5.0
ROWS = 4000
CURRENT: dict[str, object] = {"torque_command_nm": {"column": "ActCurr", "scale": 0.8}}


def _machine(columns: dict[str, object] | None = None) -> Machine:
    table = {"axis": {"lead_m": LEAD_M}, "model": {"inertia_kg_m2": 1e-3}, "columns": columns or {}}
    return Machine.model_validate(table)


def trace_xml(velocity_scale: float = 60.0, rows: int = ROWS) -> str:
    """An axis at constant speed there and back: positions in mm, speed in mm/s * scale."""
    names = {
        "f1": ("/Nck/!SD/nckServoDataActPos1stEnc64 [u1, 2]", "posn"),
        "f2": ("/Nck/!SD/nckServoDataActVelMot32 [u1, 2]", "velo"),
        "f3": ("/Nck/!SD/nckServoDataActCurr32 [u1, 2]", "current"),
        "f4": ("/Nck/!SD/nckServoDataFlwErr64 [u1, 2]", "posn"),
    }
    head = "".join(
        f'<dataSignal id="{key}" interval="0.002" datapointCount="{rows}" name="{name}" '
        f'unitsType="{units}"/>'
        for key, (name, units) in names.items()
    )
    lines = []
    half = rows // 2
    for row in range(rows):
        position = SPEED_MM_S * 0.002 * (row if row < half else 2 * half - row)
        cells = f' f1="{position:.6f}"'
        if row in {0, half}:
            sign = 1.0 if row == 0 else -1.0
            speed = sign * SPEED_MM_S * velocity_scale
            cells += f' f2="{speed:.6f}" f3="{sign * 2.0:.6f}" f4="{sign * 0.01:.6f}"'
        lines.append(f'<rec time="{row * 0.002:.6f}"{cells}/>\n')
    return (
        "<traceSession><traceData><dataFrame>"
        f'<frameHeader stopInc="{(rows - 1) * 0.002:.6f}" dropOuts="0"/>{head}{"".join(lines)}'
        "</dataFrame></traceData></traceSession>"
    )


def _convert(folder: Path, out: str, text: str | None = None, **options: bool) -> Answer:
    source = folder / "trace.xml"
    source.write_text(text or trace_xml())
    return convert(source, folder / out, _machine(CURRENT), **options)


@pytest.mark.parametrize("out", ["out.csv", "out.parquet"])
def test_a_trace_becomes_si_rows(tmp_path: Path, out: str) -> None:
    answer = _convert(tmp_path, out)
    summary = answer.document
    read = read_trace(tmp_path / out)
    assert len(read) == summary["rows"] == ROWS
    assert (summary["set_aside"], summary["missing"]) == (0, {})
    assert summary["ignored"] == ("/Nck/!SD/nckServoDataFlwErr64 [u1, 2]",)
    rad_per_s = 2.0 * math.pi / LEAD_M * SPEED_MM_S * 1e-3
    half = ROWS // 2
    np.testing.assert_allclose(read.channels["motor_speed_rad_s"][:half], rad_per_s, rtol=1e-12)
    np.testing.assert_allclose(read.channels["motor_speed_rad_s"][half:], -rad_per_s, rtol=1e-12)
    np.testing.assert_allclose(
        np.gradient(read.channels["motor_angle_rad"], 0.002)[1 : half - 1], rad_per_s, rtol=1e-6
    )
    np.testing.assert_allclose(read.channels["torque_command_nm"][:half], 1.6, rtol=1e-12)
    assert not any("looks" in remark for remark in summary["remarks"])
    assert f"{ROWS} rows; " in answer.words


def test_the_converted_file_equals_the_source_to_the_last_bit(tmp_path: Path) -> None:
    _convert(tmp_path, "out.parquet")
    direct, converted = (
        read_recording(_machine(CURRENT), tmp_path / "trace.xml"),
        read_trace(tmp_path / "out.parquet"),
    )
    np.testing.assert_array_equal(direct.time_s, converted.time_s)
    for name, values in direct.channels.items():
        np.testing.assert_array_equal(values, converted.channels[name])


def test_a_speed_in_mm_s_is_noticed(tmp_path: Path) -> None:
    answer = _convert(tmp_path, "out.csv", trace_xml(velocity_scale=1.0))
    summary = answer.document
    (doubt,) = [remark for remark in summary["remarks"] if "looks" in remark]
    assert "motor_speed_rad_s looks 60 times too small" in doubt
    assert "per second instead of per minute" in doubt


def test_unreadable_rows_are_counted(tmp_path: Path) -> None:
    source = tmp_path / "in.csv"
    times = [0.0, 0.1, 0.2, 0.3, 1.0, 1.1, 5.0]
    rows = "".join(f"{time},{index}\n" for index, time in enumerate(times))
    source.write_text("time_s,motor_angle_rad\n" + rows + "6\n5.1,\n")
    seen: list[str] = []
    LISTENER.set(seen.append)
    answer = convert(source, tmp_path / "out.csv", _machine())
    summary = answer.document
    assert (summary["rows"], summary["set_aside"]) == (8, 1)
    assert summary["missing"] == {"motor_angle_rad": 1}
    assert seen == ["converting in.csv: 100 %"]


def test_all_columns_are_kept_under_their_own_names(tmp_path: Path) -> None:
    lag = "/Nck/!SD/nckServoDataFlwErr64 [u1, 2]"
    answer = _convert(tmp_path, "out.parquet", keep_all=True)
    summary = answer.document
    assert lag in summary["channels"]
    assert summary["ignored"] == ()
    with open_trace(tmp_path / "out.parquet", keep_all=True) as reader:
        frames = list(reader)
    values = np.concatenate([frame.channels[lag] for frame in frames])
    half = ROWS // 2
    np.testing.assert_array_equal(values, [0.01] * half + [-0.01] * half)
    with pytest.raises(TraceError, match="CSV holds channels only"):
        _convert(tmp_path, "all.csv", keep_all=True)


def test_columns_of_words_are_kept_out_of_all(tmp_path: Path) -> None:
    source = tmp_path / "in.csv"
    source.write_text("time_s,motor_angle_rad,mode,spare,spare\n0,1,auto,1,2\n1,2,hand,3,4\n")
    convert(source, tmp_path / "out.parquet", _machine(), keep_all=True)
    with open_trace(tmp_path / "out.parquet", keep_all=True) as reader:
        (frame,) = list(reader)
    assert set(frame.channels) == {"motor_angle_rad", "mode", "spare #4", "spare #5"}
    assert np.isnan(frame.channels["mode"]).all()


def test_the_source_is_never_overwritten(tmp_path: Path) -> None:
    source = tmp_path / "in.csv"
    source.write_text("time_s,motor_angle_rad\n0,1\n")
    with pytest.raises(TraceError, match="is the recording itself"):
        convert(source, source, _machine())


def test_a_cut_off_source_leaves_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(
        TraceError, match=r"cut off or damaged .*3999 records were read up to 7\.99"
    ):
        _convert(tmp_path, "out.csv", trace_xml()[:-60])
    assert [path.name for path in tmp_path.iterdir()] == ["trace.xml"]


PEAK = """
import re, sys
from pathlib import Path
from edge_service.recordings.sinumerik.signals import ControllerAxis
from edge_service.recordings.reader import open_trace
with open_trace(Path(sys.argv[1]), axis=ControllerAxis(lead_m=0.01)) as reader:
    rows = sum(len(frame) for frame in reader)
status = Path("/proc/self/status").read_text()
print(rows, re.search(r"VmHWM:\\s+(\\d+) kB", status)[1])
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs the peak memory of Linux")
def test_memory_does_not_grow_with_the_file(tmp_path: Path) -> None:
    def peak_kib(rows: int) -> int:
        path = tmp_path / "big.xml"
        path.write_text(trace_xml(rows=rows))
        read, peak = map(int, printed(sys.executable, "-c", PEAK, path).split())
        assert read == rows
        return peak

    small, large = peak_kib(50_000), peak_kib(1_200_000)
    assert (tmp_path / "big.xml").stat().st_size > 45e6
    assert large - small < 20_000
