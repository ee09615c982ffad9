"""Normal equations of a least-squares fit: sums of products over the rows, and their solution."""

from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from ...messages.samples import Floats, Integers

Columns = npt.NDArray[np.float32]
"""Half the memory; products of theirs are summed in double precision."""
_CHUNK = 1024  # rows whose products are summed at once, in double precision
_RIDGE = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class NormalEquations:
    """Sums over the rows of one channel."""

    gram: Floats  # products of the columns, (p, p); of many sets of columns (s, p, p)
    cross: Floats  # products of the columns with the gap, (p,) or (s, p)
    square: float  # sum of squares of the gap
    rows: int  # number of rows

    @classmethod
    def of(cls, columns: Columns, gap: Floats, rows: Integers | None = None) -> Self:
        """Equations of columns (n, p) and the gap (n,), or of some of their rows only.

        Most columns show in one channel only.
        """
        chosen = np.arange(len(gap)) if rows is None else rows
        shown = np.flatnonzero([np.any(column) for column in columns.T])
        gram, cross = np.zeros((columns.shape[1],) * 2), np.zeros(columns.shape[1])
        square, product = np.zeros((len(shown),) * 2), np.zeros(len(shown))
        for start in range(0, len(chosen), _CHUNK):
            some = chosen[start : start + _CHUNK]
            part = columns[np.ix_(some, shown)].astype(np.float64)
            square += part.T @ part
            product += part.T @ gap[some]
        gram[np.ix_(shown, shown)], cross[shown] = square, product
        return cls(gram, cross, float(gap[chosen] @ gap[chosen]), len(chosen))

    def of_sets(self, index: Integers) -> "NormalEquations":
        """Equations of many sets of columns, (s, p)."""
        gram = self.gram[index[:, :, None], index[:, None, :]]
        return NormalEquations(gram, self.cross[index], self.square, self.rows)

    def mean_square(self, beta: Floats) -> Floats:
        """Mean square that each set leaves with its coefficients (s, p), (s,)."""
        modelled = (beta[:, None, :] @ self.gram)[:, 0]
        square = self.square + np.sum(beta * (modelled - 2.0 * self.cross), axis=1)
        return np.asarray(np.maximum(square, 1e-12 * self.square) / self.rows)


def solved(normal: Floats, target: Floats) -> Floats:
    """Solutions of positive systems whose rows differ by orders of magnitude, (..., p, k)."""
    diagonal = np.diagonal(normal, axis1=-2, axis2=-1)
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))[..., None]
    scaled = normal / (scale * scale.swapaxes(-2, -1)) + _RIDGE * np.eye(scale.shape[-2])
    return np.asarray(np.linalg.solve(scaled, target / scale) / scale)


def square_falls(own: Floats, schur: Floats, rest: Floats) -> Floats:
    """Fall r S^-1 r of the square by candidates of one size, (n,); 0 where the base leaves nothing.

    Args:
        own, schur: squares of their columns, and of what the base leaves of them, (n, k, k).
        rest: their products with what the base leaves of the gap, (n, k).
    """
    diagonal, left = (np.diagonal(each, axis1=1, axis2=2) for each in (own, schur))
    fit_for = np.all((diagonal > 0.0) & (left >= 1e-6 * diagonal), axis=1)
    ridge = 1e-9 * diagonal[fit_for, :, None] * np.eye(rest.shape[1])
    unit = np.linalg.solve(schur[fit_for] + ridge, rest[fit_for, :, None])[..., 0]
    found = np.zeros(len(rest))
    found[fit_for] = np.sum(rest[fit_for] * unit, axis=1)
    return found
