"""Prediction of each block of time by the named effects, with values fitted on all other blocks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...messages.samples import Booleans, Floats
from ..candidates.regressor import entry_regressor
from ..estimation.estimates import Estimates
from ..estimation.refine import strict_columns
from ..session.session import BLOCK_S, Integers, Session

FOLDS = 4
_LEAST_BLOCKS = 8
_TIME_CONSTANT = "time_constant_s"


@dataclass(frozen=True, slots=True, eq=False)
class Fold:
    """One fold of the blocks: by channel its rows (n,), and values fitted on all others."""

    rows: Mapping[str, Booleans]
    values: Estimates


def block_s(session: Session) -> float:
    """Length of a block: `BLOCK_S`, or an eighth of what is shorter."""
    times = [rows.variables["time_s"] for rows in session.channels.values()]
    span_s = max(float(np.ptp(each)) for each in times)
    return min(BLOCK_S, max(span_s, 1e-9) / _LEAST_BLOCKS)


def fold_of(time_s: Floats, length_s: float) -> Integers:
    """Number of the fold of each time, (n,): one block belongs to 0, the next to 1, and so on."""
    folds: Integers = np.floor(time_s / length_s).astype(np.int64) % FOLDS
    return folds


def folds_of(values: Estimates) -> tuple[Fold, ...]:
    """All folds, in their order."""
    session = values.problem.session
    length_s = block_s(session)
    folds = {n: fold_of(r.variables["time_s"], length_s) for n, r in session.channels.items()}
    return tuple(
        _fold(values, {name: each == fold for name, each in folds.items()}) for fold in range(FOLDS)
    )


def held_out_contribution(folds: Sequence[Fold], name: str, channel: str) -> Floats:
    """Contribution of an effect to a channel's gap, (n,), each row by the values of other folds."""
    found = np.zeros(len(folds[0].rows[channel]))
    for fold in folds:
        rows, values = fold.rows[channel], fold.values
        for k, regressor in enumerate(values.regressors):
            if regressor.name == name:
                found[rows] += values.columns[k][channel][rows] @ values.coefficients(k)
    return found


def contribution(values: Estimates, name: str, channel: str) -> Floats:
    """Contribution of an effect to a channel's gap by its values on all blocks, (n,)."""
    found = np.zeros(len(values.problem.session.channels[channel].gap))
    for k, regressor in enumerate(values.regressors):
        if regressor.name == name:
            found += values.columns[k][channel] @ values.coefficients(k)
    return found


def contribution_at_pace(values: Estimates, name: str, channel: str, pace: float) -> Floats | None:
    """Contribution to a channel of an effect that follows time, were its clock to go at `pace`.

    None for an effect without a time constant.
    """
    mine = [k for k, regressor in enumerate(values.regressors) if regressor.name == name]
    if not any(_TIME_CONSTANT in dict(values.regressors[k].shape) for k in mine):
        return None
    found = np.zeros(len(values.problem.session.channels[channel].gap))
    for k in mine:
        regressor = values.regressors[k]
        shape = dict(regressor.shape)
        if _TIME_CONSTANT in shape:
            shape[_TIME_CONSTANT] /= pace
        paced = entry_regressor(regressor.effect, regressor.amount, shape)
        found += paced.columns(values.problem.session, channel) @ values.coefficients(k)
    return found


def _fold(values: Estimates, rows: Mapping[str, Booleans]) -> Fold:
    """A fold; one without which nothing would be left to fit has the values of all."""
    kept = {name: ~each for name, each in rows.items()}
    if not all(each.any() for each in kept.values()):
        return Fold(rows, values)
    strict = strict_columns(values.regressors)
    beta = values.problem.solve_rows(values.columns, strict, kept)
    return Fold(rows, replace(values, beta=beta))
