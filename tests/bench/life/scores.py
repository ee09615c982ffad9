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


def session_ends(life: Life, tracks: Sequence[Track]) -> tuple[Floats, Floats, Floats]:
    """Day, truth and last number of each session, (n,) each; NaN where it gave none."""
    rows = []
    for session, track in zip(life.sessions, tracks, strict=True):
        answered = np.flatnonzero(np.isfinite(track.percent))
        last = int(answered[-1]) if len(answered) else -1
        day = session.day + (float(track.time_s[last]) - session.clock_s) / DAY_S
        rows.append((day, float(track.truth[last]), float(track.percent[last])))
    day_of_each, truth, percent = np.array(rows).T
    return day_of_each, truth, percent


def joined(life: Life, tracks: Sequence[Track]) -> Track:
    """All sessions one after another on a clock that counts only them."""
    before_s, moved = 0.0, []
    for session, track in zip(life.sessions, tracks, strict=True):
        moved.append((track.time_s - session.clock_s + before_s, *track.columns[1:]))
        before_s += session.duration_s
    return Track(*map(np.concatenate, zip(*moved, strict=True)))


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
    """Figures of one life; errors in points of preload."""

    silent: int  # sessions without a number
    # rows, each: score of all numbers, and of every session's
    rows: Score
    each: tuple[Score, ...]
    # ends_mae, fresh_mae: over the session ends; the second of saying `fresh` always
    ends_mae: float
    fresh_mae: float
    rank: float  # correlation of the session ends with the truth; NaN where the truth never changes
    # error of the day on which `LIMIT_SHARE` of fresh is left below, share of the life; inf if
    # never found, NaN where there is no such day
    crossing: float
    false_crossing: bool  # whether one was found where there is none


def life_score(life: Life, tracks: Sequence[Track]) -> LifeScore:
    day, truth, percent = session_ends(life, tracks)
    answered = np.isfinite(percent)
    level = LIMIT_SHARE * life.fresh_percent
    found, true = crossing_day(day, percent, level), life.crossing_day()
    fresh = np.abs(life.fresh_percent - truth[answered])
    return LifeScore(
        silent=int((~answered).sum()),
        rows=score(joined(life, tracks)),
        each=tuple(score(track) for track in tracks),
        ends_mae=mean_of(np.abs(percent - truth)[answered].tolist()),
        fresh_mae=mean_of(fresh.tolist()),
        rank=rank_correlation(percent, truth),
        crossing=math.nan if math.isnan(true) else abs(found - true) / life.days,
        false_crossing=math.isnan(true) and math.isfinite(found),
    )
