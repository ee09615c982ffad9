"""Right files of every form that is read, written here from the forms' public layouts."""

import io
import json
import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import scipy.io

ROWS = 300
_XML = """<?xml version="1.0" encoding="UTF-8"?><traceSession><traceData><dataFrame>\
<frameHeader startTime="2020-01-01T00:00:00"/>\
<dataSignal id="s1" name="/Nck/!SEMA/measPos2 [u1, 1]" interval="0.001" unitsType="posn"/>\
{rows}</dataFrame></traceData></traceSession>
"""


def columns() -> dict[str, np.ndarray]:
    time_s = np.arange(ROWS) / 1000.0
    return {"time_s": time_s, "torque_command_nm": time_s % 0.3, "motor_angle_rad": time_s * 20}


def table(names: Sequence[str], values: Sequence[np.ndarray], delimiter: str = ",") -> str:
    rows = zip(*values, strict=True)
    lines = [delimiter.join(f"{cell:.4f}" for cell in row) for row in rows]
    return "\n".join([delimiter.join(names), *lines, ""])


def csv() -> list[bytes]:
    text = table(list(columns()), list(columns().values()))
    named = "\n".join(["# " + text.splitlines()[0].replace(",", " "), *text.splitlines()[1:]])
    return [
        text.encode(),
        text.replace(",", ";").replace(".", ",").encode(),
        text.replace(",", "\t").encode(),
        named.replace(",", "  ").encode(),
        table(["CYCLE", *EDGE_NAMES], [5000.0 + np.arange(ROWS), *edge_values()]).encode(),
        table(EDGE_NAMES, edge_values()).encode(),
    ]


def headerless() -> bytes:
    """Numbers and tabs alone."""
    return table([], list(columns().values()), "\t").lstrip("\n").encode()


EDGE_NAMES = ["ENC1_POS|1", "ENC2_POS|1", "TORQUE|1"]


def edge_values() -> list[np.ndarray]:
    """Positions in mm and a torque in N m."""
    position_mm = np.sin(np.arange(ROWS) / 40.0)
    return [position_mm, position_mm + 0.001, position_mm * 0.2]


def edge_json(
    rows: Sequence[Sequence[object]],
    names: Sequence[str] = ("CYCLE", *EDGE_NAMES),
    block: int = 50,
    events: Sequence[tuple[int, str]] = ((5000, "G1 X1"), (5100, "G1 X2")),
    cycle_ms: object = 2,
) -> bytes:
    """Layout of Capture4Analysis as CaptureDataParser's example has it."""
    signals = [
        {"Name": name, "Type": "DOUBLE", "Axis": "X1" if "|" in name else "", "Address": name}
        for name in names
    ]
    payload: list[dict[str, Any]] = [
        {"HFTimestamp": {"Time": "2024-01-01T00:00:00Z", "HFProbeCounter": 1}}
    ]
    for counter, block_text in events:
        event = {"HFProbeCounter": counter, "SeekOffset": 3, "ActiveTool": 6, "GCode": block_text}
        payload.append({"HFBlockEvent": event})
    for start in range(0, len(rows), block):
        payload.append({"HFData": [list(row) for row in rows[start : start + block]]})
    header = {"SignalListHFData": signals, "CycleTimeMs": cycle_ms}
    return json.dumps({"Header": header, "Payload": payload, "Footer": {}}).encode()


def jsons() -> list[bytes]:
    values = np.column_stack([5000 + np.arange(ROWS), *edge_values()])
    return [edge_json(values.tolist()), edge_json(values.tolist(), EDGE_NAMES)]


def parquets() -> list[bytes]:
    files = []
    for compression in ("zstd", "snappy", "none"):
        file = io.BytesIO()
        pyarrow.parquet.write_table(pa.table(columns()), file, compression=compression)
        files.append(file.getvalue())
    return files


def xmls() -> list[bytes]:
    records = "".join(f'<rec time="{row / 1000}" s1="{row % 50}"/>' for row in range(ROWS))
    return [_XML.format(rows=records).encode()]


def matlab(values: Mapping[str, object], *, compressed: bool = True) -> bytes:
    file = io.BytesIO()
    scipy.io.savemat(file, values, do_compression=compressed)
    return b"MATLAB 5.0 MAT-file, not dated".ljust(116) + file.getvalue()[116:]


def matlabs() -> list[bytes]:
    names = np.array(list(columns()), dtype=object)
    matrix = np.column_stack(list(columns().values()))
    return [
        matlab(columns(), compressed=False),
        matlab({"recording": {**columns(), "comment": "x"}}),
        matlab({"data": matrix, "names": names}),
    ]


RIGHT: dict[str, Callable[[], list[bytes]]] = {
    "text (CSV)": csv,
    "JSON of Industrial Edge": jsons,
    "Parquet": parquets,
    "SINUMERIK trace XML": xmls,
    "MATLAB 5": matlabs,
}
"""Name of a form -> right files of it."""


def _bomb_of_zeros() -> bytes:
    """A packed variable of 300 MB of zeros."""
    packer = zlib.compressobj()
    packed = packer.compress(struct.pack("<II", 14, 300 << 20))
    packed += b"".join(packer.compress(bytes(1 << 20)) for _ in range(300)) + packer.flush()
    header = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H2s", 0x0100, b"IM")
    return header + struct.pack("<II", 15, len(packed)) + packed


def _length_beyond_the_file() -> bytes:
    header = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H2s", 0x0100, b"IM")
    return header + struct.pack("<II", 15, 0xFFFF_FFFF) + zlib.compress(bytes(100))


def _endless_element() -> bytes:
    start = edge_json([[5000, 1.0, 1.0, 1.0]]).replace(b'"Footer"', b'"F"')
    return start[: start.index(b'{"HFData"')] + b'{"HFData": [[' + b"1.0," * 10_000_000


def _long_line() -> bytes:
    return b"time_s,torque_command_nm\n" + b"1" * (6 << 20)


LYING: dict[str, Callable[[], bytes]] = {"MATLAB 5": _length_beyond_the_file}
"""Name of a form -> a file of it that states more than it holds."""

GREEDY: dict[str, Callable[[], bytes]] = {
    "MATLAB 5": _bomb_of_zeros,
    "JSON of Industrial Edge": _endless_element,
    "text (CSV)": _long_line,
}
"""Name of a form -> a file of it that asks for more than it may take."""
