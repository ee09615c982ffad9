"""One estimate as a record of fixed size with a checksum."""

import struct
import zlib

import numpy as np

from ...messages.estimate import EstimateStatus, Interval, PreloadEstimate
from .rows import QUANTITIES, STATUSES, Rows, single_rows

NAN = float("nan")
_NUMBERS = 2 + len(QUANTITIES)
_BODY = struct.Struct(f"<qb{_NUMBERS}d")
_CHECK = struct.Struct("<I")
RECORD_BYTES = _BODY.size + _CHECK.size
_RECORD = np.dtype(
    [("time_ns", "<i8"), ("status", "i1"), ("numbers", "<f8", (_NUMBERS,)), ("check", "<u4")]
)


def record_of(time_ns: int, estimate: PreloadEstimate, temperature_c: float = NAN) -> bytes:
    """The record of an estimate and of the temperature heard with it.

    It holds the UNIX time of the newest sample in ns, the index of the status, the interval's
    bounds and the QUANTITIES, NaN unless the status is `estimated`, and a CRC-32 of all that.
    """
    if estimate.status is EstimateStatus.ESTIMATED:
        names = ("low", "high", *QUANTITIES[:-1])
        numbers = [_number(getattr(estimate, name, None)) for name in names]
    else:
        numbers = [NAN] * (_NUMBERS - 1)
    status = STATUSES.index(estimate.status)
    body = _BODY.pack(time_ns, status, *numbers, temperature_c)
    return body + _CHECK.pack(zlib.crc32(body))


def _number(value: object) -> float:
    if isinstance(value, Interval):
        return value.value
    return float(value) if isinstance(value, int | float) else NAN


def good_length(content: bytes) -> int:
    """Bytes up to the first record that is torn or damaged."""
    for start in range(0, len(content) - RECORD_BYTES + 1, RECORD_BYTES):
        body = content[start : start + _BODY.size]
        (check,) = _CHECK.unpack_from(content, start + _BODY.size)
        if check != zlib.crc32(body):
            return start
    return len(content) // RECORD_BYTES * RECORD_BYTES


def rows_of(content: bytes | bytearray) -> Rows:
    """Records as rows, by time; of two of the same microsecond the later one counts."""
    records = np.frombuffer(bytes(content), _RECORD)
    time_us = records["time_ns"] // 1000
    backwards = time_us[::-1]
    _, last = np.unique(backwards, return_index=True)
    records = records[::-1][last]
    numbers = np.ascontiguousarray(records["numbers"].T.astype(np.float64))
    return single_rows(
        backwards[last] / 1e6,
        records["status"].astype(np.int64),
        numbers[0],
        numbers[1],
        numbers[2:],
    )
