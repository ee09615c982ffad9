"""Every set of up to three effects, weighed at once: greed begins with one that may be in none."""

import itertools
from collections.abc import Iterator, Sequence

from ..candidates.design_matrix import Dictionary
from .evidence import Fit, Noise, fits, reductions
from .stepwise import pursue

MOST_EFFECTS = 3
_LEADING = 12
"""Sets whose shapes are sought once more, all of their effects together."""
Shapes = tuple[int, ...]


def leading_sets(dictionary: Dictionary, noise: Noise, known: Sequence[Fit]) -> list[Fit]:
    """The best sets of up to three effects, each with the shapes that suit it.

    Every effect comes with its shapes where it is alone, and with those that it has beside others.

    Args:
        known: fits found so far, the best of all first.
    """
    shapes = {
        name: _shapes(dictionary, noise, allowed, known)
        for name, allowed in _by_name(dictionary).items()
    }
    found: dict[frozenset[str], Fit] = {}
    for each in fits(dictionary, list(_sets(shapes)), noise):
        names = each.names(dictionary)
        if names not in found or each.score > found[names].score:
            found[names] = each
    leading = sorted(found.values(), key=lambda each: -each.score)[:_LEADING]
    return [_settled(dictionary, noise, each) for each in leading]


def _by_name(dictionary: Dictionary) -> dict[str, list[int]]:
    found: dict[str, list[int]] = {}
    for atom in dictionary.candidates:
        found.setdefault(dictionary.atoms[atom].name, []).append(atom)
    return found


def _shapes(
    dictionary: Dictionary, noise: Noise, allowed: Sequence[int], known: Sequence[Fit]
) -> set[Shapes]:
    """Atoms of one effect: alone, in the best set that has it, and the best one beside all."""
    alone = pursue(dictionary, noise, allowed).atoms[dictionary.tolerated :]
    mine = (tuple(sorted(set(each.atoms) & set(allowed))) for each in known)
    falls = reductions(dictionary, known[0], noise, allowed)
    beside = (allowed[int(falls.argmax())],)
    return {tuple(sorted(alone)), next((each for each in mine if each), beside)} - {()}


def _sets(shapes: dict[str, set[Shapes]]) -> Iterator[Shapes]:
    for count in range(1, MOST_EFFECTS + 1):
        for names in itertools.combinations(shapes, count):
            for parts in itertools.product(*(shapes[name] for name in names)):
                yield tuple(itertools.chain(*parts))


def _settled(dictionary: Dictionary, noise: Noise, found: Fit) -> Fit:
    """The best shapes of the same effects."""
    names = found.names(dictionary)
    allowed = [a for a in dictionary.candidates if dictionary.atoms[a].name in names]
    return pursue(dictionary, noise, allowed, known=found.atoms[dictionary.tolerated :])
