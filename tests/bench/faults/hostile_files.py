"""Hostile files: right ones of every kind, spoiled byte by byte or word by word."""

import random
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet

_CHECKOUT = Path(__file__).parents[3]
_DEPLOY = _CHECKOUT / "deploy"
WORDS = (
    *(b"", b"nan", b"inf", b"-inf", b"-1", b"0", b"1e308", b"1e-308", b"9" * 400, b"1_0", b"0x1"),
    *(b'""', b"''", b"[]", b"{}", b"true", b"null", b'"X"', b'"../.."', b"[[1.0]]", b"{ a = 1 }"),
    *(b"\xff\xfe", b"\0", b'"' * 3, b"[" * 3000, b"&a;", b"<!DOCTYPE a [", b"]]>", b"1,5", b";"),
    *(b"2026-01-01", b"tcp/127.0.0.1:0", b'"%s"', b"\xf0\x9f\x92\xa9", b"a" * 5000, b"\r\n", b"\t"),
)
_WORD = re.compile(rb"[A-Za-z0-9_.+\-]+")
_ROWS = 300
_XML = """<?xml version="1.0" encoding="UTF-8"?><traceSession><traceData><dataFrame>\
<frameHeader startTime="2020-01-01T00:00:00"/>\
<dataSignal id="s1" name="/Nck/!SEMA/measPos2 [u1, 1]" interval="0.001" unitsType="posn"/>\
{rows}</dataFrame></traceData></traceSession>
"""


def right_files(folder: Path) -> dict[str, Sequence[bytes]]:
    """Right contents by kind: `csv`, `parquet`, `xml`, `config` and `machine`."""
    time_s = np.arange(_ROWS) / 1000.0
    columns = {"time_s": time_s, "torque_command_nm": time_s % 0.3, "motor_angle_rad": time_s * 20}
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns), *(",".join(f"{cell:.4f}" for cell in row) for row in rows), ""]
    csv = "\n".join(lines)
    german = csv.replace(",", ";").replace(".", ",")
    records = "".join(f'<rec time="{row / 1000}" s1="{row % 50}"/>' for row in range(_ROWS))
    configs = [_DEPLOY / "edge.toml", _DEPLOY / "drivers" / "simulated.toml"]
    machines = [
        _DEPLOY / f"{name}.toml" for name in ("machine", "commissioned", "emps", "cnc_mill")
    ]
    return {
        "csv": [csv.encode(), german.encode(), csv.encode("utf-16")],
        "parquet": [_parquet(folder, columns, each) for each in ("zstd", "snappy", "none")],
        "xml": [_XML.format(rows=records).encode()],
        "config": [path.read_bytes() for path in configs],
        "machine": [path.read_bytes() for path in machines],
    }


def _parquet(folder: Path, columns: Mapping[str, np.ndarray], compression: str) -> bytes:
    path = folder / "right.parquet"
    pyarrow.parquet.write_table(pa.table(dict(columns)), path, compression=compression)
    return path.read_bytes()


def spoiled(content: bytes, chance: random.Random) -> bytes:
    """The content after one to four changes."""
    for _ in range(chance.randrange(1, 5)):
        content = chance.choice(_CHANGES)(content, chance)
    return content


def _place(content: bytes, chance: random.Random) -> int:
    return chance.randrange(len(content) + 1)


def _flip(content: bytes, chance: random.Random) -> bytes:
    changed = bytearray(content or b"\0")
    changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
    return bytes(changed)


def _cut(content: bytes, chance: random.Random) -> bytes:
    return content[: _place(content, chance)]


def _take_out(content: bytes, chance: random.Random) -> bytes:
    start = _place(content, chance)
    return content[:start] + content[start + chance.randrange(200) :]


def _repeat(content: bytes, chance: random.Random) -> bytes:
    start = _place(content, chance)
    part = content[start : start + chance.randrange(1, 300)]
    return content[:start] + part * chance.choice((2, 3, 50)) + content[start:]


def _noise(content: bytes, chance: random.Random) -> bytes:
    start = _place(content, chance)
    return content[:start] + chance.randbytes(chance.randrange(1, 40)) + content[start:]


def _zeros(content: bytes, chance: random.Random) -> bytes:
    start, length = _place(content, chance), chance.randrange(1, 600)
    return content[:start] + bytes(length) + content[start + length :]


def _word(content: bytes, chance: random.Random) -> bytes:
    words = list(_WORD.finditer(content))
    if not words:
        return content + chance.choice(WORDS)
    found = chance.choice(words)
    return content[: found.start()] + chance.choice(WORDS) + content[found.end() :]


_CHANGES: tuple[Callable[[bytes, random.Random], bytes], ...] = (
    *(_flip, _cut, _take_out, _repeat, _noise, _zeros),
    *(_word,) * 6,
)
