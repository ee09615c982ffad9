"""Wear of any rate within one session of the second plant, cold or while the axis warms up."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.messages.samples import Floats

from ... import foreign_plant as plant
from ..table import Table, listed, mean_of
from .plants.foreign import commissioned_machine, recorded
from .scores import Score, Track, follow, pooled, score

RATES_PER_MIN = (0.0, 0.001, 0.01, 0.1, 1.0, math.inf)
"""Points of preload lost per minute; infinite: all of it within one minute."""
QUICK_RATES_PER_MIN = (0.0, 0.1, math.inf)
SESSION_S, QUICK_SESSION_S = 480.0, 180.0
BEGIN_S = 60.0
LOSS_PERCENT = 0.5
HELD = 10
"""So many numbers in a row must see the loss."""
END_S = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class RatePart:
    row: str  # rate and state of the axis, as printed
    axis_seed: int
    score: Score  # `detection_s` from half a point of loss until it was seen; 0 if sooner
    end_error: float  # mean of the last `END_S`, estimate less truth, points
    fresh_mae: float  # of saying `fresh` always, over the same moments, points
    early: bool  # whether it was seen while nothing had been lost


def preload(rate_per_min: float, fresh_percent: float, duration_s: float) -> tuple[Floats, Floats]:
    """Times (3 or 4,) and percent: constant until `BEGIN_S`, then falling, never below 0."""
    per_s = fresh_percent / 60.0 if math.isinf(rate_per_min) else rate_per_min / 60.0
    gone_s = BEGIN_S + (fresh_percent / per_s if per_s > 0.0 else math.inf)
    times = [0.0, BEGIN_S, *([gone_s] if gone_s < duration_s else []), duration_s]
    time_s = np.array(times)
    return time_s, np.maximum(fresh_percent - per_s * np.maximum(time_s - BEGIN_S, 0.0), 0.0)


def loss_seen(track: Track, fresh_percent: float) -> tuple[float, bool]:
    """Motion from half a point of loss until it was seen, s, and whether it was seen too early.

    Seen: the whole interval lies below what was lost by half of that, `HELD` numbers in a row.
    NaN where so much was never lost; inf where it was lost and not seen.
    """
    answered = np.isfinite(track.high)
    below = track.high[answered] < fresh_percent - 0.5 * LOSS_PERCENT
    runs = np.convolve(below, np.ones(HELD), "valid") == HELD if len(below) >= HELD else below[:0]
    seen = np.flatnonzero(runs)
    lost = np.flatnonzero(track.truth <= fresh_percent - LOSS_PERCENT)
    early = bool(len(seen)) and bool(track.truth[answered][seen[0]] >= fresh_percent - 1e-9)
    if not len(lost):
        return math.nan, early
    if not len(seen):
        return math.inf, early
    moved_s = float(track.motion_s[answered][seen[0]] - track.motion_s[lost[0]])
    return max(moved_s, 0.0), early


def rate_session(axis_seed: int, warming: bool, quick: bool) -> Iterator[RatePart]:
    fresh = float(plant.Machine().preload_percent)
    duration_s = QUICK_SESSION_S if quick else SESSION_S
    for number, rate in enumerate(QUICK_RATES_PER_MIN if quick else RATES_PER_MIN):
        seed = 1000 * axis_seed + number
        case = plant.axis_case(
            preload(rate, fresh, duration_s),
            setpoint_m=plant.part_programme(np.random.default_rng([seed, 37]), duration_s),
            events=(plant.Warmup(),) if warming else (),
            seed=seed,
            axis_seed=axis_seed,
        )
        track = follow(MixturePreloadEstimator(commissioned_machine(axis_seed)), recorded(case))
        answered = np.isfinite(track.percent)
        error, at_s = (track.percent - track.truth)[answered], track.time_s[answered]
        late = at_s >= track.time_s[-1] - END_S
        seen_s, early = loss_seen(track, fresh)
        lost = "all within 1 min" if math.isinf(rate) else f"{rate:g} points/min"
        yield RatePart(
            f"{lost}, {'warming up' if warming else 'cold'}",
            axis_seed,
            score(track, detection_s=seen_s),
            mean_of(error[late].tolist()),
            mean_of(np.abs(fresh - track.truth[answered]).tolist()),
            early,
        )


def rate_table(parts: Sequence[RatePart]) -> Table:
    """One row for each rate, cold and warming up, over all axes."""
    names = dict.fromkeys(part.row for part in parts)
    return Table.of(
        [_row(name, [part for part in parts if part.row == name]) for name in names],
        f"axis seeds {listed(part.axis_seed for part in parts)}; end: mean of the absolute errors "
        "of the last 10 s; seen: s of motion from half a point of loss until the interval leaves "
        "the fresh level, the latest axis; early: axes on which it did while nothing was lost",
    )


def _row(name: str, parts: Sequence[RatePart]) -> Mapping[str, object]:
    together = pooled(part.score for part in parts)
    return {
        "wear in one session, foreign plant": name,
        "wrong": together.wrong,
        "rows": together.answered,
        "axes": len({part.axis_seed for part in parts}),
        "MAE": together.mae,
        "fresh": mean_of([part.fresh_mae for part in parts]),
        "end": mean_of([abs(part.end_error) for part in parts]),
        "cover": together.coverage,
        "score": together.interval_score,
        "seen s": together.detection_s,
        "early": sum(part.early for part in parts),
    }
