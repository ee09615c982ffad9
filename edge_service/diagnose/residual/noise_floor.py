"""Noise floor of a gap: the part that neither the motion nor a repeat of it predicts.

Two passes of the same motion differ by noise, and by nothing that any model could know. What smooth
functions of the motion say of the gap in another block of time is therefore no noise, nor is what
comes again at the same place at the same speed. Bursts, such as those of a force, are not ordinary
and do not raise the floor.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from ...messages.samples import Floats
from ...regression.linear import effective_size
from ..session.session import Rows, Session, rms
from .folds import block_s, fold_of
from .structure import predicted_structure

_PIECE_ROWS = 24
_MOST_SPREAD = 0.6
"""Of the logarithm of the pieces' root mean squares; beyond it pieces are not of one kind."""
_QUARTILES_APART = 1.349
"""Distance of the quartiles of a normal distribution, in standard deviations."""
_SAME_RAD, _SAME_SPEED, _SAME_ACCELERATION = 0.05, 0.1, 0.3
"""Rows are repeats within so much of the motor's angle, and so much in log(1 + .) of the others."""
_SLOW_RAD_S, _SOFT_RAD_S2 = 1.0, 50.0
_LEAST_REPEATS, _MOST_REPEATS = 200, 4000
_REPEATS_MAY_MISS = 1.3
"""Repeats are few and lie where the axis goes most: by so much they may be too quiet."""
_MORE_THAN_NOISE = 1.5
"""Root mean square over the floor from which on a rest shows nothing of its noise."""
_QUARTILE = 0.6745
"""Median of the size of a standard normal variable."""


@dataclass(frozen=True, slots=True)
class Floor:
    """Noise of one channel.

    Attributes:
        rms: root mean square.
        independent: number of independent observations that it has; infinite where structure, or
            bursts, hide how it goes on.
    """

    rms: float
    independent: float


def noise_floor(session: Session, left: Mapping[str, Floats]) -> dict[str, Floor]:
    """Noise floor of a residual, by channel.

    Args:
        left: residual, by channel, (n,).
    """
    structure, length_s = predicted_structure(session, left), block_s(session)
    found = {}
    for name, each in left.items():
        rest, rows = each - structure[name], session.channels[name]
        floor = ordinary_rms(rest)
        again = _repeated_rms(rows, rest, session.baseline.ratio_m_per_rad, length_s)
        level = floor if again is None else min(floor, _REPEATS_MAY_MISS * again)
        is_noise = rms(rest) < _MORE_THAN_NOISE * level
        found[name] = Floor(level, effective_size(rest) if is_noise else math.inf)
    return found


def ordinary_rms(values: Floats) -> float:
    """Root mean square of a series (n,), as the middle half of its pieces shows it.

    The pieces' own root mean squares are taken for log-normal.
    """
    if not len(values):
        return 0.0
    whole = rms(values)
    count = len(values) // _PIECE_ROWS
    if count < 4:
        return whole
    pieces = values[: count * _PIECE_ROWS].reshape(count, _PIECE_ROWS)
    logarithm = 0.5 * np.log(np.maximum(np.mean(pieces**2, axis=1), 1e-300))
    low, high = np.quantile(logarithm, (0.25, 0.75))
    spread = min((high - low) / _QUARTILES_APART, _MOST_SPREAD)
    return min(float(np.exp(0.5 * (low + high) + spread**2)), whole)


def _repeated_rms(
    rows: Rows, values: Floats, ratio_m_per_rad: float, length_s: float
) -> float | None:
    """Root mean square of a series (n,) as its repeats differ; None where there are too few.

    Repeats are rows of different blocks of time, at one place, speed, acceleration and direction.
    """
    known = rows.variables
    speed, acceleration = known["motor_speed_rad_s"], known["motor_acceleration_rad_s2"]
    state = np.column_stack(
        (
            known["table_position_m"] / ratio_m_per_rad / _SAME_RAD,
            np.sign(speed) * np.log1p(np.abs(speed) / _SLOW_RAD_S) / _SAME_SPEED,
            np.sign(acceleration)
            * np.log1p(np.abs(acceleration) / _SOFT_RAD_S2)
            / _SAME_ACCELERATION,
        )
    )
    fold = fold_of(known["time_s"], length_s)
    even = np.flatnonzero(fold % 2 == 0)
    odd = np.flatnonzero(fold % 2 == 1)
    if min(len(even), len(odd)) < _LEAST_REPEATS:
        return None
    apart, nearest = KDTree(state[odd]).query(state[even], distance_upper_bound=1.0)
    order = np.argsort(apart)[:_MOST_REPEATS]
    order = order[np.isfinite(apart[order])]
    if len(order) < _LEAST_REPEATS:
        return None
    differ = values[even[order]] - values[odd[nearest[order]]]
    return float(np.median(np.abs(differ)) / _QUARTILE / np.sqrt(2.0))
