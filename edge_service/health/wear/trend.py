"""Trend and remaining life of an axis, from the history of its preload."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...messages.interval import Interval
from ...messages.samples import Floats
from ...messages.stored import StoredFloats
from ...messages.trend import Crossing, Trend, TrendStatus
from ..inputs import NS_PER_S
from ..statements import span
from .wear_laws import WearProjection, project_wear

_MOST_STEPS = 400
MOST_POINTS = 64
"""Of the trend, so that its work stays small."""
_COLUMNS = 5
_LONGEST_STEP_S = 1e9
_WIDE = 2.0
"""Estimates with intervals wider than this many times the middle one only begin to know."""
CERTAIN = 0.95
"""Probability of a fall (or rise) from which it is called one, and on each side of a band."""
_YOUNG_S, _CERTAIN_YOUNG = 86400.0, 0.98
"""Less than a day is looked at hundreds of times, and some looks err."""
_HORIZON = 4.0
"""A limit that is likely further away than this many times the history's length has no date."""
_OPEN = 20.0
"""A band whose end is further away than this many times the history's length is open."""
_ENDS = 0.1
"""Share of a history whose mean stands for its beginning, or its end."""
_FEWEST_STILL, _SETTLES = 4, 0.05  # points since a fall, and share of it that takes its time
_STILL = 0.2  # rate, of that before, from which down a fall has ended
_ANEW_S = 120.0
"""Assumption: within so long an estimator may err anew, as far as a stand is concerned."""
_OVER_NS, _OVER_SHARE = 60 * NS_PER_S, 0.02
"""Age of the newest estimate from which on a trend is told as past: this, and of its length."""
_SENTENCES = {
    TrendStatus.FALLING: "The preload is falling.",
    TrendStatus.RISING: "The preload is rising, which wear cannot do: something else has changed.",
    TrendStatus.STEADY: "No clear trend.",
    TrendStatus.FELL: "The preload fell by {fall:.3g} % of fresh from {since} to {until}.",
}


@dataclass(frozen=True, slots=True, eq=False)
class PreloadSteps:
    step_s: float  # length of a step, s
    # step number, count, preload (percent), half width (percent), distance (m), (n, 5)
    rows: StoredFloats


class PreloadHistory:
    """Means of preload over equal steps of time, 1 s at first; twice where there are too many."""

    def __init__(self) -> None:
        self._step_s = 1.0
        self._rows: list[list[float]] = []  # step number, count, value, half width, distance

    def add(self, time_s: float, percent: float, half_width: float, distance_m: float) -> None:
        """Take an estimate in.

        Args:
            time_s: UNIX time, s; what lies behind it ends there, should it end later.
            percent, half_width: Preload and half the width of its 95 % interval, percent.
            distance_m: Way of the table since the part came into use, m.
        """
        step = float(time_s // self._step_s)
        if self._rows and step <= self._rows[-1][0] - 1.0:
            self.move((step - self._rows[-1][0]) * self._step_s)  # nobody told of the step
        if not self._rows or step > self._rows[-1][0]:
            self._rows.append([step, 0.0, 0.0, 0.0, 0.0])
        row = self._rows[-1]
        row[1] += 1.0
        for column, value in ((2, percent), (3, half_width), (4, distance_m)):
            row[column] += (value - row[column]) / row[1]
        if len(self._rows) > _MOST_STEPS:
            rows = self._table()
            rows[:, 0] //= 2.0
            self._rows = _means(rows, rows[:, 0]).tolist()
            self._step_s *= 2.0

    def move(self, step_s: float) -> None:
        """The clock was set by a step, s: the distances in time stay."""
        for row in self._rows:
            row[0] += step_s / self._step_s

    def newest(self) -> float | None:
        """Preload of the newest step, percent; None if there is none."""
        return self._rows[-1][2] if self._rows else None

    def clear(self) -> None:
        """Begin anew."""
        self._step_s = 1.0
        self._rows = []

    def points(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Times (s), preloads (percent), half widths (percent), distances (m), each (n,).

        The newest step is left out while it is less than half full: it would be noisier.
        """
        rows = self._table()
        if len(rows) > 2 and rows[-1, 1] < 0.5 * np.median(rows[:, 1]):
            rows = rows[:-1]
        part = rows[:, 0] - rows[:1, 0]
        while np.unique(part).size > MOST_POINTS:
            part //= 2.0
        rows[:, 0] = (rows[:, 0] + 0.5) * self._step_s
        time_s, _, percent, half_width, distance_m = _means(rows, part).T
        return time_s, percent, half_width, distance_m

    def snapshot(self) -> PreloadSteps:
        """State that outlives the process."""
        return PreloadSteps(self._step_s, self._table())

    def restore(self, snapshot: PreloadSteps) -> None:
        """Go on from a snapshot. Raises ValueError."""
        rows = snapshot.rows.reshape(-1, _COLUMNS)
        if not 0.0 < snapshot.step_s < _LONGEST_STEP_S:
            raise ValueError(f"a wear series with steps of {snapshot.step_s} s")
        if not np.all(np.isfinite(rows)) or np.any(np.diff(rows[:, 0]) <= 0):
            raise ValueError("a wear series out of order")
        self._step_s, self._rows = snapshot.step_s, rows.tolist()

    def _table(self) -> Floats:
        return np.array(self._rows, np.float64).reshape(-1, _COLUMNS)


def _means(rows: Floats, part: Floats) -> Floats:
    """Counts and means, weighted by the counts, of the rows in each part, rising, (n, 5)."""
    first = np.flatnonzero(np.diff(part, prepend=-math.inf))
    count = np.add.reduceat(rows[:, 1], first)
    means = np.add.reduceat(rows * rows[:, 1:2], first, axis=0) / count[:, None]
    means[:, 1] = count
    return np.asarray(means)


def sure_points(*points: Floats) -> tuple[Floats, ...]:
    """Times, preloads, half widths and distances, (n,) each, without those that begin to know."""
    half_width_percent = points[2]
    if not half_width_percent.size:
        return points
    sure = half_width_percent <= _WIDE * np.median(half_width_percent)
    return tuple(each[sure] for each in points)


def preload_trend(
    time_s: Floats,
    percent: Floats,
    half_width_percent: Floats,
    distance_m: Floats,
    limits_percent: Mapping[str, float],
    fresh_percent: float | None = None,
) -> Trend:
    """The trend of a history, for people.

    Args:
        time_s, percent, half_width_percent, distance_m: The history since the part came into use,
            (n,).
        limits_percent: Limits by name, percent of the dynamic load rating.
        fresh_percent: Preload of the fresh screw, percent of the same.
    """
    time_s, percent, half_width_percent, distance_m = sure_points(
        time_s, percent, half_width_percent, distance_m
    )
    since_ns = round(float(time_s[0]) * NS_PER_S) if time_s.size else None
    future = project_wear(time_s, percent, half_width_percent, distance_m)
    if future is None:
        reason = "Too little history for a trend."
        return Trend(status=TrendStatus.TOO_EARLY, reason=reason, since_time_ns=since_ns)
    now_s, falls = float(time_s[-1]), float(np.mean(future.slope < 0.0))
    span_s = now_s - float(time_s[0])
    worked = distance_m if future.basis == "distance" else time_s
    until_s, status, ended = now_s, TrendStatus.STEADY, None
    certain = _CERTAIN_YOUNG if span_s < _YOUNG_S else CERTAIN
    low, middle, high = _quantiles(future.slope * future.age_per_s * 3600.0, certain)
    rate = Interval(value=middle, low=low, high=high)
    if falls >= CERTAIN:
        ended = end_of_fall(time_s, percent, float(np.median(half_width_percent)), worked)
        until_s, rate = ended or (until_s, rate)
    if ended or falls >= certain:
        status = TrendStatus.FALLING
    elif np.mean(future.slope > 0.0) >= certain:
        status = TrendStatus.RISING
    ahead = limits_percent.items() if status is TrendStatus.FALLING else ()
    crossings = (_crossing(each, future, now_s, span_s, certain) for each in ahead)
    ends = max(round(_ENDS * percent.size), 1)
    change = float(np.mean(percent[-ends:]) - np.mean(percent[:ends]))
    trend = Trend(
        status=status,
        reason=_SENTENCES[status],
        since_time_ns=since_ns,
        until_time_ns=round(until_s * NS_PER_S),
        basis=future.basis,
        level=2.0 * certain - 1.0,
        rate_percent_per_h=rate,
        rate_fresh_percent_per_h=rate.times(100.0 / fresh_percent) if fresh_percent else None,
        change_fresh_percent=100.0 / fresh_percent * change if fresh_percent else None,
        crossings=tuple(filter(None, crossings)),
    )
    return trend if until_s == now_s else _as_past(trend)


def end_of_fall(
    time_s: Floats, percent: Floats, error_percent: float, worked: Floats
) -> tuple[float, Interval] | None:
    """Time at which a fall ended, s, and the rate since, percent per hour; None while it lasts.

    It has ended where the newest part of the work, for a minute at least, wears by less than a
    fifth of what the steepest part before did that took half as long, and no more than an error of
    the estimator explains, while that fell by more and would fall by more again.

    Args:
        error_percent: Half the width of an estimate's 95 % interval.
        worked: what the wear is counted against, time in s or way in m, (n,).
    """
    for first in range(time_s.size - _FEWEST_STILL, 0, -1):
        still_s, way = (float(each[-1] - each[first]) for each in (time_s, worked))
        if still_s * NS_PER_S <= _OVER_NS or way == 0.0:
            continue
        slope, sigma = _line(worked[first:], percent[first:])
        fell = percent[:first] - percent[first:].mean()
        took = np.maximum(worked[first] - worked[:first], 0.5 * way)
        errors = _own(error_percent, np.abs(time_s - time_s[first]))
        before = -float(np.max(fell / took, where=fell > errors[:first], initial=0.0))
        own, moved = float(errors[-1]), slope * way
        if -before * way > own > max(-moved, 0.0) and slope - sigma > _STILL * before:
            wide = 3.0 * sigma * way + own
            rate = Interval(value=moved, low=moved - wide, high=moved + wide)
            least = percent[first:].max() + _SETTLES * float(np.ptp(percent))
            return float(time_s[percent <= least][0]), rate.times(3600.0 / still_s)
    return None


def _own(error_percent: float, time_s: Floats) -> Floats:
    """Change within times that may be the estimator's own, percent."""
    return np.asarray(2.0 * error_percent * np.sqrt(1.0 - np.exp(-time_s / _ANEW_S)))


def _line(worked: Floats, percent: Floats) -> tuple[float, float]:
    line, covariance = np.polyfit(worked - worked.mean(), percent, 1, cov=True)
    return float(line[0]), math.sqrt(covariance[0, 0])


def as_of(trend: Trend, now_ns: int) -> Trend:
    """Trend as told now: a fall whose newest estimate is old was one, and no date lies behind."""
    since_ns, until_ns = trend.since_time_ns, trend.until_time_ns
    if trend.status is not TrendStatus.FALLING or since_ns is None or until_ns is None:
        return trend
    if now_ns - until_ns <= max(_OVER_NS, _OVER_SHARE * (until_ns - since_ns)):
        ahead = tuple(_from_now(each, now_ns) for each in trend.crossings)
        return trend.model_copy(update={"crossings": ahead})
    unknown = {"rate_percent_per_h": None, "rate_fresh_percent_per_h": None}
    return _as_past(trend).model_copy(update=unknown)


def _as_past(trend: Trend) -> Trend:
    change = trend.change_fresh_percent or 0.0
    status = TrendStatus.FELL if change < 0.0 else TrendStatus.STEADY
    words = {"fall": -change, **span(trend.since_time_ns or 0, trend.until_time_ns or 0)}
    told = {"status": status, "reason": _SENTENCES[status].format(**words), "crossings": ()}
    return trend.model_copy(update=told)


def _from_now(crossing: Crossing, now_ns: int) -> Crossing:
    times = {name: getattr(crossing, name) for name in ("earliest_ns", "likely_ns")}
    update = {name: each and max(each, now_ns) for name, each in times.items()}
    is_ahead = crossing.latest_ns is not None and crossing.latest_ns > now_ns
    return crossing.model_copy(update=update | ({} if is_ahead else {"latest_ns": None}))


def _quantiles(draws: Floats, certain: float) -> tuple[float, float, float]:
    low, middle, high = np.quantile(draws, [1.0 - certain, 0.5, certain], method="nearest").tolist()
    return low, middle, high


def _crossing(
    limit: tuple[str, float], future: WearProjection, now_s: float, span_s: float, certain: float
) -> Crossing | None:
    """Dates of a limit; None where it lies behind, or further ahead than can be told."""
    name, limit_percent = limit
    if np.mean(future.level_percent < limit_percent) >= CERTAIN:
        return None
    earliest_s, likely_s, latest_s = _quantiles(future.seconds_to(limit_percent), certain)
    if likely_s > _HORIZON * span_s:
        return None
    return Crossing(
        limit=name,
        limit_percent=limit_percent,
        earliest_ns=round((now_s + earliest_s) * NS_PER_S),
        likely_ns=round((now_s + likely_s) * NS_PER_S),
        latest_ns=round((now_s + latest_s) * NS_PER_S) if latest_s <= _OPEN * span_s else None,
    )
