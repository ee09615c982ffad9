"""Rows of history: any span of time as counts, extremes and means of a few quantities."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...messages.estimate import EstimateStatus
from ...messages.samples import Floats

STATUSES = tuple(EstimateStatus)
QUANTITIES = ("preload_percent", "drag_torque_nm", "nis", "stiffness_n_per_m", "temperature_c")
Integers = npt.NDArray[np.int64]


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


def is_plausible(rows: Rows) -> bool:
    """Tell whether rows could have been written: order, counts and extremes agree."""
    some = rows.count > 0
    least, mean, most = rows.least[some], rows.mean[some], rows.most[some]
    slack = 1e-9 * np.maximum(np.abs(least), np.abs(most))
    return bool(
        np.all(np.isfinite(rows.time_s))
        and np.all(np.diff(rows.time_s) > 0.0)
        and np.all(rows.samples >= 1)
        and np.all((rows.count >= 0) & (rows.count <= rows.samples))
        and np.all(np.isfinite(least) & np.isfinite(most))
        and np.all((least <= mean + slack) & (mean <= most + slack))
        and np.all(np.isnan(rows.mean[~some]))
        and not np.any(rows.low > rows.high)
    )
