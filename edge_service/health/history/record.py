"""One estimate as a record of fixed size with a checksum."""

import math
import struct
import zlib
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...messages.estimate import EstimateStatus, Interval, PreloadEstimate
from ...messages.samples import Floats
from .rows import QUANTITIES, STATUSES, Integers, Rows, single_rows

Content = bytes | bytearray | memoryview
NAN = float("nan")
_NUMBERS = 2 + len(QUANTITIES)
_BODY = struct.Struct(f"<qb{_NUMBERS}d")
_CHECK = struct.Struct("<I")
_STATUS_AT, _WINDOW_BYTES = 8, 4096
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


@dataclass(frozen=True, slots=True)
class Scan:
    """Contents of a log.

    Attributes:
        records: the good records, one after the other.
        damaged_bytes: what is no record.
        torn_bytes: an incomplete record at the end, as a crash leaves it.
    """

    records: bytes
    damaged_bytes: int
    torn_bytes: int


def scan(content: bytes) -> Scan:
    """Find the good records, wherever they begin: behind damage the next good one is looked for."""
    good, start, end = [], 0, 0
    while start <= len(content) - RECORD_BYTES:
        if _is_good(content, start):
            end = start + RECORD_BYTES
            good.append(content[start:end])
            start = end
        else:
            start = _next_good(content, start + 1)
    torn = len(content) - end if len(content) - end < RECORD_BYTES else 0
    records = b"".join(good)
    return Scan(records, len(content) - len(records) - torn, torn)


def _is_good(content: bytes, start: int) -> bool:
    (check,) = _CHECK.unpack_from(content, start + _BODY.size)
    return bool(check == zlib.crc32(content[start : start + _BODY.size]))


def _next_good(content: bytes, start: int) -> int:
    """Start of the next good record; the end of the content if there is none."""
    status = np.frombuffer(content, np.uint8)[_STATUS_AT:]
    last = len(content) - RECORD_BYTES
    while start <= last:
        window = status[start : min(start + _WINDOW_BYTES, last + 1)]
        for offset in np.flatnonzero(window < len(STATUSES)).tolist():
            if _is_good(content, start + offset):
                return start + int(offset)
        start += _WINDOW_BYTES
    return len(content)


def steps_of(content: Content, step_s: float) -> Floats:
    """UNIX times of the beginnings of the steps that hold records, s, in order."""
    time_s = _time_us(np.frombuffer(content, _RECORD)) / 1e6
    steps: Floats = np.unique(np.floor(time_s / step_s)) * step_s
    return steps


def _time_us(records: npt.NDArray[np.void]) -> Integers:
    times: Integers = records["time_ns"] // 1000
    return times


def rows_of(content: Content, start_s: float = -math.inf, end_s: float = math.inf) -> Rows:
    """Records of [start_s, end_s) as rows, by time; of two of one microsecond the later counts."""
    records = np.frombuffer(content, _RECORD)
    time_s = _time_us(records) / 1e6
    records = records[(time_s >= start_s) & (time_s < end_s)]
    backwards = _time_us(records)[::-1]
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
