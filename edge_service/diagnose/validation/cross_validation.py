"""Cross validation: how far effects shrink the gap on motion that was not used for fitting."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...messages.samples import Floats, Integers
from ..candidates.regressors import FORCE
from ..estimation.estimates import Estimates
from ..result import Shrink
from ..session.session import FOLDS, Rows

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
_TIME_CONSTANT = "time_constant_s"


@dataclass(frozen=True, slots=True, eq=False)
class CrossValidation:
    """Values fitted on all blocks of time, and without each fold of them, in their order."""

    values: Estimates
    folds: tuple[Estimates, ...]

    @classmethod
    def of_estimates(cls, values: Estimates) -> "CrossValidation":
        """Fit the values once more without each fold."""
        number = values.fitted.system.session.fold
        kept = ({name: each != k for name, each in number.items()} for k in range(FOLDS))
        betas = (values.fitted.solve(rows=rows).beta for rows in kept)
        return cls(values, tuple(replace(values, beta=beta) for beta in betas))

    def held_out(self, name: str, channel: str) -> Floats:
        """Contribution of an effect to a channel's gap, (n,), each row by values of other folds."""
        number = self.values.fitted.system.session.fold[channel]
        found: Floats = np.choose(number, [x.contribution(name, channel) for x in self.folds])
        return found

    def at_pace(self, name: str, channel: str, pace: float) -> Floats | None:
        """Contribution to a channel of an effect that follows time, were its clock to go at `pace`.

        None for an effect without a time constant.
        """
        values, session = self.values, self.values.fitted.system.session
        entries = {k: values.fitted.regressors[k] for k in values.of_effect(name)}
        if not any(_TIME_CONSTANT in dict(each.shape) for each in entries.values()):
            return None
        found = np.zeros(len(session.channels[channel].gap))
        for k, entry in entries.items():
            constant_s = dict(entry.shape).get(_TIME_CONSTANT, 0.0)
            paced = entry.with_shape(_TIME_CONSTANT, constant_s / pace) if constant_s else entry
            found += paced.columns(session, channel) @ values.coefficients(k)
        return found

    def shrink(self, name: str, channel: str) -> Shrink:
        """Shrink of a channel by one effect beside all others, expected on other motion.

        The estimate is that of held-out blocks: from what the others leave to what all leave. A
        force among the others, which no block predicts of another, is taken off as it was here. An
        effect that follows time does so at another pace in two thirds of the draws of the interval.
        """
        rows = self.values.fitted.system.session.channels[channel]
        without = rows.gap.copy()
        for other in sorted({*self.values.names} - {name, FORCE}):
            without -= self.held_out(other, channel)
        if name != FORCE:
            without -= self.values.contribution(FORCE, channel)
        left = [without - self.held_out(name, channel)]
        for made in (self.at_pace(name, channel, pace) for pace in PACES):
            if made is not None:
                left.append(without - made)
        return on_other_motion(replace(rows, gap=without), left)


def resampled(block: Integers, before: Floats, after: Floats) -> Shrink:
    """Shrink from one series (n,) to another on the same motion, resampled by blocks of time."""
    count = int(block.max()) + 1
    first = np.bincount(block, before**2, minlength=count)
    last = np.bincount(block, after**2, minlength=count)
    used = first > 0.0
    blocks, random = int(used.sum()), np.random.default_rng(7)
    weights = random.multinomial(blocks, [1.0 / blocks] * blocks, _RESAMPLES).astype(np.float64)
    estimate = _shrink(first.sum(), last.sum())
    return _of_draws(float(estimate), _shrink(weights @ first[used], weights @ last[used]))


def on_other_motion(rows: Rows, left: Sequence[Floats]) -> Shrink:
    """Shrink from a gap to what is left of it, (n,), with an interval for motion of other kinds.

    Another motion visits the regimes of this one in unknown proportions: each draw weighs them by
    a Dirichlet distribution (after Rubin, 1981, The Bayesian Bootstrap). It is one recording, as
    warm as a part of this session and in no more places: each draw looks at one part.

    Args:
        left: the first gives the estimate; each is as likely on other motion.
    """
    random = np.random.default_rng(11)
    proportions = random.standard_gamma(_SHAPE, (_RESAMPLES, _REGIMES))
    # regimes: speed in four classes, accelerating or not, which side of the travel
    known = rows.variables
    speed = np.abs(known["motor_speed_rad_s"])
    acceleration = np.abs(known["motor_acceleration_rad_s2"])
    place = known["table_position_m"]
    edges = np.quantile(speed, np.arange(1, _SPEED_CLASSES) / _SPEED_CLASSES)
    regime = 4 * np.digitize(speed, edges) + 2 * (acceleration > np.median(acceleration))
    regime = (regime + (place > np.median(place))).astype(np.int64)
    # weight of each block, (k, count): those of one part of the session
    blocks = int(rows.block.max()) + 1
    length = max(round(blocks * _PART), 1)
    first = np.random.default_rng(7).integers(0, blocks - length + 1, _RESAMPLES)[:, None]
    block = np.arange(blocks)
    weights = ((block >= first) & (block < first + length)).astype(np.float64)

    def drawn(series: Floats) -> Floats:
        count = weights.shape[1]
        cells = np.bincount(regime * count + rows.block, series**2, minlength=_REGIMES * count)
        energy: Floats = np.sum((proportions @ cells.reshape(_REGIMES, count)) * weights, axis=1)
        return energy

    before, after = drawn(rows.gap), [drawn(each) for each in left]
    chosen = np.choose(random.integers(0, len(after), _RESAMPLES), after)
    estimate = _shrink(np.sum(rows.gap**2), np.sum(left[0] ** 2))
    return _of_draws(float(estimate), _shrink(before, chosen))


def _of_draws(estimate: float, draws: Floats) -> Shrink:
    low, high = np.quantile(draws, (0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL))
    return Shrink(estimate=estimate, low=float(min(low, estimate)), high=float(max(high, estimate)))


def _shrink(before: Floats | float, after: Floats | float) -> Floats:
    ratio: Floats = np.sqrt(np.asarray(after) / np.maximum(before, 1e-300))
    return 1.0 - ratio
