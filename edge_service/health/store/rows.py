"""Rows of history: any span of time as counts, extremes and means; packed, and as buckets."""

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...messages.estimate import EstimateStatus, Interval, PreloadEstimate
from ...messages.samples import Floats

STATUSES = tuple(EstimateStatus)
QUANTITIES = ("preload_percent", "drag_torque_nm", "nis", "stiffness_n_per_m", "temperature_c")
Integers = npt.NDArray[np.int64]
NAN = float("nan")
_N = len(QUANTITIES)
SINGLE = np.dtype(
    [("time_us", "<i8"), ("status", "i1"), ("bounds", "<f8", (2,)), ("values", "<f8", (_N,))]
)
"""One estimate."""
SPAN = np.dtype(
    [
        *(("time_us", "<i8"), ("status", "i1"), ("bounds", "<f8", (2,)), ("samples", "<i8")),
        *(("count", "<i8", (_N,)), ("values", "<f8", (3, _N))),
    ]
)
"""A minute or an hour; its values are least, mean and most."""


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """n spans of time; a single estimate is a span that holds one value.

    Attributes:
        time_s: UNIX time of the span's start, s, (n,).
        samples: estimates inside, with or without a number, (n,).
        status: index into STATUSES of the newest one, (n,).
        low, high: lowest lower and highest upper bound of the preload, percent, (n,); NaN: none.
        count: values of each of QUANTITIES, (n_quantities, n).
        least, mean, most: of those values, (n_quantities, n); NaN where there is none.
    """

    time_s: Floats
    samples: Integers
    status: Integers
    low: Floats
    high: Floats
    count: Integers
    least: Floats
    mean: Floats
    most: Floats

    def __len__(self) -> int:
        return int(self.time_s.size)

    def take(self, index: npt.NDArray[np.intp] | npt.NDArray[np.bool_]) -> "Rows":
        """The rows at `index`, an index or a mask along time."""
        return Rows(*(getattr(self, name)[..., index] for name in Rows.__slots__))

    def between(self, start_s: float, end_s: float) -> "Rows":
        """Rows whose span begins in [start_s, end_s)."""
        return self.take((self.time_s >= start_s) & (self.time_s < end_s))


def single_rows(
    time_s: Floats, status: Integers, low: Floats, high: Floats, values: Floats
) -> Rows:
    """One row per estimate; `values` is (n_quantities, n) with NaN for what is missing."""
    return Rows(
        time_s=time_s,
        samples=np.ones(time_s.size, np.int64),
        status=status,
        low=low,
        high=high,
        count=np.isfinite(values).astype(np.int64),
        least=values,
        mean=values,
        most=values,
    )


def record_of(time_ns: int, estimate: PreloadEstimate, temperature_c: float) -> bytes:
    """Record SINGLE of an estimate and of the temperature heard with it.

    Its numbers are NaN unless the status is `estimated`.
    """
    numbers = [NAN] * (1 + _N)
    if estimate.status is EstimateStatus.ESTIMATED:
        names = ("low", "high", *QUANTITIES[:-1])
        numbers = [_number(getattr(estimate, name, None)) for name in names]
    record = np.zeros((), SINGLE)
    record["time_us"], record["status"] = time_ns // 1000, STATUSES.index(estimate.status)
    record["bounds"], record["values"] = numbers[:2], [*numbers[2:], temperature_c]
    return record.tobytes()


def _number(value: object) -> float:
    if isinstance(value, Interval):
        return value.value
    return float(value) if isinstance(value, int | float) else NAN


def rows_of(content: bytes) -> Rows:
    """Rows of records SINGLE, by time; of two of one microsecond the later counts."""
    records = np.frombuffer(content, SINGLE)[::-1]
    time_us, last = np.unique(records["time_us"], return_index=True)
    records = records[last]
    status, bounds = records["status"].astype(np.int64), records["bounds"].T
    values = np.ascontiguousarray(records["values"].T)
    return single_rows(time_us / 1e6, status, bounds[0].copy(), bounds[1].copy(), values)


def packed(rows: Rows, dtype: npt.DTypeLike) -> bytes:
    """Rows as compressed records SINGLE or SPAN, the bytes of one place in all of them together."""
    records = np.zeros(len(rows), dtype)
    records["time_us"] = np.round(rows.time_s * 1e6)
    records["status"] = rows.status
    records["bounds"] = np.stack([rows.low, rows.high], axis=-1)
    if records.dtype == SINGLE:
        records["values"] = rows.mean.T
    else:
        records["samples"], records["count"] = rows.samples, rows.count.T
        records["values"] = np.stack([rows.least, rows.mean, rows.most]).transpose(2, 0, 1)
    places = records.view(np.uint8).reshape(len(rows), records.dtype.itemsize)
    return zlib.compress(np.ascontiguousarray(places.T).tobytes(), 1)


def unpacked(content: bytes, dtype: npt.DTypeLike) -> Rows:
    """Rows of `packed`. Raises ValueError, zlib.error if the content is none."""
    size = np.dtype(dtype).itemsize
    places = np.frombuffer(zlib.decompress(content), np.uint8).reshape(size, -1)
    if dtype == SINGLE:
        return rows_of(np.ascontiguousarray(places.T).tobytes())
    records = np.frombuffer(np.ascontiguousarray(places.T).tobytes(), dtype)
    least, mean, most = np.ascontiguousarray(records["values"].transpose(1, 2, 0))
    return Rows(
        time_s=records["time_us"] / 1e6,
        samples=records["samples"].astype(np.int64),
        status=records["status"].astype(np.int64),
        low=records["bounds"][:, 0].copy(),
        high=records["bounds"][:, 1].copy(),
        count=np.ascontiguousarray(records["count"].T),
        least=least,
        mean=mean,
        most=most,
    )


def no_rows() -> Rows:
    """Rows of no span."""
    none = np.empty(0)
    return single_rows(none, np.empty(0, np.int64), none, none, np.empty((len(QUANTITIES), 0)))


def joined(parts: Sequence[Rows]) -> Rows:
    """All rows of several tables."""
    if len(parts) == 1:
        return parts[0]
    if not parts:
        return no_rows()
    return Rows(
        *(
            np.concatenate([getattr(part, name) for part in parts], axis=-1)
            for name in Rows.__slots__
        )
    )


def in_order(rows: Rows) -> Rows:
    """The rows by time."""
    if np.all(rows.time_s[1:] >= rows.time_s[:-1]):
        return rows
    return rows.take(np.argsort(rows.time_s, kind="stable"))


def aggregate(rows: Rows, start_s: float, step_s: float) -> Rows:
    """One row per step that holds rows; steps are counted from `start_s`, empty ones left out."""
    if len(rows) == 0:
        return rows
    rows = in_order(rows)
    step = np.floor((rows.time_s - start_s) / step_s + 1e-9).astype(np.int64)
    number, first = np.unique(step, return_index=True)
    last = np.append(first[1:], len(rows)) - 1
    count = np.add.reduceat(rows.count, first, axis=1)
    weighted = np.where(rows.count > 0, rows.count * rows.mean, 0.0)
    with np.errstate(invalid="ignore"):  # 0 / 0 is the NaN of a step without a value
        mean = np.add.reduceat(weighted, first, axis=1) / count
    return Rows(
        time_s=start_s + number.astype(np.float64) * step_s,
        samples=np.add.reduceat(rows.samples, first),
        status=rows.status[last],
        low=np.fmin.reduceat(rows.low, first),
        high=np.fmax.reduceat(rows.high, first),
        count=count,
        least=np.fmin.reduceat(rows.least, first, axis=1),
        mean=mean,
        most=np.fmax.reduceat(rows.most, first, axis=1),
    )


def filled(tiers: Sequence[Rows], steps_s: Sequence[float]) -> Rows:
    """Rows of the first tier, with those of the next ones, coarser, in its holes, by time."""
    rows = in_order(tiers[0])
    for coarser, step_s in zip(tiers[1:], steps_s[1:], strict=True):
        following = np.append(rows.time_s, np.inf)[np.searchsorted(rows.time_s, coarser.time_s)]
        missing = coarser.take(following >= coarser.time_s + step_s)
        rows = in_order(joined([missing, rows]))
    return rows


@dataclass(frozen=True, slots=True)
class Spread:
    """Smallest, largest and mean value inside a bucket."""

    min: float
    max: float
    mean: float


@dataclass(frozen=True, slots=True)
class Bucket:
    """Summary of a span of time; numbers are None where there was no estimate.

    Attributes:
        start_s: UNIX time of the bucket's start, s.
        samples: estimates inside.
        estimated: those with a preload in percent.
        status: status of the newest one.
        low: lowest lower bound, percent.
        high: highest upper bound, percent.
        preload_percent, ...: spread of each of QUANTITIES; None without values.
    """

    start_s: float
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
    """One bucket per row."""
    counts, bounds = rows.count.T.tolist(), [_or_none(rows.low), _or_none(rows.high)]
    spreads = np.stack([rows.least, rows.most, rows.mean], axis=-1).transpose(1, 0, 2).tolist()
    return tuple(
        Bucket(
            start_s=start_s,
            samples=samples,
            estimated=count[0],
            status=STATUSES[status],
            low=low,
            high=high,
            **{
                name: Spread(*spread) if number else None
                for name, number, spread in zip(QUANTITIES, count, values, strict=True)
            },
        )
        for start_s, samples, status, low, high, count, values in zip(
            rows.time_s.tolist(),
            rows.samples.tolist(),
            rows.status.tolist(),
            *bounds,
            counts,
            spreads,
            strict=True,
        )
    )


def _or_none(values: Floats) -> list[float | None]:
    return [None if math.isnan(value) else value for value in values.tolist()]
