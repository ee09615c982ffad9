"""Posterior over sets of effects: how sure each is, and which this data cannot tell apart.

Considered are the stepwise choice, what is best without each of its effects, and all sets of up to
three, as a greedy start may be in none of them. An effect counts only as far as it is material: as
far as the fit would lose what nothing else that is named can replace; significance is not enough.
"""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...messages.samples import Floats
from ...models.effects.effect import MATERIAL_TOLERANCES, Kind, Term
from ...models.effects.registry import effects, effects_where, error_of
from ..candidates.force_pulses import FORCE, ForcePulse
from ..candidates.regressors import UNKNOWN
from ..residual.noise import Noise
from ..session.session import TORQUE_GAP, TRANSMISSION_GAP
from .problem import Fit, SelectionProblem

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
MOST_EFFECTS = 3
_LEADING = 12
"""Sets whose shapes are sought once more, all of their effects together."""
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
LEAST_FREE_SHARE = 0.3
"""Share of the motion that must be free of a force for other causes to be sought there alone."""


@dataclass(frozen=True, slots=True, eq=False)
class EffectSet:
    """Fit of a set of effects, and those of it that matter."""

    fit: Fit
    material: frozenset[str]


@dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    """Posterior over the sets of effects that were considered for a problem.

    Attributes:
        best: the most probable set.
        probability: of each effect to be part of the cause, summed over the sets.
        classes: effect -> itself and what this data cannot tell from it.
        candidates: all sets considered, best first, with their probabilities.
        left_rms: root mean square that the best set leaves, by channel; outside a force, if any.
    """

    problem: SelectionProblem
    best: EffectSet
    probability: Mapping[str, float]
    classes: Mapping[str, tuple[str, ...]]
    candidates: Sequence[tuple[EffectSet, float]]
    left_rms: Mapping[str, float]

    @classmethod
    def of_scored(
        cls, problem: SelectionProblem, scored: Sequence[tuple[EffectSet, float]]
    ) -> "Posterior":
        """Weigh sets by the logarithm of their evidence, the best first."""
        ranked = [each for each, _ in scored]
        top = scored[0][1]
        weights = [math.exp(max(score - top, -700.0)) for _, score in scored]
        total = sum(weights)
        candidates = [(each, weight / total) for each, weight in zip(ranked, weights, strict=True)]
        names = {name for each in ranked for name in each.material}
        probability = {
            name: sum(p for each, p in candidates if name in each.material)
            for name in sorted(names)
        }
        best = ranked[0]
        classes = {
            name: (name, *sorted(_rivals(name, best, scored))) for name in sorted(best.material)
        }
        return cls(problem, best, probability, classes, candidates, best.fit.rms)

    def without(self, name: str) -> "Posterior | None":
        """Posterior over the sets that lack an effect; None where there is none with a cause."""
        others = [each for each, _ in self.candidates if name not in each.material]
        others.sort(key=lambda each: -each.fit.score)
        if not others or not others[0].material:
            return None
        return Posterior.of_scored(self.problem, [(each, each.fit.score) for each in others])

    @property
    def unexplained(self) -> dict[str, float]:
        """Share of each channel's energy above the floor that the best set leaves."""
        return self.problem.noise.unexplained_shares(self.problem.session, self.left_rms)

    @property
    def force_nm(self) -> Floats:
        """Forces of the best set in the torque, N m, (n,)."""
        pulses, coefficients = self.problem.coefficients(self.best.fit, FORCE)
        return self.problem.design.modelled(TORQUE_GAP, pulses, coefficients)

    def exceeds_floor(self, *channels: str) -> bool:
        """True if one of some channels was recorded and its gap matters."""
        noise, recorded = self.problem.noise, self.problem.session.channels
        return any(noise.matters(name, recorded[name].rms) for name in channels if name in recorded)


def select_model(problem: SelectionProblem) -> Posterior:
    """Select effects twice: the residual of the first selection shows the noise of the second."""
    first = select_effects(problem).best.fit
    posterior = select_effects(problem.with_noise_of(first), first.chosen)
    return _beside_force(posterior) if FORCE in posterior.best.material else posterior


def select_effects(problem: SelectionProblem, known: Sequence[int] = ()) -> Posterior:
    """Select sets of effects and weigh them against each other.

    Args:
        known: regressors of a set that was best under another noise.
    """
    design = problem.design
    best = problem.stepwise(design.candidates, known=known)
    among = [
        {each.name for each in design.regressors} - {name}
        for name in problem.names_by_weight(best)[:_LEADERS]
    ]
    fits = [best, problem.fit(())]
    fits += [problem.stepwise(design.of_effects(names)) for names in among]
    fits += leading_sets(problem, fits)
    parameters = [*({name} for name in sorted(problem.priors)), set(problem.priors)]
    fits += [problem.stepwise(design.of_effects(names)) for names in parameters]
    fits = [_named_beyond(problem, each) for each in fits]
    unique = {tuple(sorted(each.regressors)): each for each in fits}
    sets = [EffectSet(each, material_names(problem, each)) for each in unique.values()]
    return Posterior.of_scored(problem, _simplest_first(sets, problem.noise))


def leading_sets(problem: SelectionProblem, known: Sequence[Fit]) -> list[Fit]:
    """Best sets of up to three effects, each with the shapes that suit it.

    Every effect comes with its shapes where it is alone, and with those that it has beside others.

    Args:
        known: fits found so far, the best of all first.
    """
    shapes: dict[str, set[tuple[int, ...]]] = {}
    for name, allowed in problem.design.by_name().items():
        alone = tuple(sorted(problem.stepwise(allowed).chosen))
        beside = (allowed[int(problem.reductions(known[0], allowed).argmax())],)
        mine = (tuple(sorted(set(each.chosen) & set(allowed))) for each in known)
        shapes[name] = {alone, next((each for each in mine if each), beside)} - {()}
    found: dict[frozenset[str], Fit] = {}
    for each in problem.fits(list(_sets(shapes))):
        if each.names not in found or each.score > found[each.names].score:
            found[each.names] = each
    leading = sorted(found.values(), key=lambda each: -each.score)[:_LEADING]
    return [
        problem.stepwise(problem.design.of_effects(each.names), known=each.chosen)
        for each in leading
    ]


def _sets(shapes: Mapping[str, set[tuple[int, ...]]]) -> Iterator[tuple[int, ...]]:
    for count in range(1, MOST_EFFECTS + 1):
        for names in itertools.combinations(shapes, count):
            for parts in itertools.product(*(shapes[name] for name in names)):
                yield tuple(itertools.chain(*parts))


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


def material_names(problem: SelectionProblem, whole: Fit) -> frozenset[str]:
    """Effects of a fit that matter.

    Two that stand in for one another would both be idle, and nothing would be named of a gap that
    they explain: the one that can be spared is taken out, and the others are looked at again.
    """
    while True:
        material = _material(problem, whole)
        if material == whole.names or not _is_missed(problem, whole, material):
            return material
        idle = [name for name in problem.names_by_weight(whole) if name not in material]
        whole = problem.without(whole, idle[-1])


def _is_missed(problem: SelectionProblem, whole: Fit, material: frozenset[str]) -> bool:
    """True if the material effects leave most of what all effects explain of a channel."""
    design, noise = problem.design, problem.noise
    kept = [a for a in whole.chosen if design.regressors[a].name in material]
    alone = problem.pinned_to(whole).fit(kept)
    return any(
        noise.matters(channel, alone.rms[channel])
        and alone.rms[channel] ** 2 - whole.rms[channel] ** 2
        > MISSED * (each.square / each.rows - whole.rms[channel] ** 2)
        for channel, each in design.equations.items()
    )


def _material(problem: SelectionProblem, whole: Fit) -> frozenset[str]:
    """Effects that add to a gap what nothing else that is named can replace."""
    design, noise, pinned = problem.design, problem.noise, problem.pinned_to(whole)
    between_encoders = effects_where(lambda effect: effect.kind is Kind.LOST_MOTION)
    rises: dict[str, dict[str, float]] = {}  # effect -> its part of each channel's gap
    for name in whole.names:
        lesser = pinned.without(whole, name)
        rises[name] = {
            channel: math.sqrt(max(lesser.rms[channel] ** 2 - rms**2, 0.0))
            for channel, rms in whole.rms.items()
        }
    found = set()
    for name, mine in rises.items():
        regressors, coefficients = problem.coefficients(whole, name)
        if name in problem.priors:
            healthy, sigma = problem.priors[name]
            if abs(float(coefficients.sum()) - healthy) / sigma <= MATERIAL_TOLERANCES:
                continue
        effect = effects().get(name)
        alike = effect.imitates & whole.names if effect else frozenset()
        is_one = sum(a in whole.chosen for a in regressors) == 1
        for channel, each in design.equations.items():
            elsewhere = channel != TRANSMISSION_GAP and TRANSMISSION_GAP in design.equations
            before = math.sqrt(each.square / each.rows)
            if (name in between_encoders and elsewhere) or not noise.matters(channel, before):
                continue
            overshadowed = any(rises[other][channel] > mine[channel] for other in alike)
            left = noise.beyond(channel, whole.rms[channel])
            is_stopgap = overshadowed and not (is_one and left < COMPLETE * mine[channel])
            part = LEAST_RISE_BESIDE_ALIKE if is_stopgap else LEAST_RISE_OF_GAP
            if mine[channel] >= max(noise.tolerance[channel], part * before):
                found.add(name)
    return frozenset(found)


def _beside_force(posterior: Posterior) -> Posterior:
    """Posterior on other causes from the motion that no force disturbs.

    A force, which no motion predicts, hides and feigns them while it acts.
    """
    problem, regressors = posterior.problem, posterior.problem.design.regressors
    pulses, free = [], {}
    for channel, rows in problem.session.channels.items():
        free[channel] = np.ones(len(rows.gap), np.bool_)
    for a in posterior.best.fit.regressors:
        pulse = regressors[a]
        if isinstance(pulse, ForcePulse):
            pulses.append(a)
            for channel, rows in problem.session.channels.items():
                free[channel] &= ~pulse.covers(rows.variables["time_s"])
    if min(float(each.mean()) for each in free.values()) < LEAST_FREE_SHARE:
        return posterior
    first = next(k for k, each in enumerate(regressors) if isinstance(each, ForcePulse))
    calm = select_effects(problem.restricted(first, free))
    beside = calm.best.fit
    both = problem.pinned_to(beside).fit([*beside.chosen, *pulses])
    return replace(
        calm,
        problem=problem,
        best=EffectSet(both, calm.best.material | {FORCE}),
        probability={**calm.probability, FORCE: posterior.probability[FORCE]},
        classes={**calm.classes, FORCE: posterior.classes[FORCE]},
    )


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


def _rivals(name: str, best: EffectSet, scored: Sequence[tuple[EffectSet, float]]) -> set[str]:
    """Effects that stand in for one in a set that is as good."""
    found: set[str] = set()
    for each, score in scored:
        close = score >= scored[0][1] - TIED
        if close and name not in each.material and each.material:
            found |= each.material - best.material
    return found - {UNKNOWN}
