"""Damage at random: a trace or a TraceError, never anything else."""

import io
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from edge_service.recordings.columns import TraceError
from edge_service.recordings.reader import open_trace


def _csv() -> bytes:
    time_s = np.arange(60) * 1e-3
    rows = np.column_stack([time_s, np.sin(time_s), 20.0 + time_s]).tolist()
    lines = [",".join(map(repr, row)) for row in rows]
    header = "time_s,torque_command_nm,motor_angle_rad"
    return ("\n".join([header, *lines]) + "\n").encode()


def _parquet() -> bytes:
    time_s = np.arange(60) * 1e-3
    file = io.BytesIO()
    table = pa.table({"time_s": time_s, "torque_command_nm": np.sin(time_s)})
    pq.write_table(table, file, write_page_checksum=True)
    return file.getvalue()


WHOLE = {".csv": _csv(), ".parquet": _parquet()}
EDITS = st.lists(
    st.tuples(st.floats(0.0, 1.0), st.integers(0, 3), st.binary(max_size=6)), min_size=1, max_size=4
)


def _damaged(content: bytes, edits: list[tuple[float, int, bytes]]) -> bytes:
    """Replace some bytes at each place by others."""
    for place, length, put in edits:
        start = int(place * len(content))
        content = content[:start] + put + content[start + length :]
    return content


def _check_readable(content: bytes, suffix: str) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"trace{suffix}"
        path.write_bytes(content)
        try:
            with open_trace(path) as reader:
                frames = list(reader)
        except TraceError as error:
            assert "\n" not in str(error)
            return
        assert sum(map(len, frames)) == reader.rows_read > 0
        for frame in frames:
            assert np.isfinite(frame.time_s).all()
            assert not any(np.isinf(values).any() for values in frame.channels.values())


@pytest.mark.parametrize("suffix", list(WHOLE))
@settings(max_examples=80, deadline=None)
@given(edits=EDITS)
def test_damaged_file(suffix: str, edits: list[tuple[float, int, bytes]]) -> None:
    _check_readable(_damaged(WHOLE[suffix], edits), suffix)


@settings(max_examples=80, deadline=None)
@given(content=st.binary(max_size=200))
@example(content=b"#")
@example(content=b'"')
@example(content=b"\r")
def test_any_bytes(content: bytes) -> None:
    _check_readable(content, ".csv")
    _check_readable(b"time_s,torque_command_nm\n0,1\n" + content, ".csv")
