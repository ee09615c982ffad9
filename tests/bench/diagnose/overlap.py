"""Overlap of a diagnosis' intervals with those in which its cause really acts."""

from collections.abc import Sequence

import numpy as np

from edge_service.diagnose.result import Place
from edge_service.diagnose.session.session import Rows, Session
from edge_service.messages.samples import Floats

_CELLS = 96
_ROUNDS = 50


def overlap(
    places: Sequence[Place], ailing: Session, healthy: Session, right: frozenset[str]
) -> float | None:
    """Length that named and true intervals share, over that of both together.

    What the cause adds is the difference of two recordings of one axis, with it and without; its
    true intervals are the cells of the first named variable whose mean square is nearer to that
    of the raised cells than to that of the others (Ridler and Calvard, 1978).

    Args:
        right: variables that the gap may be a function of, and whose intervals mean something.

    Returns:
        None where nothing, or no such variable, is named first.
    """
    if not places or places[0].variable not in right:
        return None
    channel, variable = places[0].channel, places[0].variable
    values, square = _added(ailing.channels[channel], healthy.channels[channel], variable)
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, _CELLS + 1)))
    if len(edges) < 3:
        return None
    cell = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    rows = np.bincount(cell, minlength=len(edges) - 1)
    level = np.bincount(cell, square, minlength=len(edges) - 1) / np.maximum(rows, 1)
    true = raised(level)
    middle = 0.5 * (edges[1:] + edges[:-1])
    named = np.zeros_like(true)
    for place in places:
        if (place.channel, place.variable) == (channel, variable):
            named |= (middle >= place.low) & (middle <= place.high)
    width = np.diff(edges)
    return float(width[true & named].sum() / width[true | named].sum())


def raised(level: Floats) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Cells nearer to the mean of the higher than to that of the lower ones, (n,)."""
    bound = float(np.mean(level))
    for _ in range(_ROUNDS):
        above = level > bound
        if not above.any() or above.all():
            break
        bound = 0.5 * float(level[above].mean() + level[~above].mean())
    found: np.ndarray[tuple[int], np.dtype[np.bool_]] = level >= bound
    return found


def _added(ailing: Rows, healthy: Rows, variable: str) -> tuple[Floats, Floats]:
    """Values of a variable, and square of what the cause adds, where both have a row, (n,) each."""
    _, one, other = np.intersect1d(
        np.round(ailing.variables["time_s"], 4),
        np.round(healthy.variables["time_s"], 4),
        return_indices=True,
    )
    added = ailing.gap[one] - healthy.gap[other]
    return ailing.variables[variable][one], added**2
