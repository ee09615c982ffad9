"""Files that are no traces: one clear line each."""

from pathlib import Path

import pytest

from edge_service.messages.samples import ColumnMap
from edge_service.recordings import reader
from edge_service.recordings.columns import TraceError
from edge_service.recordings.reader import open_trace, read_trace

VOLTS = {"torque_command_nm": ColumnMap("u_V", scale=0.5)}


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "empty"),
        (b"\xef\xbb\xbf\r\n  \n", "empty"),
        (b"# a comment\n", "comments only"),
        (b"0.0,1.0\n0.1,2.0\n", "numbers without a header; name the columns"),
        (b"0.0\t1.0\n0.1\t2.0\n", "there are '#1', '#2'"),
        (b"time_s,torque_command_nm\n", "a header but no rows"),
        (b"time_s,torque_command_nm", "a header but no rows"),
        (b"time_s,torque_command_nm\n1\n2\n", "no row has the 2 cells"),
        (b"time_s,torque_command_nm\n,1\n,2\n", "none of 2 rows holds a time"),
        (b"Time_s,torque_command_nm\n0,1\n", "no column 'time_s'; did you mean 'Time_s'?"),
        (b"time_s,temperature_c\n0,1\n", "no torque and no position channel"),
        (b"time_s,torque_command_nm,time_s\n0,1,0\n", "'time_s' appears more than once"),
        (b"time_s,torque_command_nm\n0,on\n1,off\n", "holds 'on' and no number at all"),
        (b"<!DOCTYPE html><html><body>404</body></html>", "HTML or XML"),
        (b"PK\x03\x04\x14\x00[Content_Types].xml xl/workbook.xml", "an Excel workbook: export it"),
        (b"\x89HDF\r\n\x1a\n\0", "an HDF5 file"),
        (b"MATLAB 7.3 MAT-file, Platform: GLNXA64", "save('x.mat', '-v7')"),
        (b"SQLite format 3\0", "an SQLite database"),
        (b"%PDF-1.7\n", "a PDF document"),
        (b"# site\n\n[service]\n", "a configuration or a machine file"),
        (b"TDSm\x0e\0\0\0", "a TDMS file of LabVIEW"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "an old Excel or Word document"),
        (b"\x80\x04\x95\x10", "a Python pickle, which is never opened"),
        (bytes(257) + b"ustar\x0000", "a tar archive"),
        ("time_s,torque_command_nm\n0,1\n".encode("utf-16-le"), "UTF-16"),
        (b'{"a": 1}', "JSON, and no recording of Industrial Edge"),
        (b'{"Header": {"SignalListHFData": []}, "Payload": []}', "no SignalListHFData"),
        (b'{"Header": {"SignalListHFData": 3}, "Payloads": []}', "no list 'Payload'"),
        (b'{"Header": {"SignalListHFData": [', "cut off or damaged"),
        (
            b"<?xml version='1.0'?><!-- x --><DynamicModelAxisController>",
            "edge-service fingerprint",
        ),
        (b"<?xml version='1.0'?><UANodeSet>", "XML document <UANodeSet>"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "git lfs pull"),
        (b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR", "PNG"),
        (b"\x1f\x8b\x08\x00", "gzip"),
        (b"PK\x03\x04\x14\x00", "zip archive"),
        ("time_s,torque_command_nm\n0,1\n".encode("utf-16"), "UTF-16"),
        (b"\x7fELF\x02\x01\x01\x00" + bytes(64), "no text"),
        (b"PAR1 and then nothing of the kind", "damaged Parquet"),
        (b"Lorem ipsum dolor sit amet\n" * 20, "edge-service adopt trace.csv --out m.toml reads"),
    ],
)
def test_no_trace_is_reported_in_one_line(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "trace.csv"
    path.write_bytes(content)
    with pytest.raises(TraceError) as caught:
        read_trace(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert says in message
    assert "\n" not in message


def test_missing_file_folder_and_unreadable_file(tmp_path: Path) -> None:
    with pytest.raises(TraceError, match="no such file"):
        open_trace(tmp_path / "missing.csv")
    with pytest.raises(TraceError, match="folder"):
        open_trace(tmp_path)
    with pytest.raises(TraceError, match="cannot be read"):
        open_trace(tmp_path / ("x" * 300 + ".csv"))


def test_mapped_column_that_is_nowhere_names_what_is_there(tmp_path: Path) -> None:
    path = tmp_path / "trace.csv"
    path.write_text("time_s,motor_angle_rad,u_v\n0,1,2\n")
    with pytest.raises(TraceError) as caught:
        open_trace(path, VOLTS)
    message = str(caught.value)
    assert "no column 'u_V', which the machine file gives for torque_command_nm" in message
    assert "did you mean 'u_v'?" in message
    assert "there are 'time_s', 'motor_angle_rad', 'u_v'" in message


def test_too_many_rows_for_one_frame(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "trace.csv"
    path.write_text("time_s,motor_angle_rad\n0,1\n1,1\n2,1\n")
    monkeypatch.setattr(reader, "MOST_ROWS", 2)
    with pytest.raises(TraceError, match="more than 2 rows"):
        read_trace(path)


def test_a_line_without_end_is_refused_before_it_fills_the_memory(tmp_path: Path) -> None:
    path = tmp_path / "trace.csv"
    path.write_bytes(b"time_s,motor_angle_rad\n" + b"1" * (5 << 20))
    with pytest.raises(TraceError, match="a line of more than"):
        read_trace(path)
