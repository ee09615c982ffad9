"""Trend and remaining life of an axis, from the history of its preload."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...messages.interval import Interval
from ...messages.samples import Floats
from ...messages.stored import StoredFloats
from ...messages.trend import Crossing, Trend, TrendStatus
from ..headline import span
from ..inputs import NS_PER_S
from .wear_laws import TrendDraws, draw_trends

MOST_POINTS = 400
_COLUMNS = 5
_LONGEST_STEP_S = 1e9
_SIGMA_OF_HALF_WIDTH = 1.0 / 1.96
_SEED = 20260131
_BLOCKS = 8
_SLOWEST_M_S = 1e-9
_WAY_WEARS = float(np.log(4.0))
"""Log odds of wear by the way against wear by the hour, before anything is seen (convention)."""
MEMORY_S = 600.0
"""Assumption: an estimator that erred errs anew after so long; a faster change may be its own."""
_WIDE = 2.0
"""Estimates with intervals wider than this many times the middle one only begin to know."""
LEVEL = 0.9
"""Of every interval and band."""
CERTAIN = 0.95
"""Probability of a fall (or rise) from which it is called one."""
_HORIZON = 20.0
"""A limit further away than this many times the history's length has no date."""
_ENDS = 0.1
"""Share of a history whose mean stands for its beginning, or its end."""
_OVER_NS, _OVER_SHARE = 60 * NS_PER_S, 0.02
"""Age of the newest estimate from which on a trend is told as past: this, and of its length."""
_SENTENCES = {
    TrendStatus.FALLING: "The preload is falling.",
    TrendStatus.RISING: "The preload is rising, which wear cannot do: something else has changed.",
    TrendStatus.STEADY: "No clear trend.",
}


@dataclass(frozen=True, slots=True, eq=False)
class PreloadSteps:
    """Steps of a preload history.

    Attributes:
        step_s: length of a step, s.
        rows: step number, count, preload (percent), half width (percent), distance (m), (n, 5).
    """

    step_s: float
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
        if len(self._rows) > MOST_POINTS:
            rows = self._table()
            rows[:, 0] //= 2.0
            self._rows = _joined(rows)
            self._step_s *= 2.0

    def move(self, step_s: float, since_s: float = -math.inf) -> None:
        """The clock was set by a step, s: the distances in time stay.

        Args:
            since_s: what is older stays where it is; what comes to lie on it is joined to it.
        """
        rows = self._table()
        rows[(rows[:, 0] + 1.0) * self._step_s > since_s, 0] += step_s / self._step_s
        rows[:, 0] = np.maximum.accumulate(rows[:, 0])
        self._rows = _joined(rows)

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
        return (rows[:, 0] + 0.5) * self._step_s, rows[:, 2], rows[:, 3], rows[:, 4]

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


def _joined(rows: Floats) -> list[list[float]]:
    """Rows by step, those of one step as one: the means of their counts."""
    number, first = np.unique(rows[:, 0], return_index=True)
    if not rows.size:
        return []
    count = np.add.reduceat(rows[:, 1], first)
    means = np.add.reduceat(rows[:, 2:] * rows[:, 1:2], first, axis=0) / count[:, None]
    joined: list[list[float]] = np.column_stack([number, count, means]).tolist()
    return joined


@dataclass(frozen=True, slots=True)
class WearProjection:
    """Draws of a trend, with what turns its s into time.

    Attributes:
        draws: equally likely courses.
        basis: `time` or `distance`.
        s_per_s: future progress of s per second of each draw, (n,).
    """

    draws: TrendDraws
    basis: str
    s_per_s: Floats

    def seconds_to(self, limit_percent: float) -> Floats:
        """Time that each course needs to reach the limit, s, (n,); inf if it never does."""
        return self.draws.way_to(limit_percent) / self.s_per_s


def project_wear(
    time_s: Floats, distance_m: Floats, percent: Floats, sigma_level: float
) -> WearProjection | None:
    """Wear against distance, unless time explains it clearly better; None if too early.

    Args:
        time_s, distance_m, percent: The history; the distance may be NaN or not grow, then time
            alone counts, (n,).
        sigma_level: Standard deviation of an error common to all points, percent.
    """
    rng = np.random.default_rng(_SEED)
    by_time = draw_trends(time_s, percent, sigma_level, rng, MEMORY_S)
    if by_time is None:
        return None
    if np.all(np.isfinite(distance_m)) and np.all(np.diff(distance_m) >= 0.0):
        memory_m = MEMORY_S * float(np.ptp(distance_m)) / float(np.ptp(time_s))
        by_distance = draw_trends(distance_m, percent, sigma_level, rng, memory_m)
        if by_distance is not None and by_distance.evidence + _WAY_WEARS > by_time.evidence:
            speed_m_s = _future_speed(time_s, distance_m, by_distance.slope.size, rng)
            return WearProjection(by_distance, "distance", speed_m_s)
    return WearProjection(by_time, "time", np.ones(by_time.slope.size))


def _future_speed(
    time_s: Floats, distance_m: Floats, count: int, rng: np.random.Generator
) -> Floats:
    """Distance per second in future, m/s: that of the newest quarter, and as changeable as ever."""
    index = np.unique(np.linspace(0, time_s.size - 1, _BLOCKS + 1).round().astype(int))
    speed = np.maximum(np.diff(distance_m[index]) / np.diff(time_s[index]), _SLOWEST_M_S)
    recent = float(speed[-max(speed.size // 4, 1) :].mean())
    change = np.diff(np.log(speed))
    spread = float(np.sqrt(np.mean(change**2))) if change.size else 0.0
    speeds_m_s: Floats = recent * np.exp(spread * rng.standard_normal(count))
    return speeds_m_s


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
    if time_s.size:
        sure = half_width_percent <= _WIDE * np.median(half_width_percent)
        time_s, percent, distance_m = time_s[sure], percent[sure], distance_m[sure]
        half_width_percent = half_width_percent[sure]
    since_ns = round(float(time_s[0]) * NS_PER_S) if time_s.size else None
    doubt = max(np.median(half_width_percent), half_width_percent[-1]) if time_s.size else 0.0
    future = project_wear(time_s, distance_m, percent, float(doubt) * _SIGMA_OF_HALF_WIDTH)
    if future is None:
        reason = "Too little history for a trend."
        return Trend(status=TrendStatus.TOO_EARLY, reason=reason, since_time_ns=since_ns)
    draws, now_s = future.draws, float(time_s[-1])
    status = TrendStatus.STEADY
    if np.mean(draws.slope < 0.0) >= CERTAIN:
        status = TrendStatus.FALLING
    elif np.mean(draws.slope > 0.0) >= CERTAIN:
        status = TrendStatus.RISING
    crossings: list[Crossing] = []
    for name, limit in limits_percent.items() if status is TrendStatus.FALLING else ():
        if limit < float(np.median(draws.level_percent)):
            crossings.append(_crossing(name, limit, future, now_s, now_s - float(time_s[0])))
    low, middle, high = _quantiles(draws.slope * future.s_per_s * 3600.0)
    rate = Interval(value=middle, low=low, high=high)
    ends = max(round(_ENDS * percent.size), 1)
    change = float(np.mean(percent[-ends:]) - np.mean(percent[:ends]))
    return Trend(
        status=status,
        reason=_SENTENCES[status],
        since_time_ns=since_ns,
        until_time_ns=round(now_s * NS_PER_S),
        basis=future.basis,
        level=LEVEL,
        rate_percent_per_h=rate,
        rate_fresh_percent_per_h=rate.times(100.0 / fresh_percent) if fresh_percent else None,
        change_fresh_percent=100.0 / fresh_percent * change if fresh_percent else None,
        crossings=tuple(crossings),
    )


def is_over(trend: Trend, now_ns: int) -> bool:
    """The newest estimate behind the trend is old: what it tells was, and may not be."""
    since_ns, until_ns = trend.since_time_ns, trend.until_time_ns
    if since_ns is None or until_ns is None:
        return False
    return now_ns - until_ns > max(_OVER_NS, _OVER_SHARE * (until_ns - since_ns))


def as_of(trend: Trend, now_ns: int) -> Trend:
    """Trend as it is told now: a fall that may have ended is told as one that was."""
    change, since_ns, until_ns = (
        trend.change_fresh_percent,
        trend.since_time_ns,
        trend.until_time_ns,
    )
    if trend.status is not TrendStatus.FALLING or not is_over(trend, now_ns):
        return trend
    if change is None or change >= 0.0 or since_ns is None or until_ns is None:
        return trend
    words = "The preload fell by {fall:.3g} % of fresh from {since} to {until}."
    reason = words.format(fall=-change, **span(since_ns, until_ns))
    return trend.model_copy(update={"reason": reason})


def _quantiles(draws: Floats) -> tuple[float, float, float]:
    shares = [0.5 * (1.0 - LEVEL), 0.5, 0.5 * (1.0 + LEVEL)]
    low, middle, high = np.quantile(draws, shares, method="nearest")
    return float(low), float(middle), float(high)


def _crossing(
    name: str, limit_percent: float, future: WearProjection, now_s: float, span_s: float
) -> Crossing:
    """Dates of a limit; None for those beyond the horizon."""
    earliest_ns, likely_ns, latest_ns = (
        round((now_s + each) * NS_PER_S) if each <= _HORIZON * span_s else None
        for each in _quantiles(future.seconds_to(limit_percent))
    )
    return Crossing(
        limit=name,
        limit_percent=limit_percent,
        earliest_ns=earliest_ns,
        likely_ns=likely_ns,
        latest_ns=latest_ns,
    )
