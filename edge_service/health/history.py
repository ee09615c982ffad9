"""Estimates of one axis over the last hours, in a ring of fixed size."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..messages.estimate import EstimateStatus, PreloadEstimate
from ..messages.samples import Floats
from .input_watch import NS_PER_S

_STATUSES = tuple(EstimateStatus)
_TIME, _VALUE, _LOW, _HIGH, _DRAG = range(5)
_Indices = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Spread:
    """Smallest, largest and mean value inside a bucket."""

    min: float
    max: float
    mean: float


@dataclass(frozen=True, slots=True)
class Bucket:
    """What a span of time held; numbers are None where there was no estimate.

    Attributes:
        start_s: UNIX time of the bucket's start, s.
        samples: rows inside.
        estimated: rows with a preload in percent.
        status: status of the newest row.
        preload_percent: spread of the values.
        low: lowest lower bound, percent.
        high: highest upper bound, percent.
        drag_torque_nm: spread of the drag torque.
    """

    start_s: float
    samples: int
    estimated: int
    status: EstimateStatus
    preload_percent: Spread | None
    low: float | None
    high: float | None
    drag_torque_nm: Spread | None


class PreloadHistory:
    """The last estimate of every step of time, for `span_s` of steps with estimates.

    Memory is bounded: 41 bytes per row, 3.5 MB for 24 h in steps of 1 s.
    """

    def __init__(self, span_s: float = 86400.0, step_s: float = 1.0) -> None:
        rows = max(1, round(span_s / step_s))
        self._step_s = step_s
        self._values: Floats = np.full((5, rows), np.nan)
        self._status: npt.NDArray[np.int8] = np.zeros(rows, np.int8)
        self._written = 0

    def append(self, time_ns: int, estimate: PreloadEstimate) -> None:
        """Keep an estimate; it replaces an earlier one of the same step."""
        time_s = time_ns / NS_PER_S
        if self._written == 0 or not self._same_step(time_s):
            self._written += 1
        row = (self._written - 1) % self._status.size
        self._values[:, row] = (time_s, *_numbers(estimate))
        self._status[row] = _STATUSES.index(estimate.status)

    def buckets(self, start_s: float, end_s: float, step_s: float) -> tuple[Bucket, ...]:
        """Buckets of [start_s, end_s) that hold rows, oldest first; empty ones are left out.

        Parameters
        ----------
        start_s, end_s : float
            UNIX times, s.
        step_s : float
            Length of a bucket, s.
        """
        time_s = self._values[_TIME]
        with np.errstate(invalid="ignore"):
            inside = np.flatnonzero((time_s >= start_s) & (time_s < end_s))
        if inside.size == 0:
            return ()
        rows = inside[np.argsort(time_s[inside], kind="stable")]
        index = np.floor((time_s[rows] - start_s) / step_s).astype(np.int64)
        number, first = np.unique(index, return_index=True)
        last = np.append(first[1:], rows.size) - 1
        spread = _Spreads(self._values[:, rows], first)
        return tuple(
            Bucket(
                start_s=start_s + int(number[k]) * step_s,
                samples=int(last[k] - first[k]) + 1,
                estimated=int(spread.count[_VALUE, k]),
                status=_STATUSES[self._status[rows[last[k]]]],
                preload_percent=spread.of(_VALUE, k),
                low=_or_none(spread.least[_LOW, k]),
                high=_or_none(spread.most[_HIGH, k]),
                drag_torque_nm=spread.of(_DRAG, k),
            )
            for k in range(number.size)
        )

    def _same_step(self, time_s: float) -> bool:
        last_s = self._values[_TIME, (self._written - 1) % self._status.size]
        return bool(time_s // self._step_s == last_s // self._step_s)


def _numbers(estimate: PreloadEstimate) -> tuple[float, float, float, float]:
    if estimate.status is not EstimateStatus.ESTIMATED:
        return (np.nan, np.nan, np.nan, np.nan)
    drag = estimate.drag_torque_nm
    return (
        _or_nan(estimate.preload_percent),
        _or_nan(estimate.low),
        _or_nan(estimate.high),
        np.nan if drag is None else drag.value,
    )


def _or_nan(number: float | None) -> float:
    return np.nan if number is None else number


def _or_none(number: float) -> float | None:
    return None if np.isnan(number) else float(number)


class _Spreads:
    """Spread of every column in every bucket; `first` (n_buckets,) is where buckets begin."""

    def __init__(self, values: Floats, first: _Indices) -> None:
        finite = np.isfinite(values)
        self.least = np.fmin.reduceat(values, first, axis=1)
        self.most = np.fmax.reduceat(values, first, axis=1)
        self.count = np.add.reduceat(finite.astype(np.int64), first, axis=1)
        self.total = np.add.reduceat(np.where(finite, values, 0.0), first, axis=1)

    def of(self, column: int, bucket: int) -> Spread | None:
        """Spread of one column in one bucket; None without a number."""
        count = self.count[column, bucket]
        if count == 0:
            return None
        return Spread(
            min=float(self.least[column, bucket]),
            max=float(self.most[column, bucket]),
            mean=float(self.total[column, bucket] / count),
        )
