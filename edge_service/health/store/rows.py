"""Rows of history: any span of time as counts, extremes and means; packed, and as buckets."""

import math
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic import Field

from ...messages.estimate import EstimateStatus, PreloadEstimate
from ...messages.interval import Frozen, Interval, TimeNs

STATUSES = tuple(EstimateStatus)
QUANTITIES = ("preload_percent", "drag_torque_nm", "nis", "stiffness_n_per_m", "temperature_c")
NAN = float("nan")
_N = len(QUANTITIES)
ROW = np.dtype(
    [
        *(("time_us", "<i8"), ("status", "i1"), ("bounds", "<f8", (2,)), ("samples", "<i8")),
        *(("count", "<i8", (_N,)), ("values", "<f8", (3, _N))),
    ]
)
"""A span of time: its start, the status of the newest of its `samples` estimates (an index into
STATUSES), lowest and highest bound, and of each quantity the number, least, mean and most of its
values. NaN stands where there is none; a single estimate is a span with one value."""
Rows = npt.NDArray[Any]
"""Records ROW, (n,)."""
NO_ROWS: Rows = np.zeros(0, ROW)


def record_of(time_ns: int, estimate: PreloadEstimate, temperature_c: float) -> bytes:
    """Row of an estimate and of the temperature heard with it, as bytes.

    Its numbers are NaN unless the status is `estimated`.
    """
    numbers = [NAN] * (1 + _N)
    if estimate.status is EstimateStatus.ESTIMATED:
        for place, name in enumerate(("low", "high", *QUANTITIES[:-1])):
            value = getattr(estimate, name, None)
            value = value.value if isinstance(value, Interval) else value
            numbers[place] = NAN if value is None else float(value)
    row = np.zeros((), ROW)
    row["time_us"], row["status"] = time_ns // 1000, STATUSES.index(estimate.status)
    row["bounds"], row["values"] = numbers[:2], [*numbers[2:], temperature_c]
    row["samples"], row["count"] = 1, np.isfinite(row["values"][0])
    return row.tobytes()


def rows_of(content: bytes) -> Rows:
    """Rows of bytes, by time."""
    return joined(np.frombuffer(content, ROW))


def packed(rows: Rows) -> bytes:
    """Rows compressed, the bytes of one place in all of them together."""
    places = np.ascontiguousarray(rows).view(np.uint8).reshape(rows.size, -1)
    return zlib.compress(np.ascontiguousarray(places.T).tobytes(), 1)


def unpacked(content: bytes) -> Rows:
    """Rows of `packed`. Raises ValueError, zlib.error if the content is none."""
    places = np.frombuffer(zlib.decompress(content), np.uint8)
    return np.frombuffer(np.ascontiguousarray(places.reshape(ROW.itemsize, -1).T).tobytes(), ROW)


def between(rows: Rows, start_s: float, end_s: float) -> Rows:
    """Rows whose span begins in [start_s, end_s)."""
    time_s = rows["time_us"] / 1e6
    return rows[(time_s >= start_s) & (time_s < end_s)]


def joined(*parts: Rows) -> Rows:
    """All rows of several tables, by time."""
    rows = np.concatenate([NO_ROWS, *parts])
    return rows[np.argsort(rows["time_us"], kind="stable")]


def aggregate(rows: Rows, step_s: float, start_s: float = 0.0) -> Rows:
    """One row per step that holds rows; steps are counted from `start_s`, empty ones left out."""
    if rows.size == 0:
        return rows
    step = np.floor((rows["time_us"] / 1e6 - start_s) / step_s + 1e-9).astype(np.int64)
    number, first = np.unique(step, return_index=True)
    made = np.zeros(number.size, ROW)
    made["time_us"] = np.round((start_s + number * step_s) * 1e6)
    made["status"] = rows["status"][np.append(first[1:], rows.size) - 1]
    made["samples"] = np.add.reduceat(rows["samples"], first)
    made["count"] = np.add.reduceat(rows["count"], first)
    made["bounds"][:, 0] = np.fmin.reduceat(rows["bounds"][:, 0], first)
    made["bounds"][:, 1] = np.fmax.reduceat(rows["bounds"][:, 1], first)
    least, mean, most = np.moveaxis(rows["values"], 1, 0)
    weighted = np.where(rows["count"] > 0, rows["count"] * mean, 0.0)
    made["values"][:, 0] = np.fmin.reduceat(least, first)
    with np.errstate(invalid="ignore"):  # 0 / 0 is the NaN of a step without a value
        made["values"][:, 1] = np.add.reduceat(weighted, first) / made["count"]
    made["values"][:, 2] = np.fmax.reduceat(most, first)
    return made


def filled(tiers: Sequence[Rows], steps_s: Sequence[float]) -> Rows:
    """Rows of the first tier, with those of the next ones, coarser, in its holes, by time."""
    rows = tiers[0]
    for coarser, step_s in zip(tiers[1:], steps_s[1:], strict=True):
        times_s = np.append(rows["time_us"] / 1e6, np.inf)
        starts_s = coarser["time_us"] / 1e6
        following_s = times_s[np.searchsorted(times_s[:-1], starts_s)]
        rows = joined(coarser[following_s >= starts_s + step_s], rows)
    return rows


class Spread(Frozen):
    """Smallest, largest and mean value inside a bucket."""

    min: float
    max: float
    mean: float


class Bucket(Frozen):
    """Summary of a span of time; numbers are None where there was no estimate.

    Attributes:
        start_ns: UNIX time of the bucket's start, ns; `time` in JSON.
        samples: estimates inside.
        estimated: those with a preload in percent.
        status: status of the newest one.
        low: lowest lower bound, percent.
        high: highest upper bound, percent.
        preload_percent, ...: spread of each of QUANTITIES; None without values.
    """

    start_ns: TimeNs = Field(alias="time")
    samples: int
    estimated: int
    status: EstimateStatus
    low: float | None
    high: float | None
    preload_percent: Spread | None
    drag_torque_nm: Spread | None
    nis: Spread | None
    stiffness_n_per_m: Spread | None
    temperature_c: Spread | None


def buckets(rows: Rows) -> tuple[Bucket, ...]:
    found = []
    for time_us, status, bounds, samples, counts, values in rows.tolist():
        low, high = (None if math.isnan(bound) else bound for bound in bounds)
        spreads = {
            name: Spread(min=least, max=most, mean=mean) if count else None
            for name, count, least, mean, most in zip(QUANTITIES, counts, *values, strict=True)
        }
        members = {"start_ns": time_us * 1000, "samples": samples, "estimated": counts[0]}
        members |= {"status": STATUSES[status], "low": low, "high": high}
        found.append(Bucket(**members, **spreads))
    return tuple(found)
