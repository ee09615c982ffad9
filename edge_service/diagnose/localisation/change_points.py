"""Stretches of a sequence whose level is raised, from pairs of change points."""

from collections.abc import Sequence

import numpy as np

from ...messages.samples import Floats

_AS_RAISED = 0.4
"""Part of the strongest stretch's excess from which on another one counts."""
_MOST = 4


def raised_intervals(level: Floats, weight: Floats) -> list[tuple[int, int]]:
    """Half-open intervals [i, j) of cells whose level is raised, the strongest first.

    Each is the pair of change points that leaves the least weighted square when the level is one
    constant between them and another outside (Scott and Knott, 1974).

    Args:
        level, weight: of each cell, (n,).
    """
    first = _raised(level, weight, 0, len(level))
    if first is None:
        return [(0, len(level))]
    found, open_ = [first], [(0, first[0]), (first[1], len(level))]
    rest = _outside(level, weight, first)
    least = rest + _AS_RAISED * (_mean(level, weight, first) - rest)
    while open_ and len(found) < _MOST:
        low, high = open_.pop(0)
        also = _raised(level, weight, low, high)
        if also is not None and _mean(level, weight, also) > least:
            found.append(also)
            open_ += [(low, also[0]), (also[1], high)]
    return _merged(found)


def _raised(level: Floats, weight: Floats, low: int, high: int) -> tuple[int, int] | None:
    """Best pair of change points in [low, high); None where no inner level is higher."""
    mass = np.concatenate(([0.0], np.cumsum(weight[low:high])))
    total = np.concatenate(([0.0], np.cumsum((weight * level)[low:high])))
    inside = mass[None, :] - mass[:, None]
    sums = total[None, :] - total[:, None]
    outside = mass[-1] - inside
    usable = (np.triu(np.ones_like(inside), 1) > 0.0) & (inside > 0.0) & (outside > 0.0)
    if not usable.any():
        return None
    inner = np.divide(sums, inside, out=np.zeros_like(sums), where=usable)
    outer = np.divide(total[-1] - sums, outside, out=np.zeros_like(sums), where=usable)
    step = inner - outer
    gain = np.where(usable & (step > 0.0), inside * outside / mass[-1] * step**2, -1.0)
    i, j = np.unravel_index(int(np.argmax(gain)), gain.shape)
    return (low + int(i), low + int(j)) if gain[i, j] > 0.0 else None


def _mean(level: Floats, weight: Floats, span: tuple[int, int]) -> float:
    inside = slice(*span)
    return float(level[inside] @ weight[inside]) / max(float(weight[inside].sum()), 1e-300)


def _outside(level: Floats, weight: Floats, span: tuple[int, int]) -> float:
    kept = np.ones(len(level), dtype=bool)
    kept[slice(*span)] = False
    return float(level[kept] @ weight[kept]) / max(float(weight[kept].sum()), 1e-300)


def _merged(found: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Neighbours that touch as one; the strongest stays first."""
    strongest = found[0]
    merged: list[tuple[int, int]] = []
    for low, high in sorted(found):
        if merged and merged[-1][1] >= low:
            merged[-1] = merged[-1][0], high
        else:
            merged.append((low, high))
    merged.sort(key=lambda span: not span[0] <= strongest[0] < span[1])
    return merged
