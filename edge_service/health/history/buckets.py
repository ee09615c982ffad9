"""Rows of history as the answer to a question: one bucket per step."""

import math
from dataclasses import dataclass

import numpy as np

from ...messages.estimate import EstimateStatus
from ...messages.samples import Floats
from .rows import QUANTITIES, STATUSES, Rows


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
    counts, bounds = rows.count.T.tolist(), [_numbers(rows.low), _numbers(rows.high)]
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


def _numbers(values: Floats) -> list[float | None]:
    return [None if math.isnan(value) else value for value in values.tolist()]
