"""Stepwise selection of a set of regressors: forward by the best one, backward by the idle ones."""

from collections import Counter
from collections.abc import Callable, Sequence

from ...messages.samples import Floats
from ...models.effects.registry import effects
from ..candidates.design_matrix import DesignMatrix
from ..candidates.regressor import CandidateRegressor
from .problem import Fit, SelectionProblem

REGRESSORS_PER_EFFECT = 4
_MOST_LEADERS = 12
_LEAST_GAIN = 3.0
_MOST_REGRESSORS = 14


def most_shapes(name: str) -> int:
    """Regressors of one effect that a set may hold; of what has no name, a few."""
    effect = effects().get(name)
    return REGRESSORS_PER_EFFECT if effect is None else effect.most_shapes


def select_stepwise(
    problem: SelectionProblem,
    candidates: Sequence[int],
    most_of: Callable[[str], int] = most_shapes,
    known: Sequence[int] = (),
) -> Fit:
    """Set that grows by the best regressor and loses what has become idle, until none is worth it.

    An effect may be there several times: two ripples, two rough stretches.

    Args:
        most_of: effect -> number of its regressors that a set may hold.
        known: regressors to begin with as well: of two that help only together, none is the first.
    """
    begun = [problem.fit(())]
    if known:
        begun.append(_pruned(problem, problem.fit(known)))
    grown = [_grown(problem, candidates, most_of, each) for each in begun]
    return max(grown, key=lambda each: each.score)


def _grown(
    problem: SelectionProblem, candidates: Sequence[int], most_of: Callable[[str], int], best: Fit
) -> Fit:
    while len(best.chosen) < _MOST_REGRESSORS:
        open_ = _open(problem.design, best, candidates, most_of)
        if not open_:
            return best
        leaders = _leaders(problem.design, open_, problem.reductions(best, open_))
        if not leaders:
            return best
        larger = problem.fits([(*best.chosen, regressor) for regressor in leaders])
        grown = max(larger, key=lambda each: each.score)
        if grown.score < best.score + _LEAST_GAIN:
            return best
        best = _pruned(problem, grown)
    return best


def _leaders(design: DesignMatrix, open_: Sequence[int], falls: Floats) -> list[int]:
    """Best regressor of each effect and form, the best of all first."""
    best: dict[tuple[str, str], tuple[float, int]] = {}
    for regressor, fall in zip(open_, falls.tolist(), strict=True):
        family = design.regressors[regressor].name, design.regressors[regressor].form
        if fall > best.get(family, (0.0, 0))[0]:
            best[family] = fall, regressor
    return [regressor for _, regressor in sorted(best.values(), reverse=True)[:_MOST_LEADERS]]


def _open(
    design: DesignMatrix, base: Fit, candidates: Sequence[int], most_of: Callable[[str], int]
) -> list[int]:
    chosen = [design.regressors[a] for a in base.chosen]
    used = Counter(regressor.name for regressor in chosen)
    loaded = most_of is most_shapes and any(_is_load(regressor) for regressor in chosen)
    loads = {regressor.form for regressor in chosen if _is_load(regressor)}
    taken = set(base.regressors)
    return [
        a
        for a in candidates
        if a not in taken
        and used[design.regressors[a].name] < most_of(design.regressors[a].name)
        and not ((loaded or design.regressors[a].form in loads) and _is_load(design.regressors[a]))
    ]


def _is_load(regressor: CandidateRegressor) -> bool:
    """Tell whether a regressor states what loads a spring: the difference of two could be any."""
    effect = effects().get(regressor.name)
    return effect is not None and effect.has_one_load and regressor.form != "late"


def _pruned(problem: SelectionProblem, grown: Fit) -> Fit:
    best = grown
    while len(best.chosen) > 1:
        smaller = [[b for b in best.chosen if b != a] for a in best.chosen]
        fewer = max(problem.fits(smaller), key=lambda each: each.score)
        if fewer.score <= best.score:
            return best
        best = fewer
    return best
