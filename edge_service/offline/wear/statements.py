"""Dates of crossing limits, as the trend of the service states them, and a straight line."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...health.trend.remaining_life import NS_PER_S, preload_trend
from ...messages.samples import Floats
from .stages import WearTest

LEVEL = 0.9
_S_PER_H = 3600.0
_DRAWS = 4000
_SEED = 20260131


@dataclass(frozen=True, slots=True)
class Date:
    """Time at which a limit is crossed, h from new, with its band; inf: no end within sight."""

    earliest_h: float
    likely_h: float
    latest_h: float


Dates = dict[float, Date]
"""Limit in percent of fresh -> its date; without an entry there is none yet."""


def trend_dates(seen: WearTest, limits: Sequence[float]) -> Dates:
    """Dates that the service would state of a screw of which it has seen so much.

    The readings come without an interval; their scatter tells it.
    """
    trend = preload_trend(
        seen.time_h * _S_PER_H,
        seen.percent,
        np.zeros_like(seen.percent),
        seen.distance_m,
        {f"{limit:g}": limit for limit in limits},
    )
    return {
        each.limit_percent: Date(
            _hours(each.earliest_ns), _hours(each.likely_ns), _hours(each.latest_ns)
        )
        for each in trend.crossings
        if each.likely_ns is not None
    }


def _hours(time_ns: int | None) -> float:
    return np.inf if time_ns is None else time_ns / (NS_PER_S * _S_PER_H)


def line_dates(seen: WearTest, limits: Sequence[float]) -> Dates:
    """Dates of a straight line over the hours through all readings: least squares, Student's t.

    Like the trend it has no date for a limit that it has passed, or that it may never reach.
    """
    if seen.time_h.size < 3:
        return {}
    level, slope = _line(seen.time_h - seen.time_h[-1], seen.percent)
    dates: Dates = {}
    for limit in limits:
        ways = np.where(slope < 0.0, (limit - level) / np.minimum(slope, -1e-12), np.inf)
        shares = [0.5 * (1.0 - LEVEL), 0.5, 0.5 * (1.0 + LEVEL)]
        low, middle, high = (seen.time_h[-1] + np.quantile(ways, shares, method="nearest")).tolist()
        if limit < np.median(level) and np.isfinite(middle):
            dates[limit] = Date(low, middle, high)
    return dates


def _line(time_h: Floats, percent: Floats) -> tuple[Floats, Floats]:
    """Draws of the level at time 0 and of the slope per hour, (n,) each."""
    design = np.column_stack([np.ones_like(time_h), time_h])
    q, r = np.linalg.qr(design)
    inverse = np.linalg.inv(r)
    middle = inverse @ (q.T @ percent)
    freedom = time_h.size - 2
    sigma = float(np.linalg.norm(percent - design @ middle)) / np.sqrt(freedom)
    rng = np.random.default_rng(_SEED)
    scale = sigma * np.sqrt(freedom / rng.chisquare(freedom, (_DRAWS, 1)))
    level, slope = (middle + scale * rng.standard_normal((_DRAWS, 2)) @ inverse.T).T
    return level, slope
