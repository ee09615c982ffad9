"""Exhaustive selection: all sets of up to three effects, as a greedy start may be in none."""

import itertools
from collections.abc import Iterator, Sequence

from ..candidates.design_matrix import DesignMatrix
from .problem import Fit, SelectionProblem
from .stepwise import select_stepwise

MOST_EFFECTS = 3
_LEADING = 12
"""Sets whose shapes are sought once more, all of their effects together."""
Shapes = tuple[int, ...]


def leading_sets(problem: SelectionProblem, known: Sequence[Fit]) -> list[Fit]:
    """Best sets of up to three effects, each with the shapes that suit it.

    Every effect comes with its shapes where it is alone, and with those that it has beside others.

    Args:
        known: fits found so far, the best of all first.
    """
    shapes = {
        name: _shapes(problem, allowed, known) for name, allowed in _by_name(problem.design).items()
    }
    found: dict[frozenset[str], Fit] = {}
    for each in problem.fits(list(_sets(shapes))):
        if each.names not in found or each.score > found[each.names].score:
            found[each.names] = each
    leading = sorted(found.values(), key=lambda each: -each.score)[:_LEADING]
    return [_settled(problem, each) for each in leading]


def _by_name(design: DesignMatrix) -> dict[str, list[int]]:
    found: dict[str, list[int]] = {}
    for regressor in design.candidates:
        found.setdefault(design.regressors[regressor].name, []).append(regressor)
    return found


def _shapes(problem: SelectionProblem, allowed: Sequence[int], known: Sequence[Fit]) -> set[Shapes]:
    """Regressors of one effect: alone, in the best set that has it, and the best one beside all."""
    alone = select_stepwise(problem, allowed).chosen
    mine = (tuple(sorted(set(each.chosen) & set(allowed))) for each in known)
    falls = problem.reductions(known[0], allowed)
    beside = (allowed[int(falls.argmax())],)
    return {tuple(sorted(alone)), next((each for each in mine if each), beside)} - {()}


def _sets(shapes: dict[str, set[Shapes]]) -> Iterator[Shapes]:
    for count in range(1, MOST_EFFECTS + 1):
        for names in itertools.combinations(shapes, count):
            for parts in itertools.product(*(shapes[name] for name in names)):
                yield tuple(itertools.chain(*parts))


def _settled(problem: SelectionProblem, found: Fit) -> Fit:
    """Fit the best shapes of the same effects."""
    allowed = problem.design.of_effects(found.names)
    return select_stepwise(problem, allowed, known=found.chosen)
