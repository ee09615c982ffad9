"""Posterior over sets of effects: how sure each is, and which this data cannot tell apart."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from ...models.effects.effect import MATERIAL_TOLERANCES, Term
from ...models.effects.registry import effects_where, error_of
from ..candidates.null_shapes import UNKNOWN
from .exhaustive import leading_sets
from .materiality import material_names
from .noise import Noise
from .problem import Fit, SelectionProblem
from .stepwise import select_stepwise

TIED = 5.0
"""Scores closer than this leave a doubt worth naming."""
PARAMETERS = tuple(map(error_of, (Term.COULOMB, Term.VISCOUS, Term.INERTIA, Term.LAG, Term.GAIN)))
"""Parameters of the model, those first that change most often on a machine."""
RANGES = frozenset({error_of(Term.LAG)})
"""Parameters of which a healthy axis may have anything within a range."""
_SIMPLER = 2.0
_AS_LITTLE = 1.0 / 3.0
"""Of the tolerance: by so much more a set may leave and still leave as little."""
_LEADERS = 5


@dataclass(frozen=True, slots=True, eq=False)
class EffectSet:
    """Fit of a set of effects, and those of it that matter."""

    fit: Fit
    material: frozenset[str]


@dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    """Posterior over the sets of effects that were considered.

    Attributes:
        best: the most probable set.
        probability: of each effect to be part of the cause, summed over the sets.
        classes: effect -> itself and what this data cannot tell from it.
        candidates: all sets considered, best first, with their probabilities.
    """

    best: EffectSet
    probability: Mapping[str, float]
    classes: Mapping[str, tuple[str, ...]]
    candidates: Sequence[tuple[EffectSet, float]]


def select_effects(problem: SelectionProblem, known: Sequence[int] = ()) -> Posterior:
    """Select sets of effects and weigh them against each other.

    Args:
        known: regressors of a set that was best under another noise.
    """
    design = problem.design
    best = select_stepwise(problem, design.candidates, known=known)
    fits = [best, problem.fit(())]
    for name in problem.names_by_weight(best)[:_LEADERS]:
        others = {each.name for each in design.regressors} - {name}
        fits.append(_selected_among(problem, others))
    fits += leading_sets(problem, fits)
    fits += [_selected_among(problem, {name}) for name in sorted(problem.priors)]
    fits.append(_selected_among(problem, problem.priors))
    fits = [_named_beyond(problem, each) for each in fits]
    sets = [EffectSet(each, material_names(problem, each)) for each in _unique(fits)]
    return _posterior(_simplest_first(sets, problem.noise))


def without(posterior: Posterior, name: str) -> Posterior | None:
    """Posterior over the sets that lack an effect; None where there is none with a cause."""
    others = [each for each, _ in posterior.candidates if name not in each.material]
    others.sort(key=lambda each: -each.fit.score)
    if not others or not others[0].material:
        return None
    return _posterior([(each, each.fit.score) for each in others])


def _selected_among(problem: SelectionProblem, names: Collection[str]) -> Fit:
    return select_stepwise(problem, problem.design.of_effects(names))


def _named_beyond(problem: SelectionProblem, whole: Fit) -> Fit:
    """Fit the set with a lag that it needs beyond what a healthy drive may have: that is a cause.

    Its bounds are no calibration, which could be a little off.
    """
    design, priors = problem.design, problem.priors
    nuisances = {design.regressors[k].name: k for k in range(design.nuisances)}
    lacking = []
    for name in sorted((RANGES & priors.keys() & nuisances.keys()) - whole.names):
        value = float(whole.coefficients[design.first[nuisances[name]]])
        free = design.of_effects({name})
        if free and abs(value - priors[name][0]) > MATERIAL_TOLERANCES * priors[name][1]:
            lacking.append(free[0])
    return problem.fit((*whole.chosen, *lacking))


def _unique(fits: Sequence[Fit]) -> list[Fit]:
    best: dict[tuple[int, ...], Fit] = {}
    for each in fits:
        best[tuple(sorted(each.regressors))] = each
    return list(best.values())


def _simplest_first(sets: Sequence[EffectSet], noise: Noise) -> list[tuple[EffectSet, float]]:
    """Candidates with their scores, the best first; a parameter that is off comes before an effect.

    As many parameters, or fewer, that leave hardly more than the best set are twice as likely as
    that one, however well many observations tell them apart. So is, before the data, a part of the
    best set that leaves as little.
    """
    scored = _parts_doubled(sorted(sets, key=lambda each: -each.fit.score), noise)
    ranked = [each for each, _ in scored]
    best = ranked[0]
    if best.material <= set(PARAMETERS):
        return scored
    simple = [
        each
        for each in ranked
        if 0 < len(each.material) <= len(best.material)
        and each.material <= set(PARAMETERS)
        and _leaves_as_little(each, best, noise)
    ]
    simple.sort(key=lambda each: [PARAMETERS.index(name) for name in sorted(each.material)])
    level = scored[0][1] + math.log(_SIMPLER / max(len(simple), 1))
    first = [(each, level) for each in simple]
    rest = [(each, score) for each, score in scored if each not in simple]
    if not simple and best.material & effects_where(lambda effect: effect.is_thermal):
        rest = _with_wandering(rest, noise)
    return first + rest


def _parts_doubled(ranked: Sequence[EffectSet], noise: Noise) -> list[tuple[EffectSet, float]]:
    """Candidates with their scores, the best first; a part of the best that leaves as little gains.

    The nuisances can hold what the part lacks: nothing but its prior tells the two apart.
    """
    best = ranked[0]
    scored = [
        (each, each.fit.score + math.log(_SIMPLER))
        if each.material and each.material < best.material and _leaves_as_little(each, best, noise)
        else (each, each.fit.score)
        for each in ranked
    ]
    return sorted(scored, key=lambda pair: -pair[1])


def _with_wandering(
    scored: Sequence[tuple[EffectSet, float]], noise: Noise
) -> list[tuple[EffectSet, float]]:
    """Candidates with their scores, parameters that leave nothing that matters raised.

    Friction of a healthy axis wanders: a level that is off, and drifts by less than anybody acts
    on, may be no more than that, whatever the drift resembles.
    """
    top = scored[0][1]
    raised = [
        (each, max(score, top - math.log(_SIMPLER)))
        if each.material
        and each.material <= set(PARAMETERS)
        and not any(noise.matters(channel, rms) for channel, rms in each.fit.rms.items())
        else (each, score)
        for each, score in scored
    ]
    return sorted(raised, key=lambda pair: -pair[1])


def _leaves_as_little(one: EffectSet, best: EffectSet, noise: Noise) -> bool:
    return all(
        one.fit.rms[channel] ** 2 - rms**2 <= (_AS_LITTLE * noise.tolerance[channel]) ** 2
        for channel, rms in best.fit.rms.items()
    )


def _posterior(scored: Sequence[tuple[EffectSet, float]]) -> Posterior:
    ranked = [each for each, _ in scored]
    top = scored[0][1]
    weights = [math.exp(max(score - top, -700.0)) for _, score in scored]
    total = sum(weights)
    candidates = [(each, weight / total) for each, weight in zip(ranked, weights, strict=True)]
    names = {name for each in ranked for name in each.material}
    probability = {
        name: sum(p for each, p in candidates if name in each.material) for name in sorted(names)
    }
    best = ranked[0]
    classes = {name: (name, *sorted(_rivals(name, best, scored))) for name in sorted(best.material)}
    return Posterior(best, probability, classes, candidates)


def _rivals(name: str, best: EffectSet, scored: Sequence[tuple[EffectSet, float]]) -> set[str]:
    """Effects that stand in for one in a set that is as good."""
    found: set[str] = set()
    for each, score in scored:
        close = score >= scored[0][1] - TIED
        if close and name not in each.material and each.material:
            found |= each.material - best.material
    return found - {UNKNOWN}
