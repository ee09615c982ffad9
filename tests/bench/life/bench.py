"""Lives of many sessions, estimated with the state kept between them and with a new start each.

With a kept state the sessions are followed as `estimate --state` does: a session whose clock does
not go on from the last one is resumed after a stop of unknown length. No one tells of a new nut.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from edge_service.estimate.interface import PreloadEstimator
from edge_service.nodes.estimated_axis import LONGEST_STOP_S

from ..estimator.scores import Recorded, Score, Track, follow, pooled
from ..table import Table, listed, mean_of
from .cases import Life, draw_life
from .plants import ForeignLife, OwnLife, plant_of
from .scores import LifeScore, life_score

SESSIONS, QUICK_SESSIONS = 16, 6
SESSION_S, QUICK_SESSION_S = 180.0, 60.0
QUICK_SHAPES = ("accelerating", "replaced nut")
KEPT, NEW = "kept", "new"
TITLE = "life: plant, shape, state"


@dataclass(frozen=True, slots=True, eq=False)
class LifePart:
    """One life on one axis, estimated in one way (`kept` or `new`)."""

    plant: str
    life: Life
    way: str
    score: LifeScore


class KeptEstimator:
    """An estimator whose state goes from one session to the next as JSON."""

    def __init__(self, make: Callable[[], PreloadEstimator]) -> None:
        self._make = make
        self._state: str | None = None
        self._end_s = 0.0

    def follow(self, recorded: Recorded) -> Track:
        """Follow one session, one block or more."""
        estimator = self._make()
        if self._state is not None:
            estimator.restore(json.loads(self._state))
            if recorded.blocks[0].time_s <= self._end_s:
                estimator.resume(LONGEST_STOP_S)
        track = follow(estimator, recorded)
        self._state = json.dumps(estimator.snapshot(), allow_nan=False)
        self._end_s = recorded.blocks[-1].time_s
        return track


def follow_life(
    make: Callable[[], PreloadEstimator], recordings: Iterable[Recorded]
) -> dict[str, list[Track]]:
    kept = KeptEstimator(make)
    tracks: dict[str, list[Track]] = {KEPT: [], NEW: []}
    for recorded in recordings:
        tracks[KEPT].append(kept.follow(recorded))
        tracks[NEW].append(follow(make(), recorded))
    return tracks


def live(plant: str, shape: str, axis_seed: int, quick: bool) -> Iterator[LifePart]:
    axis = plant_of(plant, axis_seed)
    life = drawn_life(axis, shape, axis_seed, quick)
    recordings = (axis.recorded(session) for session in life.sessions)
    for way, tracks in follow_life(axis.estimator, recordings).items():
        yield LifePart(plant, life, way, life_score(life, tracks))


def drawn_life(axis: OwnLife | ForeignLife, shape: str, axis_seed: int, quick: bool) -> Life:
    """Sessions of one axis; fewer and shorter if `quick`."""
    count, session_s = (QUICK_SESSIONS, QUICK_SESSION_S) if quick else (SESSIONS, SESSION_S)
    return draw_life(shape, axis_seed, axis.fresh_percent, count, session_s)


def life_table(parts: Sequence[LifePart]) -> Table:
    """One row for each plant, shape and way over all axes; then all shapes together."""
    rows: list[Mapping[str, object]] = []
    for plant, way in sorted({(part.plant, part.way) for part in parts}):
        mine = [part for part in parts if (part.plant, part.way) == (plant, way)]
        for shape in dict.fromkeys(part.life.shape for part in mine):
            same = [part for part in mine if part.life.shape == shape]
            rows.append(_row(f"{plant}, {shape}, {way}", same))
        rows.append(_row(f"{plant}, all lives, {way}", mine))
        rows += _by_start(f"{plant}, {way}, begun", mine)
    return Table.of(
        rows,
        f"axis seeds {listed(part.life.axis_seed for part in parts)}; wrong: share of the numbers "
        "whose interval misses the truth by more than half a point; date: of falling below 60 % "
        "of fresh, error as share of the life; never: lives in which it was not found; false: "
        "found where there is none",
    )


def _by_start(label: str, parts: Sequence[LifePart]) -> Iterator[Mapping[str, object]]:
    """One row for each state in which sessions begin; what only a life has is left out."""
    found: dict[str, list[Score]] = {}
    for part in parts:
        for session, each in zip(part.life.sessions, part.score.each, strict=True):
            found.setdefault(session.start, []).append(each)
    axes = len({part.life.axis_seed for part in parts})
    for start, scores in sorted(found.items()):
        rows = pooled(scores)
        yield {
            TITLE: f"{label} {start}",
            "wrong": rows.wrong,
            "rows": rows.answered,
            "axes": axes,
            "sessions": len(scores),
            "silent": sum(each.answered == 0 for each in scores),
            "MAE rows": rows.mae,
            "cover": rows.coverage,
            "score": rows.interval_score,
        }


def _row(title: str, parts: Sequence[LifePart]) -> Mapping[str, object]:
    scores = [part.score for part in parts]
    rows = pooled(each.rows for each in scores)
    return {
        TITLE: title,
        "wrong": rows.wrong,
        "rows": rows.answered,
        "axes": len({part.life.axis_seed for part in parts}),
        "sessions": sum(len(each.each) for each in scores),
        "silent": sum(each.silent for each in scores),
        "MAE ends": mean_of([each.ends_mae for each in scores]),
        "fresh": mean_of([each.fresh_mae for each in scores]),
        "MAE rows": rows.mae,
        "rank": mean_of([each.rank for each in scores]),
        "cover": rows.coverage,
        "score": rows.interval_score,
        "date": mean_of([each.crossing for each in scores]),
        "never": sum(each.crossing == float("inf") for each in scores),
        "false": sum(each.false_crossing for each in scores),
    }
