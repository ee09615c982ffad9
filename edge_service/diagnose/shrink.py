"""How far the gap shrinks on motion that was not used for fitting."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..fingerprint.regression import Booleans
from ..messages.samples import Floats
from .refine import Problem
from .session import Rows

FOLDS = 4
LEVEL = 0.9
MOTION_LOG_ODDS = 0.65
"""Half of the 90 % interval that lies between one motion and another (`bench diagnose`)."""
_RESAMPLES = 400


@dataclass(frozen=True, slots=True)
class Shrink:
    """1 - RMS after / RMS before, with its interval of probability `LEVEL`."""

    estimate: float
    low: float
    high: float


def held_out(
    problem: Problem,
    sizes: Sequence[int],
    columns: Sequence[Mapping[str, Floats]],
    strict: Booleans,
) -> dict[str, Floats]:
    """What columns predict of each block of time from all other folds, by channel, (n, groups).

    Args:
        sizes: columns of each group.
        columns: of each group, by channel.
        strict: (p,), True where a column's coefficient is 1.
    """
    channels = problem.session.channels
    blocks = {name: rows.block % FOLDS for name, rows in channels.items()}
    edges = np.cumsum([0, *sizes])
    found = {name: np.zeros((len(rows.gap), len(sizes))) for name, rows in channels.items()}
    for fold in range(FOLDS):
        kept = {name: blocks[name] != fold for name in channels}
        if not all((~each).any() and each.any() for each in kept.values()):
            continue
        beta = problem.solve_rows(columns, strict, kept)
        for name in channels:
            test = ~kept[name]
            for k, each in enumerate(columns):
                part = beta[edges[k] : edges[k + 1]]
                found[name][test, k] = each[name][test] @ part
    return found


def shrink_of(rows: Rows, predicted: Floats) -> Shrink:
    """Shrink of one channel by a prediction (n,), resampled by blocks of time."""
    count = int(rows.block.max()) + 1
    before = np.bincount(rows.block, rows.gap**2, minlength=count)
    after = np.bincount(rows.block, (rows.gap - predicted) ** 2, minlength=count)
    used = before > 0.0
    before, after = before[used], after[used]
    random = np.random.default_rng(7)
    drawn = random.integers(0, len(before), (_RESAMPLES, len(before)))
    ratios = 1.0 - np.sqrt(after[drawn].sum(axis=1) / np.maximum(before[drawn].sum(axis=1), 1e-300))
    low, high = np.quantile(ratios, (0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL))
    estimate = 1.0 - float(np.sqrt(after.sum() / before.sum()))
    return _on_other_motion(estimate, float(min(low, estimate)), float(max(high, estimate)))


def _on_other_motion(estimate: float, low: float, high: float) -> Shrink:
    """The shrink with what it differs by from one motion to the next, in log odds."""
    if not 0.0 < estimate < 1.0:
        return Shrink(estimate, low, high)
    centre = _log_odds(estimate)
    below = math.hypot(MOTION_LOG_ODDS, centre - _log_odds(low)) if low > 0.0 else math.inf
    above = math.hypot(MOTION_LOG_ODDS, _log_odds(min(high, 1.0 - 1e-9)) - centre)
    least = low if math.isinf(below) else _share(centre - below)
    return Shrink(estimate, min(least, _share(centre - MOTION_LOG_ODDS)), _share(centre + above))


def _log_odds(share: float) -> float:
    return math.log(share / (1.0 - share))


def _share(log_odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-log_odds))
