"""Dates of a straight line through all readings, and the account of dates against what came."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from edge_service.messages.samples import Floats
from edge_service.offline.reproduce.wear import LEVEL, LIMITS, Date, WearTest, trend_dates

Dates = Mapping[float, Date]
EVERY = 3
_LONGEST = 5.0
"""A date further away than so many times the truth counts as that: an open end has a score."""
_DRAWS = 4000
_SEED = 20260131


@dataclass(frozen=True, slots=True)
class Stage:
    """Dates stated after one reading.

    Attributes:
        time_h: when, h from new.
        percent: the reading, percent of fresh.
        trend, line: dates stated.
    """

    time_h: float
    percent: float
    trend: Dates
    line: Dates


def stages(test: WearTest, limits: Sequence[float] = LIMITS, every: int = EVERY) -> list[Stage]:
    """Ask the trend and the line after every reading, each time with the readings until then."""
    found = []
    for count in range(1, test.time_h.size + 1, every):
        seen = WearTest(test.time_h[:count], test.distance_m[:count], test.drag_nm[:count])
        said = trend_dates(seen, limits), line_dates(seen, limits)
        found.append(Stage(float(seen.time_h[-1]), float(seen.percent[-1]), *said))
    return found


def interval_score(date: Date, time_h: float) -> float:
    """Weighted interval score of a band and its middle (Bracher et al. 2021), h; less is better.

    It is the score of the interval and the error of the middle, and approximates the CRPS.
    """
    low, middle, high = (
        min(each, _LONGEST * time_h) for each in (date.earliest_h, date.likely_h, date.latest_h)
    )
    missed = max(low - time_h, 0.0) + max(time_h - high, 0.0)
    return (abs(middle - time_h) + (1.0 - LEVEL) * (high - low) + 2.0 * missed) / 3.0


@dataclass(frozen=True, slots=True)
class Tally:
    """Account of the dates that were asked for before their limit was crossed.

    Attributes:
        asked, stated, held: questions, dates, and bands that held what came.
        scores: weighted interval score of each date, share of the time until the crossing.
        lead_h: from the first date that held until the crossing, by limit.
        said_after: dates stated for a limit that had been crossed by then.
    """

    asked: int
    stated: int
    held: int
    scores: tuple[float, ...]
    lead_h: dict[float, float]
    said_after: int

    @property
    def coverage(self) -> float:
        """Share of bands that held what came."""
        return self.held / self.stated if self.stated else math.nan


def tally(
    asked: Sequence[Stage], came_h: dict[float, float], dates_of: Callable[[Stage], Dates]
) -> Tally:
    """Hold all dates against when each limit was crossed, h; inf: it never was."""
    reached = {limit: time_h for limit, time_h in came_h.items() if math.isfinite(time_h)}
    pairs = [(stage, limit) for stage in asked for limit in reached]
    open_ = [(stage, limit) for stage, limit in pairs if stage.time_h < reached[limit]]
    stated = [(stage, limit) for stage, limit in open_ if limit in dates_of(stage)]
    held = [each for each in stated if dates_of(each[0])[each[1]].holds(reached[each[1]])]
    first = {limit: stage.time_h for stage, limit in reversed(held)}
    return Tally(
        asked=len(open_),
        stated=len(stated),
        held=len(held),
        scores=tuple(
            interval_score(dates_of(stage)[limit], reached[limit]) / reached[limit]
            for stage, limit in stated
        ),
        lead_h={limit: reached[limit] - at_h for limit, at_h in first.items()},
        said_after=sum(1 for stage, limit in pairs if limit in dates_of(stage)) - len(stated),
    )


def paired_scores(asked: Sequence[Stage], came_h: dict[float, float]) -> Floats:
    """Scores of the trend and of the line where both had a date before the crossing, (n, 2)."""
    pairs = [
        [interval_score(dates[limit], came_h[limit]) / came_h[limit] for dates in both]
        for stage in asked
        for both in [(stage.trend, stage.line)]
        for limit in came_h
        if stage.time_h < came_h[limit] < math.inf and all(limit in dates for dates in both)
    ]
    return np.array(pairs, np.float64).reshape(-1, 2)


def line_dates(seen: WearTest, limits: Sequence[float]) -> Dates:
    """Dates of a straight line over the hours through all readings: least squares, Student's t.

    Like the trend it has no date for a limit that it has passed, or that it may never reach.
    """
    if seen.time_h.size < 3:
        return {}
    level, slope = _line(seen.time_h - seen.time_h[-1], seen.percent)
    dates: dict[float, Date] = {}
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
