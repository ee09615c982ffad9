"""Preload that is lost in ten minutes of production, with one encoder and with two.

`python -m tests.bench.estimator.losses --seed 26000 --seeds 4`

The shifts are those of `healthy.axis_hours`: warm-up, new lubricant, payload, cuts and pauses. What
is lost, and when, is drawn from the seed.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence

import numpy as np

from edge_service.estimate.mixture.estimator import MixturePreloadEstimator

from ..table import aligned
from .healthy.axis_hours import PLANTS, SHIFT_S, worked
from .healthy.production_cases import HEALTHY, Course
from .scores import Score, follow, pooled, score

STEP_S = 0.01
"""A sudden loss takes so long."""
CASES = ("healthy", "part lost at once", "all lost at once", "lost steadily", "worn at the start")
HEADS = ("plant", "preload", "wrong by > .5", "held", "MAE", "MAE of 'fresh'", "answered", "score")
Row = tuple[Score, float]


def drawn_course(case: str, axis_seed: int, shift_s: float = SHIFT_S) -> Course:
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


def lost(plant: str, case: str, axis_seed: int, shift_s: float = SHIFT_S) -> Row:
    """Score of one shift, and the mean error of the answer that the screw is fresh."""
    machine, recorded = worked(plant, axis_seed, drawn_course(case, axis_seed, shift_s), shift_s)
    track = follow(MixturePreloadEstimator(machine), recorded)
    fresh = machine.fresh_preload_percent or 0.0
    return score(track), float(np.abs(track.truth - fresh).mean())


def rows(plants: Sequence[str], axis_seeds: Sequence[int]) -> Iterator[tuple[str, ...]]:
    """One row for each plant and case, as text."""
    for plant in plants:
        for case in CASES:
            found = [lost(plant, case, axis_seed) for axis_seed in axis_seeds]
            whole = pooled(each for each, _ in found)
            fresh = float(np.mean([error for _, error in found]))
            answered = whole.answered / whole.moments
            shares = whole.wrong, whole.coverage, whole.mae, fresh, answered, whole.interval_score
            yield (plant, case, *(f"{share:.3f}" for share in shares))


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table, each row on standard error as it comes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=26000)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--plants", nargs="*", choices=PLANTS, default=PLANTS)
    given = parser.parse_args(arguments)
    found: list[tuple[str, ...]] = [HEADS]
    for row in rows(given.plants, range(given.seed, given.seed + given.seeds)):
        sys.stderr.write("  ".join(row) + "\n")
        found.append(row)
    sys.stdout.write("\n".join(aligned(found, right=range(2, len(HEADS)))) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
