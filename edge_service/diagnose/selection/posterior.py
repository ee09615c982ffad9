"""Posterior over sets of effects: how sure each is, and which this data cannot tell apart."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from ...messages.samples import Floats
from ...models.effects.effect import Term
from ...models.effects.registry import effects_where, error_of
from ..candidates.regressors import FORCE, UNKNOWN, ForcePulse
from ..residual.noise import Noise
from ..session.session import rms
from .problem import EffectSet, SelectionProblem

TIED = 5.0
"""Scores closer than this leave a doubt worth naming."""
PARAMETERS = tuple(map(error_of, (Term.COULOMB, Term.VISCOUS, Term.INERTIA, Term.LAG, Term.GAIN)))
"""Parameters of the model, those first that change most often on a machine."""
_SIMPLER = 2.0
_AS_LITTLE = 1.0 / 3.0
"""Of the tolerance: by so much more a set may leave and still leave as little."""
_DISTURBED_S = 0.2
"""Before and after a force, with the controller's answer to its end."""
LEAST_FREE_SHARE = 0.3
"""Share of the motion that must be free of a force for other causes to be sought there alone."""


@dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    """Posterior over the sets of effects that were considered for a problem."""

    problem: SelectionProblem
    best: EffectSet  # the most probable set
    probability: Mapping[str, float]  # of each effect to be part of the cause, over all sets
    classes: Mapping[str, tuple[str, ...]]  # effect -> itself and what data cannot tell from it
    candidates: Sequence[tuple[EffectSet, float]]  # all sets, best first, with probabilities
    left_rms: Mapping[str, float]  # that the best set leaves, by channel; outside a force, if any

    @classmethod
    def of_scored(
        cls, problem: SelectionProblem, scored: Sequence[tuple[EffectSet, float]]
    ) -> "Posterior":
        """Weigh sets by the logarithm of their evidence, the best first."""
        ranked, scores = zip(*scored, strict=True)
        candidates = list(zip(ranked, special.softmax(scores).tolist(), strict=True))
        probability = {
            name: sum(p for each, p in candidates if name in each.material)
            for name in sorted(frozenset().union(*(each.material for each in ranked)))
        }
        best = ranked[0]
        close = [each.material for each, score in scored if score >= scores[0] - TIED]
        classes = {}
        for name in sorted(best.material):
            rivals = frozenset().union(*(each for each in close if name not in each))
            classes[name] = (name, *sorted(rivals - best.material - {UNKNOWN}))
        return cls(problem, best, probability, classes, candidates, best.fit.rms)

    def without(self, name: str) -> "Posterior | None":
        """Posterior over the sets that lack an effect; None where there is none with a cause."""
        others = [(e, e.fit.score) for e, _ in self.candidates if name not in e.material]
        others.sort(key=lambda pair: -pair[1])
        is_cause = bool(others) and bool(others[0][0].material)
        return Posterior.of_scored(self.problem, others) if is_cause else None

    @property
    def unexplained(self) -> dict[str, float]:
        """Share of each channel's energy above the floor that the best set leaves."""
        return self.problem.noise.unexplained_shares(self.problem.session, self.left_rms)

    def part(self, name: str, channel: str) -> Floats:
        """Part of an effect of the best set in a channel's gap, N m or m, (n,)."""
        mine, coefficients = self.problem.coefficients(self.best.fit, name)
        columns = self.problem.design.columns[channel]
        return columns[:, self.problem.design.indices(mine)].astype(np.float64) @ coefficients

    @property
    def unnamed(self) -> set[str]:
        """Channels in which a cause without a name matters."""
        most = self.problem.noise.tolerance if UNKNOWN in self.best.material else {}
        return {name for name in most if rms(self.part(UNKNOWN, name)) > most[name]}

    @property
    def exceeding(self) -> set[str]:
        """Channels whose gap matters."""
        recorded, matters = self.problem.session.channels, self.problem.noise.matters
        return {name for name, rows in recorded.items() if matters(name, rows.rms)}


def select_model(problem: SelectionProblem) -> Posterior:
    """Select effects twice: the residual of the first selection shows the noise of the second."""
    first = select_effects(problem).best.fit
    noise = problem.noise.of_residual(problem.session, problem.machine, problem.residuals(first))
    posterior = select_effects(replace(problem, noise=noise), first.chosen)
    return _beside_force(posterior) if FORCE in posterior.best.material else posterior


def select_effects(problem: SelectionProblem, known: Sequence[int] = ()) -> Posterior:
    """Select sets of effects, also from regressors known under another noise, and weigh them."""
    return Posterior.of_scored(problem, _ranked(problem, known))


def _beside_force(posterior: Posterior) -> Posterior:
    """Posterior on other causes from the motion that no force disturbs."""
    problem, regressors = posterior.problem, posterior.problem.design.regressors
    channels, pulses = problem.session.channels, []
    free = {channel: np.ones(len(rows.gap), np.bool_) for channel, rows in channels.items()}
    for a in posterior.best.fit.regressors:
        pulse = regressors[a]
        if isinstance(pulse, ForcePulse):
            pulses.append(a)
            for channel, rows in channels.items():
                time_s = rows.variables["time_s"]
                before = time_s < pulse.start_s - _DISTURBED_S
                free[channel] &= before | (time_s >= pulse.end_s + _DISTURBED_S)
    if min(float(each.mean()) for each in free.values()) < LEAST_FREE_SHARE:
        return posterior
    first = next(k for k, each in enumerate(regressors) if isinstance(each, ForcePulse))
    design = problem.design.restricted(first, problem.session, free)
    calm = select_effects(replace(problem, design=design))
    beside = calm.best.fit
    both = problem.pinned_to(beside).fit([*beside.chosen, *pulses])
    best = EffectSet(both, calm.best.material | {FORCE})
    probability = {**calm.probability, FORCE: posterior.probability[FORCE]}
    classes = {**calm.classes, FORCE: posterior.classes[FORCE]}
    return replace(calm, problem=problem, best=best, probability=probability, classes=classes)


def _ranked(problem: SelectionProblem, known: Sequence[int]) -> list[tuple[EffectSet, float]]:
    """Candidates and scores, the best first; a parameter that is off comes before an effect.

    As many parameters, or fewer, that leave hardly more than the best set are twice as likely as
    that one, unless others have to stretch for it. So is, before the data, a part of the best set
    that leaves as little: the nuisances can hold what it lacks. And friction of a healthy axis
    wanders: where heat seems to be a cause, a level that is off, and drifts by less than anybody
    acts on, may be no more than that.
    """
    sets, noise, scored = problem.considered(known), problem.noise, []
    best = max(sets, key=lambda each: each.fit.score)
    for each in sets:
        gains = set() < each.material < best.material and _leaves_as_little(each, best, noise)
        scored.append((each, each.fit.score + (math.log(_SIMPLER) if gains else 0.0)))
    scored.sort(key=lambda pair: -pair[1])
    (best, top), parameters = scored[0], set(PARAMETERS)
    if best.material <= parameters:
        return scored
    simple = [
        each
        for each, _ in scored
        if set() < each.material <= parameters and len(each.material) <= len(best.material)
        if _leaves_as_little(each, best, noise) and not problem.stretched(each.fit)
    ]
    simple.sort(key=lambda each: [PARAMETERS.index(name) for name in sorted(each.material)])
    level = top + math.log(_SIMPLER / max(len(simple), 1))
    rest = [(each, score) for each, score in scored if each not in simple]
    if not simple and best.material & effects_where(lambda effect: effect.is_thermal):
        wandering = []
        for each, score in rest:
            matters = any(noise.matters(name, rms) for name, rms in each.fit.rms.items())
            alone = set() < each.material <= parameters and not matters
            wandering.append((each, max(score, top - math.log(_SIMPLER)) if alone else score))
        rest = sorted(wandering, key=lambda pair: -pair[1])
    return [(each, level) for each in simple] + rest


def _leaves_as_little(one: EffectSet, best: EffectSet, noise: Noise) -> bool:
    return all(
        one.fit.rms[channel] ** 2 - rms**2 <= (_AS_LITTLE * noise.tolerance[channel]) ** 2
        for channel, rms in best.fit.rms.items()
    )
