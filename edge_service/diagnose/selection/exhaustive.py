"""Every set of up to three effects, weighed at once: greed begins with one that may be in none."""

import itertools
from collections.abc import Iterator, Sequence

from ..candidates.design_matrix import DesignMatrix
from .evidence import Fit, Noise, fits, reductions
from .stepwise import select_stepwise

MOST_EFFECTS = 3
_LEADING = 12
"""Sets whose shapes are sought once more, all of their effects together."""
Shapes = tuple[int, ...]


def leading_sets(design: DesignMatrix, noise: Noise, known: Sequence[Fit]) -> list[Fit]:
    """The best sets of up to three effects, each with the shapes that suit it.

    Every effect comes with its shapes where it is alone, and with those that it has beside others.

    Args:
        known: fits found so far, the best of all first.
    """
    shapes = {
        name: _shapes(design, noise, allowed, known) for name, allowed in _by_name(design).items()
    }
    found: dict[frozenset[str], Fit] = {}
    for each in fits(design, list(_sets(shapes)), noise):
        names = each.names(design)
        if names not in found or each.score > found[names].score:
            found[names] = each
    leading = sorted(found.values(), key=lambda each: -each.score)[:_LEADING]
    return [_settled(design, noise, each) for each in leading]


def _by_name(design: DesignMatrix) -> dict[str, list[int]]:
    found: dict[str, list[int]] = {}
    for regressor in design.candidates:
        found.setdefault(design.regressors[regressor].name, []).append(regressor)
    return found


def _shapes(
    design: DesignMatrix, noise: Noise, allowed: Sequence[int], known: Sequence[Fit]
) -> set[Shapes]:
    """Regressors of one effect: alone, in the best set that has it, and the best one beside all."""
    alone = select_stepwise(design, noise, allowed).regressors[design.tolerated :]
    mine = (tuple(sorted(set(each.regressors) & set(allowed))) for each in known)
    falls = reductions(design, known[0], noise, allowed)
    beside = (allowed[int(falls.argmax())],)
    return {tuple(sorted(alone)), next((each for each in mine if each), beside)} - {()}


def _sets(shapes: dict[str, set[Shapes]]) -> Iterator[Shapes]:
    for count in range(1, MOST_EFFECTS + 1):
        for names in itertools.combinations(shapes, count):
            for parts in itertools.product(*(shapes[name] for name in names)):
                yield tuple(itertools.chain(*parts))


def _settled(design: DesignMatrix, noise: Noise, found: Fit) -> Fit:
    """The best shapes of the same effects."""
    names = found.names(design)
    allowed = [a for a in design.candidates if design.regressors[a].name in names]
    return select_stepwise(design, noise, allowed, known=found.regressors[design.tolerated :])
