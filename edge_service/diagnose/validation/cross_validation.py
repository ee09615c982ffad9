"""Prediction of each block of time by the named effects, with values fitted on all other blocks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...messages.samples import Booleans, Floats
from ..candidates.regressor import entry_atom
from ..estimation.refine import strict_columns
from ..estimation.values import Values
from ..session.session import BLOCK_S, Integers, Session

FOLDS = 4
_LEAST_BLOCKS = 8
_TIME_CONSTANT = "time_constant_s"


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """One fold of the blocks: by channel its rows (n,), and values fitted on all others."""

    rows: Mapping[str, Booleans]
    values: Values


def block_s(session: Session) -> float:
    """Length of a block: `BLOCK_S`, or an eighth of what is shorter."""
    times = [rows.variables["time_s"] for rows in session.channels.values()]
    span_s = max(float(np.ptp(each)) for each in times)
    return min(BLOCK_S, max(span_s, 1e-9) / _LEAST_BLOCKS)


def fold_of(time_s: Floats, length_s: float) -> Integers:
    """Number of the fold of each time, (n,): one block belongs to 0, the next to 1, and so on."""
    folds: Integers = np.floor(time_s / length_s).astype(np.int64) % FOLDS
    return folds


def by_blocks(values: Values) -> tuple[Part, ...]:
    """All folds, in their order."""
    session = values.problem.session
    length_s = block_s(session)
    folds = {n: fold_of(r.variables["time_s"], length_s) for n, r in session.channels.items()}
    return tuple(
        _part(values, {name: each == fold for name, each in folds.items()}) for fold in range(FOLDS)
    )


def predicted(parts: Sequence[Part], name: str, channel: str) -> Floats:
    """Contribution of an effect to a channel's gap, (n,), each row by the values of other folds."""
    found = np.zeros(len(parts[0].rows[channel]))
    for part in parts:
        rows, values = part.rows[channel], part.values
        for k, atom in enumerate(values.atoms):
            if atom.name == name:
                found[rows] += values.columns[k][channel][rows] @ values.coefficients(k)
    return found


def taken(values: Values, name: str, channel: str) -> Floats:
    """Contribution of an effect to a channel's gap by its values on all blocks, (n,)."""
    found = np.zeros(len(values.problem.session.channels[channel].gap))
    for k, atom in enumerate(values.atoms):
        if atom.name == name:
            found += values.columns[k][channel] @ values.coefficients(k)
    return found


def at_pace(values: Values, name: str, channel: str, pace: float) -> Floats | None:
    """Contribution to a channel of an effect that follows time, were its clock to go at `pace`.

    None for an effect without a time constant.
    """
    mine = [k for k, atom in enumerate(values.atoms) if atom.name == name]
    if not any(_TIME_CONSTANT in dict(values.atoms[k].shape) for k in mine):
        return None
    found = np.zeros(len(values.problem.session.channels[channel].gap))
    for k in mine:
        atom = values.atoms[k]
        shape = dict(atom.shape)
        if _TIME_CONSTANT in shape:
            shape[_TIME_CONSTANT] /= pace
        paced = entry_atom(atom.effect, atom.amount, shape)
        found += paced.columns(values.problem.session, channel) @ values.coefficients(k)
    return found


def _part(values: Values, rows: Mapping[str, Booleans]) -> Part:
    """A fold; one without which nothing would be left to fit has the values of all."""
    kept = {name: ~each for name, each in rows.items()}
    if not all(each.any() for each in kept.values()):
        return Part(rows, values)
    strict = strict_columns(values.atoms)
    beta = values.problem.solve_rows(values.columns, strict, kept)
    return Part(rows, replace(values, beta=beta))
