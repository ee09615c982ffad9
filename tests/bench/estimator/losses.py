"""Preload that is lost in ten minutes of production, with one encoder and with two.

The shifts are those of `healthy`: warm-up, new lubricant, payload, cuts and pauses. What
is lost, and when, is drawn from the seed.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from edge_service.estimate.mixture.estimator import MixturePreloadEstimator

from ..table import Table, listed, mean_of
from .healthy.production_cases import HEALTHY, Course, produced
from .scores import Score, follow, pooled, score

STEP_S = 0.01  # a sudden loss takes so long
CASES = ("healthy", "part lost at once", "all lost at once", "lost steadily", "worn at the start")


def drawn_course(case: str, axis_seed: int, shift_s: float) -> Course:
    """Course of the preload; the same arguments give the same one."""
    rng = np.random.default_rng([axis_seed, 59])
    at_s, until_s = np.sort(rng.uniform(0.2, 0.8, 2)) * shift_s
    left = float(rng.uniform(0.3, 0.8))
    courses: dict[str, Course] = {
        "healthy": HEALTHY,
        "part lost at once": ((at_s, 1.0), (at_s + STEP_S, left)),
        "all lost at once": ((at_s, 1.0), (at_s + STEP_S, 0.0)),
        "lost steadily": ((at_s, 1.0), (until_s + 0.1 * shift_s, left)),
        "worn at the start": ((0.0, left),),
    }
    return courses[case]


@dataclass(frozen=True, slots=True)
class LossPart:
    """One shift: its score, and the mean error of the answer that the screw is fresh."""

    plant: str
    case: str
    axis_seed: int
    score: Score
    fresh_mae: float


def lost(plant: str, axis_seed: int, shift_s: float) -> Iterator[LossPart]:
    for case in CASES:
        course = drawn_course(case, axis_seed, shift_s)
        machine, recorded = produced(plant, axis_seed, shift_s, course)
        track = follow(MixturePreloadEstimator(machine), recorded)
        fresh = machine.fresh_preload_percent or 0.0
        error = float(np.abs(track.truth - fresh).mean())
        yield LossPart(plant, case, axis_seed, score(track), error)


def losses_table(parts: Sequence[LossPart]) -> Table:
    rows: list[Mapping[str, object]] = []
    for plant, case in dict.fromkeys((part.plant, part.case) for part in parts):
        same = [part for part in parts if (part.plant, part.case) == (plant, case)]
        whole = pooled(part.score for part in same)
        row = {
            "in production": f"{plant}: {case}",
            "wrong": whole.wrong,
            "held": whole.coverage,
            "MAE": whole.mae,
            "fresh": mean_of([each.fresh_mae for each in same]),
            "answered": whole.answered / whole.moments,
            "score": whole.interval_score,
        }
        rows.append(row)
    return Table.of(rows, f"axis seeds {listed(part.axis_seed for part in parts)}")
