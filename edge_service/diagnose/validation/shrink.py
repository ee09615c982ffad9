"""Shrinkage of the gap on motion that was not used for fitting."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...messages.samples import Floats
from ..candidates.force_pulses import FORCE
from ..estimation.estimates import Estimates
from ..session.session import Integers, Rows
from .cross_validation import Fold, contribution_at_pace, held_out_contribution

LEVEL = 0.9
PACES = (0.5, 2.0)
"""Paces at which another session may warm the axis: heat comes from motion (assumption)."""
_SPEED_CLASSES = 4
_REGIMES = 4 * _SPEED_CLASSES
_SHAPE = 0.5
"""Of a Dirichlet distribution that knows nothing (Jeffreys)."""
_RESAMPLES = 1000
_PART = 0.2
"""Share of a session that one more recording is like."""


@dataclass(frozen=True, slots=True)
class Shrink:
    """1 - RMS after / RMS before, with its interval of probability `LEVEL`."""

    estimate: float
    low: float
    high: float

    @classmethod
    def of_draws(cls, estimate: float, draws: Floats) -> "Shrink":
        """Estimate within the quantiles of draws (k,)."""
        low, high = np.quantile(draws, (0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL))
        return cls(estimate, float(min(low, estimate)), float(max(high, estimate)))


def resampled(block: Integers, before: Floats, after: Floats) -> Shrink:
    """Shrink from one series (n,) to another on the same motion, resampled by blocks of time."""
    count = int(block.max()) + 1
    first = np.bincount(block, before**2, minlength=count)
    last = np.bincount(block, after**2, minlength=count)
    used = first > 0.0
    weights = _block_weights(int(used.sum()))
    estimate = _shrink(first.sum(), last.sum())
    return Shrink.of_draws(float(estimate), _shrink(weights @ first[used], weights @ last[used]))


def shrink_of(
    rows: Rows, name: str, channel: str, values: Estimates, folds: Sequence[Fold]
) -> Shrink:
    """Shrink of a channel by one effect beside all others, expected on other motion.

    The estimate is that of held-out blocks: from what the others leave to what all leave. A force
    among the others, which no block predicts of another, is taken off as it was here. An effect
    that follows time does so at another pace in two thirds of the draws of the interval.

    Args:
        values: fitted on all blocks.
        folds: from `folds_of`.
    """
    others = {*values.names} - {name}
    without = rows.gap.copy()
    for other in sorted(others - {FORCE}):
        without -= held_out_contribution(folds, other, channel)
    if name != FORCE:
        without -= values.contribution(FORCE, channel)
    left = [without - held_out_contribution(folds, name, channel)]
    for made in (contribution_at_pace(values, name, channel, pace) for pace in PACES):
        if made is not None:
            left.append(without - made)
    return on_other_motion(replace(rows, gap=without), left)


def on_other_motion(rows: Rows, left: Sequence[Floats]) -> Shrink:
    """Shrink from a gap to what is left of it, (n,), with an interval for motion of other kinds.

    Another motion visits the regimes of this one in other proportions, of which nothing is known:
    each draw weighs them by a Dirichlet distribution (after Rubin, 1981, The Bayesian Bootstrap).
    It is one recording, as warm as a part of this session and in no more places: each draw looks at
    one part.

    Args:
        left: the first gives the estimate; each is as likely on other motion.
    """
    random = np.random.default_rng(11)
    proportions = random.standard_gamma(_SHAPE, (_RESAMPLES, _REGIMES))
    regime = regime_of(rows)
    weights = _part_weights(int(rows.block.max()) + 1)
    before = _drawn(rows, regime, rows.gap, proportions, weights)
    after = [_drawn(rows, regime, each, proportions, weights) for each in left]
    chosen = np.choose(random.integers(0, len(after), _RESAMPLES), after)
    estimate = _shrink(np.sum(rows.gap**2), np.sum(left[0] ** 2))
    return Shrink.of_draws(float(estimate), _shrink(before, chosen))


def regime_of(rows: Rows) -> Integers:
    """Number of each row's regime, (n,): speed in four classes, accelerating or not, which side."""
    known = rows.variables
    speed = np.abs(known["motor_speed_rad_s"])
    acceleration = np.abs(known["motor_acceleration_rad_s2"])
    place = known["table_position_m"]
    edges = np.quantile(speed, np.arange(1, _SPEED_CLASSES) / _SPEED_CLASSES)
    found = 4 * np.digitize(speed, edges) + 2 * (acceleration > np.median(acceleration))
    regime: Integers = (found + (place > np.median(place))).astype(np.int64)
    return regime


def _drawn(
    rows: Rows, regime: Integers, series: Floats, proportions: Floats, weights: Floats
) -> Floats:
    """Energy of a series (n,) on other motions, (k,): by proportions (k, regimes) and blocks."""
    count = weights.shape[1]
    cells = np.bincount(regime * count + rows.block, series**2, minlength=_REGIMES * count)
    drawn: Floats = np.sum((proportions @ cells.reshape(_REGIMES, count)) * weights, axis=1)
    return drawn


def _block_weights(count: int) -> Floats:
    """Number of times that each block is drawn, (k, count); the same draws in every call."""
    random = np.random.default_rng(7)
    weights: Floats = random.multinomial(count, np.full(count, 1.0 / count), _RESAMPLES).astype(
        np.float64
    )
    return weights


def _part_weights(count: int) -> Floats:
    """Weight of each block, (k, count): those of one part of the session."""
    length = max(round(count * _PART), 1)
    first = np.random.default_rng(7).integers(0, count - length + 1, _RESAMPLES)[:, None]
    block = np.arange(count)
    return ((block >= first) & (block < first + length)).astype(np.float64)


def _shrink(before: Floats | float, after: Floats | float) -> Floats:
    ratio: Floats = np.sqrt(np.asarray(after) / np.maximum(before, 1e-300))
    return 1.0 - ratio
