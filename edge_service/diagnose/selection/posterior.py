"""Choice of effects: material ones, a posterior over sets of them, and indistinguishable ones."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from ...models.effects.effect import MATERIAL_TOLERANCES, Kind, Term
from ...models.effects.registry import effects, effects_where, error_of
from ..candidates.design_matrix import DesignMatrix
from ..candidates.null_shapes import UNKNOWN
from ..session.session import TRANSMISSION_GAP
from .evidence import Fit, Noise, fit
from .exhaustive import leading_sets
from .stepwise import select_stepwise

LEAST_RISE_OF_GAP = 0.05
"""An effect that is less than this part of the whole gap is immaterial: others are no better known.
"""
LEAST_RISE_BESIDE_ALIKE = 0.22
"""Beside a greater effect whose entry may lack what this one adds."""
COMPLETE = 0.3
"""Of what it adds: with less left beyond the floor one shape of an effect is no stopgap for the
entry of another one, which would be wrong in some way of its own."""
MISSED = 0.5
"""Of the energy that a fit explains in a channel: so much of it has a cause among its effects."""
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
    """A set of effects, and those of it that matter."""

    fit: Fit
    material: frozenset[str]


@dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    """The posterior.

    Attributes:
        best: the most probable set.
        probability: of each effect to be part of the cause.
        classes: effect -> itself and what this data cannot tell from it.
        candidates: all sets considered, best first, with their probabilities.
    """

    best: EffectSet
    probability: Mapping[str, float]
    classes: Mapping[str, tuple[str, ...]]
    candidates: Sequence[tuple[EffectSet, float]]


def select_effects(
    design: DesignMatrix,
    noise: Noise,
    priors: Mapping[str, tuple[float, float]],
    known: Sequence[int] = (),
) -> Posterior:
    """Weigh sets of effects.

    Args:
        priors: effect -> healthy mean and tolerance of its amount, for parameters.
        known: regressors of a set that was best under another noise.
    """
    best = select_stepwise(design, noise, design.candidates, known=known)
    fits = [best, fit(design, (), noise)]
    for name in list(_by_weight(design, best, noise))[:_LEADERS]:
        fits.append(_selected_among(design, noise, {name}, banned=True))
    fits += leading_sets(design, noise, fits)
    fits += [_selected_among(design, noise, {name}) for name in sorted(priors)]
    fits.append(_selected_among(design, noise, priors))
    fits = [_named_beyond(design, each, noise, priors) for each in fits]
    assessed = [
        EffectSet(each, material_names(design, each, noise, priors)) for each in _unique(fits)
    ]
    return _posterior(_simplest_first(assessed, noise))


def without(causes: Posterior, name: str) -> Posterior | None:
    """The posterior over the sets that lack an effect; None where there is none with a cause."""
    others = [c for c, _ in causes.candidates if name not in c.material]
    others.sort(key=lambda each: -each.fit.score)
    if not others or not others[0].material:
        return None
    return _posterior([(each, each.fit.score) for each in others])


def _selected_among(
    design: DesignMatrix, noise: Noise, names: Iterable[str], *, banned: bool = False
) -> Fit:
    wanted = set(names)
    allowed = [a for a in design.candidates if (design.regressors[a].name in wanted) != banned]
    return select_stepwise(design, noise, allowed)


def _named_beyond(
    design: DesignMatrix, whole: Fit, noise: Noise, priors: Mapping[str, tuple[float, float]]
) -> Fit:
    """The set with a lag that it needs beyond what a healthy drive may have: that is a cause.

    Its bounds are no calibration, which could be a little off.
    """
    tolerated = {design.regressors[k].name: k for k in range(design.tolerated)}
    lacking = []
    for name in sorted((RANGES & priors.keys() & tolerated.keys()) - whole.names(design)):
        value = float(whole.coefficients[design.first[tolerated[name]]])
        free = [a for a in design.candidates if design.regressors[a].name == name]
        if free and abs(value - priors[name][0]) > MATERIAL_TOLERANCES * priors[name][1]:
            lacking.append(free[0])
    return fit(design, (*whole.regressors[design.tolerated :], *lacking), noise)


def _unique(fits: Sequence[Fit]) -> list[Fit]:
    best: dict[tuple[int, ...], Fit] = {}
    for each in fits:
        best[tuple(sorted(each.regressors))] = each
    return list(best.values())


def _by_weight(design: DesignMatrix, whole: Fit, noise: Noise) -> list[str]:
    """Names of a fit, the one that it can spare least first."""
    loss = {
        name: whole.score - _without(design, whole, name, noise).score
        for name in whole.names(design)
    }
    return sorted(loss, key=lambda name: -loss[name])


def _without(design: DesignMatrix, whole: Fit, name: str, noise: Noise) -> Fit:
    kept = [a for a in whole.regressors[design.tolerated :] if design.regressors[a].name != name]
    return fit(design, kept, noise)


def material_names(
    design: DesignMatrix, whole: Fit, noise: Noise, priors: Mapping[str, tuple[float, float]]
) -> frozenset[str]:
    """Effects of a fit that matter: significant alone is not enough.

    Two that stand in for one another would both be idle, and nothing would be named of a gap that
    they explain: the one that can be spared is taken out, and the others are looked at again.
    """
    while True:
        names = whole.names(design)
        material = frozenset(
            name for name in names if _is_material(design, whole, name, noise, priors)
        )
        if material == names or not _is_missed(design, whole, material, noise):
            return material
        idle = [name for name in _by_weight(design, whole, noise) if name not in material]
        whole = _without(design, whole, idle[-1], noise)


def _is_missed(design: DesignMatrix, whole: Fit, material: frozenset[str], noise: Noise) -> bool:
    """Tell whether the material effects leave most of what all effects explain of a channel."""
    chosen = whole.regressors[design.tolerated :]
    kept = [a for a in chosen if design.regressors[a].name in material]
    count = int(design.first[design.tolerated])
    alone = fit(design, kept, noise, whole.coefficients[:count])
    return any(
        noise.matters(channel, alone.rms[channel])
        and alone.rms[channel] ** 2 - whole.rms[channel] ** 2
        > MISSED * (equations.square / equations.rows - whole.rms[channel] ** 2)
        for channel, equations in design.equations.items()
    )


def _is_material(
    design: DesignMatrix,
    whole: Fit,
    name: str,
    noise: Noise,
    priors: Mapping[str, tuple[float, float]],
) -> bool:
    """Tell whether an effect adds to a gap what nothing else that is named can replace."""
    if name in priors and _excess(design, whole, name, *priors[name]) <= MATERIAL_TOLERANCES:
        return False
    rises = _rises(design, whole, name, noise)
    between_encoders = effects_where(lambda effect: effect.kind is Kind.LOST_MOTION)
    alike = [_rises(design, whole, other, noise) for other in _imitated(name) & whole.names(design)]
    count = sum(design.regressors[a].name == name for a in whole.regressors[design.tolerated :])
    for channel, equations in design.equations.items():
        elsewhere = channel != TRANSMISSION_GAP and TRANSMISSION_GAP in design.equations
        if name in between_encoders and elsewhere:
            continue
        before = math.sqrt(equations.square / equations.rows)
        if not noise.matters(channel, before):
            continue
        overshadowed = any(other[channel] > rises[channel] for other in alike)
        left = noise.beyond(channel, whole.rms[channel])
        completes = count == 1 and left < COMPLETE * rises[channel]
        is_stopgap = overshadowed and not completes
        part = LEAST_RISE_BESIDE_ALIKE if is_stopgap else LEAST_RISE_OF_GAP
        if rises[channel] >= max(noise.tolerance[channel], part * before):
            return True
    return False


def _imitated(name: str) -> frozenset[str]:
    effect = effects().get(name)
    return frozenset() if effect is None else effect.imitates


def _rises(design: DesignMatrix, whole: Fit, name: str, noise: Noise) -> dict[str, float]:
    """Contribution of an effect to each channel's gap, as a root mean square.

    What is tolerated stays as it is meanwhile: it must not stretch to hide a cause.
    """
    kept = [a for a in whole.regressors[design.tolerated :] if design.regressors[a].name != name]
    count = int(design.first[design.tolerated])
    lesser = fit(design, kept, noise, whole.coefficients[:count])
    return {
        channel: math.sqrt(max(lesser.rms[channel] ** 2 - whole.rms[channel] ** 2, 0.0))
        for channel in design.equations
    }


def _excess(design: DesignMatrix, whole: Fit, name: str, healthy: float, sigma: float) -> float:
    """By how many tolerances a parameter is off, the tolerated part included."""
    mine = [a for a in whole.regressors if design.regressors[a].name == name]
    return abs(float(whole.of_regressors(design, mine).sum()) - healthy) / sigma


def _simplest_first(assessed: Sequence[EffectSet], noise: Noise) -> list[tuple[EffectSet, float]]:
    """Candidates with their scores, the best first; a parameter that is off comes before an effect.

    As many parameters, or fewer, that leave hardly more than the best set are twice as likely as
    that one, however well many observations tell them apart. So is, before the data, a part of the
    best set that leaves as little.
    """
    scored = _parts_doubled(sorted(assessed, key=lambda each: -each.fit.score), noise)
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

    What is tolerated can hold what the part lacks: nothing but its prior tells the two apart.
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
