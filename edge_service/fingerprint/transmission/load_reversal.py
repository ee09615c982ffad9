"""A drive with play pushes its table with one flank and brakes it with the other.

While inertia (or an external force) outdoes the friction of the guides, the spring between motor
and table is pulled instead of pushed. With play the stretch then falls by its whole width, which a
fit without this column takes for compliance. The force at which the flank turns is the friction
itself; it is searched for, and the column is used only where it explains more than chance.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ...messages.samples import Booleans, Floats
from ...recordings.conditioning import low_pass
from ...regression.linear import effective_size
from ...regression.prepared_run import ORDER, PreparedRun

SHARES = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
"""First candidates for the force at which the flank turns, over the greatest load against the
motion; the best one's surroundings are searched again."""
_REFINEMENTS = 2
_REFINED = 9
_CROSSING = 0.1
"""A row whose column is further from -1, 0 and 1 lies where the table crosses its play."""
_OUTLYING = 5.0
_TRIMMINGS = 3
_RINGING_ROWS = 1
"""So does one whose residual is so many standard deviations away; the filters ring beside it."""
LEAST_ROWS = 20
"""Fewer rows on the other flank do not tell the play: they lie beside its crossing."""
LEAST_GAIN = 25.0
"""Fall of the sum of squares, in variances of the residual, that is no chance of the search."""


@dataclass(frozen=True, slots=True, eq=False)
class LoadReversal:
    """Column of the force at which the load on the spring reverses."""

    column: Floats  # -1, 0 or 1, and in between where the flank turns, (n,)
    whole: Booleans  # rows where it does not turn, (n,)
    shown: bool  # rows on the other flank are left, and not only rows that have to be left out


def find_load_reversal(
    runs: Sequence[PreparedRun], loads: Sequence[Floats], design: Floats, stretch_m: Floats
) -> LoadReversal | None:
    """The column that explains most of the stretch, if it explains play at all.

    Args:
        runs: k of them; loads: on the spring by inertia and external forces, one (m,) each.
        design: of all moving rows, (n, p); stretch_m: (n,).
    """
    known, rank = _basis(design)
    left = stretch_m - known @ (known.T @ stretch_m)
    against = [-load * np.sign(run.speed_rad_s) for run, load in zip(runs, loads, strict=True)]
    pairs = list(zip(runs, against, strict=True))
    greatest = max(float(np.max(each[run.moving], initial=0.0)) for run, each in pairs)
    levels = greatest * np.array(SHARES)
    for _ in range(_REFINEMENTS + 1):
        columns = np.concatenate([_candidates(*each, levels) for each in pairs])
        rest = columns - known @ (known.T @ columns)
        power = np.sum(rest**2, axis=0)
        power[power <= 1e-6 * np.sum(columns**2, axis=0)] = np.inf
        slope = left @ rest / power
        gain = np.where(slope < 0.0, slope**2 * power, 0.0)  # play shortens the stretch
        best = int(np.argmax(gain))
        if not gain[best] > 0.0:
            return None
        residual = left - slope[best] * rest[:, best]
        column = columns[:, best]
        low, high = levels[max(best - 1, 0)], levels[min(best + 1, len(levels) - 1)]
        levels = np.linspace(low, high, _REFINED)
    freedom = max(effective_size(residual) - rank - 1.0, 1.0)
    if gain[best] <= LEAST_GAIN * float(residual @ residual) / freedom:
        return None
    whole = _not_crossing(np.column_stack((design, column)), stretch_m, column)
    turned = np.abs(column) > 0.5
    shown = int(np.sum(whole & turned)) >= LEAST_ROWS
    return LoadReversal(column, whole if shown else whole & ~turned, shown)


def _not_crossing(design: Floats, stretch_m: Floats, column: Floats) -> Booleans:
    """Rows in which the table does not cross its play, by the column and by what is left, (n,)."""
    whole: Booleans = np.abs(column - np.round(column)) < _CROSSING
    for _ in range(_TRIMMINGS):
        fit = np.linalg.lstsq(design[whole] / _norms(design), stretch_m[whole], rcond=None)[0]
        left = np.abs(stretch_m - design / _norms(design) @ fit)
        whole &= left < _OUTLYING * float(np.median(left[whole])) / 0.6745
    beside: Booleans = ndimage.minimum_filter1d(whole, 2 * _RINGING_ROWS + 1, mode="nearest")
    return beside


def _candidates(run: PreparedRun, against: Floats, levels: Floats) -> Floats:
    """Rows of sgn(v) where the load against the motion (n,) exceeds each level, (m, k)."""
    way = np.sign(run.speed_rad_s)
    columns = np.column_stack([np.where(against > level, way, 0.0) for level in levels])
    for column in columns.T:
        column[:] = low_pass(column, run.settings.cutoff_hz, ORDER, run.period_s)
    return run.moving_rows(columns)


def _basis(design: Floats) -> tuple[Floats, int]:
    """Orthonormal columns that span the design, (n, r), and r."""
    left, singular, _ = np.linalg.svd(design / _norms(design), full_matrices=False)
    rank = int(np.sum(singular > 1e-10 * singular[0]))
    return left[:, :rank], rank


def _norms(design: Floats) -> Floats:
    norms = np.linalg.norm(design, axis=0)
    return np.where(norms > 0.0, norms, 1.0)
