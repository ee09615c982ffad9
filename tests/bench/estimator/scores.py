"""Scores of how well an estimator followed the truth over a recording."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from edge_service.messages.estimate import PreloadEstimate
from edge_service.messages.features import FeatureBlock
from edge_service.messages.samples import Floats

MISS_WEIGHT = 40.0
"""Of the interval score at 95 %: width + 2 / 0.05 of what the truth lies outside."""
MISLEADING_PERCENT = 0.3
"""A number misleads if the truth lies this far outside its interval."""
WRONG_PERCENT = 0.5
"""A number is confidently wrong if the truth lies this far outside its interval."""


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """A recording as an estimator gets it, with the truth at times (n,)."""

    blocks: Sequence[FeatureBlock]
    time_s: Floats
    percent: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Output of an estimator at times (n,); NaN where it gave no number."""

    time_s: Floats
    truth: Floats  # at the middle of the last interval
    percent: Floats
    low: Floats
    high: Floats
    motion_s: Floats  # time in motion until then

    @property
    def columns(self) -> tuple[Floats, ...]:
        """All that has one value for each moment."""
        return self.time_s, self.truth, self.percent, self.low, self.high, self.motion_s

    def since(self, moment: int) -> "Track":
        """Without the first moments."""
        return Track(*(column[moment:] for column in self.columns))


class Followed(Protocol):
    def update(self, block: FeatureBlock) -> None:
        """Take the next interval."""

    def estimate(self) -> PreloadEstimate:
        """Current estimate."""


def follow(estimator: Followed, recorded: Recorded, every: int = 1) -> Track:
    """Feed all blocks; ask after every `every`-th."""
    rows: list[tuple[float, ...]] = []
    motion_s = 0.0
    for number, block in enumerate(recorded.blocks, start=1):
        estimator.update(block)
        motion_s += block.duration_s * float(np.nan_to_num(block.moving_fraction))
        if number % every:
            continue
        said = estimator.estimate()
        numbers = (said.preload_percent, said.low, said.high)
        values = (math.nan if value is None else value for value in numbers)
        rows.append((block.time_s, block.duration_s, motion_s, *values))
    time_s, duration_s, moved_s, percent, low, high = np.array(rows).reshape(-1, 6).T
    truth = np.interp(time_s - 0.5 * duration_s, recorded.time_s, recorded.percent)
    return Track(time_s, truth, percent, low, high, moved_s)


@dataclass(frozen=True, slots=True)
class Score:
    """Errors in points of preload over all moments with a number; NaN without any."""

    # moments, answered: how often it was asked, and gave a number
    moments: int
    answered: int
    # mae, worst: of the absolute error
    mae: float = math.nan
    worst: float = math.nan
    # the most that an estimate lay below the truth after the event of the case
    false_drop: float = math.nan
    coverage: float = math.nan  # share of the intervals that hold the truth
    interval_score: float = math.nan  # mean of width + 40 times what the truth lies outside
    misleading: float = 0.0  # share of the moments with a number that misleads
    wrong: float = math.nan  # share of the numbers that are confidently wrong
    # of motion, until a loss was seen; inf if never, NaN without a loss
    detection_s: float = math.nan
    cases: int = 1  # recordings behind it, each of one axis with one seed


def score(track: Track, event_s: float = 0.0, detection_s: float = math.nan) -> Score:
    """Of one track; `event_s` is when what may look like a loss begins."""
    answered = np.isfinite(track.percent)
    moments, count = len(answered), int(answered.sum())
    if not count:
        return Score(moments, 0, detection_s=detection_s)
    truth, low, high = track.truth[answered], track.low[answered], track.high[answered]
    error = track.percent[answered] - truth
    miss = np.maximum(np.maximum(low - truth, truth - high), 0.0)
    drop = -error[track.time_s[answered] >= event_s]
    return Score(
        moments=moments,
        answered=count,
        mae=float(np.abs(error).mean()),
        worst=float(np.abs(error).max()),
        false_drop=float(drop.max()) if len(drop) else math.nan,
        coverage=float((miss <= 1e-9).mean()),
        interval_score=float((high - low + MISS_WEIGHT * miss).mean()),
        misleading=float((miss > MISLEADING_PERCENT).sum()) / moments,
        wrong=float((miss > WRONG_PERCENT).mean()),
        detection_s=detection_s,
    )


def detection(track: Track, loss_s: float, below_percent: float) -> float:
    """Motion from a loss until the estimate is below a level, s; inf if never, or before it."""
    known = np.isfinite(track.percent)
    below = known & (track.percent < below_percent)
    after = track.time_s > loss_s
    if below[(~after) & (track.time_s > 0.5 * loss_s)].any() or not below[after].any():
        return math.inf
    begun_s = float(np.interp(loss_s, track.time_s, track.motion_s))
    return float(track.motion_s[np.argmax(below & after)]) - begun_s


def pooled(parts: Iterable[Score]) -> Score:
    """All cases of one row together: means over moments, worst of all cases."""
    scores = list(parts)
    answered = np.array([each.answered for each in scores], dtype=np.float64)
    moments = np.array([each.moments for each in scores], dtype=np.float64)

    def mean(values: Iterable[float]) -> float:
        there = answered > 0
        if not there.any():
            return math.nan
        return float(np.average(np.array(list(values))[there], weights=answered[there]))

    return Score(
        moments=int(moments.sum()),
        answered=int(answered.sum()),
        mae=mean(each.mae for each in scores),
        worst=_most(each.worst for each in scores),
        false_drop=_most(each.false_drop for each in scores),
        coverage=mean(each.coverage for each in scores),
        interval_score=mean(each.interval_score for each in scores),
        misleading=float(np.average([each.misleading for each in scores], weights=moments)),
        wrong=mean(each.wrong for each in scores),
        detection_s=_most(each.detection_s for each in scores),
        cases=sum(each.cases for each in scores),
    )


def _most(values: Iterable[float]) -> float:
    return max((value for value in values if not math.isnan(value)), default=math.nan)
