"""Sets of effects by forward selection and backward pruning."""

from collections import Counter
from collections.abc import Mapping, Sequence

from ...messages.samples import Floats
from ..candidates.design_matrix import Dictionary
from ..candidates.regressor import Atom
from .evidence import Fit, Noise, fit, fits, reductions

ATOMS_PER_EFFECT = 4
_MOST_LEADERS = 12
MOST_OF = {
    **{"external_force": 10, "lead_error": 6, "backlash": 3},
    **{"compliance": 2, "stribeck": 2, "presliding": 1},
}
"""Of effects that are there more often, or less: sums of many shapes of one could be anything."""
_LEAST_GAIN = 3.0
_MOST_ATOMS = 14


def pursue(
    dictionary: Dictionary,
    noise: Noise,
    candidates: Sequence[int],
    pinned: Floats | None = None,
    most_of: Mapping[str, int] = MOST_OF,
    known: Sequence[int] = (),
) -> Fit:
    """The set that grows by the best atom, and loses what has become idle, until none is worth it.

    An effect may be there several times: two ripples, two rough stretches. Where the coefficients
    of what is tolerated are pinned they do not follow.

    Args:
        known: atoms to begin with as well: of two that help only together, none is the first.
    """
    begun = [fit(dictionary, (), noise, pinned)]
    if known:
        begun.append(_pruned(dictionary, fit(dictionary, known, noise, pinned), noise, pinned))
    grown = [_grown(dictionary, noise, candidates, pinned, most_of, each) for each in begun]
    return max(grown, key=lambda each: each.score)


def _grown(
    dictionary: Dictionary,
    noise: Noise,
    candidates: Sequence[int],
    pinned: Floats | None,
    most_of: Mapping[str, int],
    best: Fit,
) -> Fit:
    while len(best.atoms) - dictionary.tolerated < _MOST_ATOMS:
        open_ = _open(dictionary, best, candidates, most_of)
        if not open_:
            return best
        leaders = _leaders(dictionary, open_, reductions(dictionary, best, noise, open_))
        if not leaders:
            return best
        chosen = best.atoms[dictionary.tolerated :]
        larger = fits(dictionary, [(*chosen, atom) for atom in leaders], noise, pinned)
        grown = max(larger, key=lambda each: each.score)
        if grown.score < best.score + _LEAST_GAIN:
            return best
        best = _pruned(dictionary, grown, noise, pinned)
    return best


def _leaders(dictionary: Dictionary, open_: Sequence[int], falls: Floats) -> list[int]:
    """The best atom of each effect and form, the best of all first."""
    best: dict[tuple[str, str], tuple[float, int]] = {}
    for atom, fall in zip(open_, falls.tolist(), strict=True):
        family = dictionary.atoms[atom].name, dictionary.atoms[atom].form
        if fall > best.get(family, (0.0, 0))[0]:
            best[family] = fall, atom
    return [atom for _, atom in sorted(best.values(), reverse=True)[:_MOST_LEADERS]]


def _open(
    dictionary: Dictionary, base: Fit, candidates: Sequence[int], most_of: Mapping[str, int]
) -> list[int]:
    chosen = [dictionary.atoms[a] for a in base.atoms[dictionary.tolerated :]]
    used = Counter(atom.name for atom in chosen)
    loaded = most_of is MOST_OF and any(_is_load(atom) for atom in chosen)
    loads = {atom.form for atom in chosen if _is_load(atom)}
    taken = set(base.atoms)
    return [
        a
        for a in candidates
        if a not in taken
        and used[dictionary.atoms[a].name] < most_of.get(dictionary.atoms[a].name, ATOMS_PER_EFFECT)
        and not ((loaded or dictionary.atoms[a].form in loads) and _is_load(dictionary.atoms[a]))
    ]


def _is_load(atom: Atom) -> bool:
    """Tell whether an atom says what loads a spring: the difference of two loads could be any."""
    return atom.name == "compliance" and atom.form != "late"


def _pruned(dictionary: Dictionary, grown: Fit, noise: Noise, pinned: Floats | None) -> Fit:
    best = grown
    while True:
        chosen = best.atoms[dictionary.tolerated :]
        if len(chosen) < 2:
            return best
        smaller = [[b for b in chosen if b != a] for a in chosen]
        fewer = max(fits(dictionary, smaller, noise, pinned), key=lambda each: each.score)
        if fewer.score <= best.score:
            return best
        best = fewer
