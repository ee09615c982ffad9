"""Cross validation: each block of time predicted by values that were fitted on other blocks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...messages.samples import Booleans, Floats
from ..estimation.estimates import Estimates
from ..estimation.least_squares import strict_columns
from ..residual.folds import FOLDS, block_s, fold_of

_TIME_CONSTANT = "time_constant_s"


@dataclass(frozen=True, slots=True, eq=False)
class Fold:
    """Fold of the blocks: by channel its rows (n,), and values fitted on all others."""

    rows: Mapping[str, Booleans]
    values: Estimates


def folds_of(values: Estimates) -> tuple[Fold, ...]:
    """Folds of a session and the values fitted without each, in their order."""
    session = values.system.session
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
        for k in values.of_effect(name):
            found[rows] += values.columns[k][channel][rows] @ values.coefficients(k)
    return found


def contribution_at_pace(values: Estimates, name: str, channel: str, pace: float) -> Floats | None:
    """Contribution to a channel of an effect that follows time, were its clock to go at `pace`.

    None for an effect without a time constant.
    """
    session, mine = values.system.session, values.of_effect(name)
    if not any(_TIME_CONSTANT in dict(values.regressors[k].shape) for k in mine):
        return None
    found = np.zeros(len(session.channels[channel].gap))
    for k in mine:
        entry = values.regressors[k]
        constant_s = dict(entry.shape).get(_TIME_CONSTANT)
        paced = entry if constant_s is None else entry.with_shape(_TIME_CONSTANT, constant_s / pace)
        found += paced.columns(session, channel) @ values.coefficients(k)
    return found


def _fold(values: Estimates, rows: Mapping[str, Booleans]) -> Fold:
    """Fold; one without which nothing would be left to fit has the values of all."""
    kept = {name: ~each for name, each in rows.items()}
    if not all(each.any() for each in kept.values()):
        return Fold(rows, values)
    strict = strict_columns(values.regressors)
    beta = values.system.solve_rows(values.columns, strict, kept)
    return Fold(rows, replace(values, beta=beta))
