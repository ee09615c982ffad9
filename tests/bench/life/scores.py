"""Scores of following a life: from the last number of each session, and from all numbers."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import rankdata

from edge_service.messages.samples import Floats

from ..estimator.scores import Score, Track, score
from ..table import mean_of
from .cases import DAY_S, LIMIT_SHARE, Life


@dataclass(frozen=True, slots=True, eq=False)
class SessionEnds:
    """The last number of each session and the truth then, (n,); NaN where it gave none."""

    day: Floats
    truth: Floats
    percent: Floats
    low: Floats
    high: Floats


def session_ends(life: Life, tracks: Sequence[Track]) -> SessionEnds:
    """Of one track for each session."""
    rows = []
    for session, track in zip(life.sessions, tracks, strict=True):
        answered = np.flatnonzero(np.isfinite(track.percent))
        last = int(answered[-1]) if len(answered) else -1
        day = session.day + (float(track.time_s[last]) - session.clock_s) / DAY_S
        numbers = (track.percent[last], track.low[last], track.high[last])
        rows.append((day, float(track.truth[last]), *(float(each) for each in numbers)))
    return SessionEnds(*np.array(rows).T)


def joined(life: Life, tracks: Sequence[Track]) -> Track:
    """All sessions one after another on a clock that counts only them."""
    before_s, times = 0.0, []
    for session, track in zip(life.sessions, tracks, strict=True):
        times.append(track.time_s - session.clock_s + before_s)
        before_s += session.duration_s

    def all_of(name: str) -> Floats:
        return np.concatenate([getattr(track, name) for track in tracks])

    return Track(
        time_s=np.concatenate(times),
        truth=all_of("truth"),
        percent=all_of("percent"),
        low=all_of("low"),
        high=all_of("high"),
        motion_s=all_of("motion_s"),
    )


def crossing_day(day: Floats, percent: Floats, level: float) -> float:
    """Day on which a series (n,) falls below a level, straight between its points; inf if never.

    The next point must lie below as well, where there is one. NaN are left out.
    """
    answered = np.isfinite(percent)
    day, percent = day[answered], percent[answered]
    below = percent < level
    firm = below & np.append(below[1:], True)
    if not firm.any():
        return math.inf
    first = int(np.argmax(firm))
    if first == 0:
        return float(day[0])
    share = (percent[first - 1] - level) / (percent[first - 1] - percent[first])
    return float(day[first - 1] + np.clip(share, 0.0, 1.0) * (day[first] - day[first - 1]))


def rank_correlation(first: Floats, second: Floats) -> float:
    """Spearman's, of the pairs without NaN; NaN without 3 pairs or where one never changes."""
    both = np.isfinite(first) & np.isfinite(second)
    if both.sum() < 3 or np.ptp(first[both]) == 0.0 or np.ptp(second[both]) == 0.0:
        return math.nan
    return float(np.corrcoef(rankdata(first[both]), rankdata(second[both]))[0, 1])


@dataclass(frozen=True, slots=True)
class LifeScore:
    """Figures of one life; errors in points of preload.

    Attributes:
        rows, each: score of all numbers, and of every session's.
        silent: sessions without a number.
        ends_mae, fresh_mae: over the session ends; the second of saying `fresh` always.
        rank: correlation of the session ends with the truth; NaN where the truth never changes.
        crossing: error of the day on which `LIMIT_SHARE` of fresh is left below, share of the
            life; inf if never found, NaN where there is no such day.
        false_crossing: whether one was found where there is none.
    """

    sessions: int
    silent: int
    rows: Score
    each: tuple[Score, ...]
    ends_mae: float
    fresh_mae: float
    rank: float
    crossing: float
    false_crossing: bool


def life_score(life: Life, tracks: Sequence[Track]) -> LifeScore:
    """Of one track for each session."""
    ends = session_ends(life, tracks)
    answered = np.isfinite(ends.percent)
    level = LIMIT_SHARE * life.fresh_percent
    found, true = crossing_day(ends.day, ends.percent, level), life.crossing_day()
    fresh = np.abs(life.fresh_percent - ends.truth[answered])
    return LifeScore(
        sessions=len(tracks),
        silent=int((~answered).sum()),
        rows=score(joined(life, tracks)),
        each=tuple(score(track) for track in tracks),
        ends_mae=mean_of(np.abs(ends.percent - ends.truth)[answered].tolist()),
        fresh_mae=mean_of(fresh.tolist()),
        rank=rank_correlation(ends.percent, ends.truth),
        crossing=math.nan if math.isnan(true) else abs(found - true) / life.days,
        false_crossing=math.isnan(true) and math.isfinite(found),
    )
