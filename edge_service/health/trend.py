"""Trend and remaining life of an axis, from the history of its preload."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..messages.interval import Interval
from ..messages.samples import Floats
from ..messages.stored import StoredFloats
from ..messages.trend import Crossing, Trend, TrendStatus
from .wear_laws import TrendDraws, draw_trends

MOST_POINTS = 400
_COLUMNS = 5
_LONGEST_STEP_S = 1e9


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
    """Means of preload over equal steps of time; the steps double whenever there are too many.

    Args:
        step_s: The first length of a step, s.
    """

    def __init__(self, step_s: float = 1.0) -> None:
        self._first_step_s = self._step_s = step_s
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
            self._coarsen()

    def move(self, step_s: float, since_s: float = -math.inf) -> None:
        """The clock was set by a step, s: the distances in time stay.

        Args:
            since_s: what is older stays where it is; what comes to lie on it is joined to it.
        """
        rows, self._rows = self._rows, []
        for row in rows:
            if (row[0] + 1.0) * self._step_s > since_s:
                row[0] += step_s / self._step_s
            if self._rows and row[0] <= self._rows[-1][0]:
                self._join(row)
            else:
                self._rows.append(row)

    def _join(self, row: list[float]) -> None:
        last = self._rows[-1]
        count = last[1] + row[1]
        last[2:] = [
            (last[1] * a + row[1] * b) / count for a, b in zip(last[2:], row[2:], strict=True)
        ]
        last[1] = count

    def newest(self) -> float | None:
        """Preload of the newest step, percent; None if there is none."""
        return self._rows[-1][2] if self._rows else None

    def clear(self) -> None:
        """Begin anew."""
        self._step_s = self._first_step_s
        self._rows = []

    def points(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Times (s), preloads (percent), half widths (percent), distances (m), each (n,).

        The newest step is left out while it is less than half full: it would be noisier.
        """
        rows = np.array(self._rows, np.float64).reshape(-1, _COLUMNS)
        if len(rows) > 2 and rows[-1, 1] < 0.5 * np.median(rows[:, 1]):
            rows = rows[:-1]
        return (rows[:, 0] + 0.5) * self._step_s, rows[:, 2], rows[:, 3], rows[:, 4]

    def snapshot(self) -> PreloadSteps:
        """State that outlives the process."""
        return PreloadSteps(self._step_s, np.array(self._rows, np.float64).reshape(-1, _COLUMNS))

    def restore(self, snapshot: PreloadSteps) -> None:
        """Go on from a snapshot. Raises ValueError."""
        rows = snapshot.rows.reshape(-1, _COLUMNS)
        if not 0.0 < snapshot.step_s < _LONGEST_STEP_S:
            raise ValueError(f"a wear series with steps of {snapshot.step_s} s")
        if not np.all(np.isfinite(rows)) or np.any(np.diff(rows[:, 0]) <= 0):
            raise ValueError("a wear series out of order")
        self._step_s, self._rows = snapshot.step_s, rows.tolist()

    def _coarsen(self) -> None:
        rows = np.array(self._rows)
        number, first = np.unique(rows[:, 0] // 2.0, return_index=True)
        count = np.add.reduceat(rows[:, 1], first)
        means = np.add.reduceat(rows[:, 2:] * rows[:, 1:2], first, axis=0) / count[:, None]
        self._rows = np.column_stack([number, count, means]).tolist()
        self._step_s *= 2.0


NS_PER_S = 1_000_000_000
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


@dataclass(frozen=True, slots=True)
class TrendSettings:
    """Conditions under which a trend is reported.

    Attributes:
        level: of every interval and band.
        certain: probability of a fall (or rise) from which it is called one.
        horizon: a limit further away than this many times the history's length has no date.
    """

    level: float = 0.9
    certain: float = 0.95
    horizon: float = 20.0


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
    limits_percent: dict[str, float],
    settings: TrendSettings | None = None,
) -> Trend:
    """The trend of a history, for people.

    Args:
        time_s, percent, half_width_percent, distance_m: The history since the part came into use,
            (n,).
        limits_percent: Limits by name, percent of the dynamic load rating.
    """
    settings = settings or TrendSettings()
    if time_s.size:
        sure = half_width_percent <= _WIDE * np.median(half_width_percent)
        time_s, percent, distance_m = time_s[sure], percent[sure], distance_m[sure]
        half_width_percent = half_width_percent[sure]
    since_ns = round(float(time_s[0]) * NS_PER_S) if time_s.size else None
    doubt = max(np.median(half_width_percent), half_width_percent[-1]) if time_s.size else 0.0
    sigma = float(doubt) * _SIGMA_OF_HALF_WIDTH
    future = project_wear(time_s, distance_m, percent, sigma)
    if future is None:
        reason = "too little history for a trend yet"
        return Trend(status=TrendStatus.TOO_EARLY, reason=reason, since_time_ns=since_ns)
    status = _status(future.draws, settings)
    per_h = future.draws.slope * future.s_per_s * 3600.0
    per_km = future.draws.slope * 1000.0 if future.basis == "distance" else None
    crossings: tuple[Crossing, ...] = ()
    if status is TrendStatus.FALLING:
        span_s = float(time_s[-1] - time_s[0])
        crossings = tuple(
            _crossing(name, limit, future, float(time_s[-1]), span_s, settings)
            for name, limit in limits_percent.items()
            if limit < float(np.median(future.draws.level_percent))
        )
    return Trend(
        status=status,
        reason=_SENTENCES[status],
        since_time_ns=since_ns,
        basis=future.basis,
        level=settings.level,
        rate_percent_per_h=_interval(per_h, settings.level),
        rate_percent_per_km=None if per_km is None else _interval(per_km, settings.level),
        crossings=crossings,
    )


_SENTENCES = {
    TrendStatus.FALLING: "the preload is falling",
    TrendStatus.RISING: "the preload is rising: wear cannot do that, so something else has changed",
    TrendStatus.STEADY: "no clear trend yet, so there is no date",
}


def _status(draws: TrendDraws, settings: TrendSettings) -> TrendStatus:
    if draws.falling_probability() >= settings.certain:
        return TrendStatus.FALLING
    rising = draws.rising_probability() >= settings.certain
    return TrendStatus.RISING if rising else TrendStatus.STEADY


def _quantiles(draws: npt.NDArray[np.float64], level: float) -> tuple[float, float, float]:
    shares = [0.5 * (1.0 - level), 0.5, 0.5 * (1.0 + level)]
    low, middle, high = np.quantile(draws, shares, method="nearest")
    return float(low), float(middle), float(high)


def _interval(draws: npt.NDArray[np.float64], level: float) -> Interval:
    low, middle, high = _quantiles(draws, level)
    return Interval(value=middle, low=low, high=high)


def _crossing(
    name: str,
    limit_percent: float,
    future: WearProjection,
    now_s: float,
    span_s: float,
    settings: TrendSettings,
) -> Crossing:
    remaining = future.seconds_to(limit_percent)
    horizon_s = settings.horizon * span_s
    times = [
        round((now_s + each) * NS_PER_S) if each <= horizon_s else None
        for each in _quantiles(remaining, settings.level)
    ]
    return Crossing(
        limit=name,
        limit_percent=limit_percent,
        earliest_ns=times[0],
        likely_ns=times[1],
        latest_ns=times[2],
    )
