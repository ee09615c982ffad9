"""Selection problem: which sets of regressors explain the gap, scored on equal terms for all."""

import itertools
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ...messages.samples import Floats, Integers
from ...models.effects.effect import MATERIAL_TOLERANCES, Effect, Kind
from ...models.effects.registry import effects, effects_where
from ...models.machine import Machine
from ..candidates.design_matrix import DesignMatrix, force_pulses, healthy_priors
from ..candidates.normal_equations import solved, square_falls
from ..candidates.regressors import (
    FORCE,
    UNKNOWN,
    CandidateRegressor,
    EmpiricalShape,
    candidates_of,
    most_shapes,
    null_shapes,
)
from ..residual.noise import Noise
from ..session.session import TORQUE_GAP, TRANSMISSION_GAP, Session

NAME_COST = 4.0
"""Each effect is there with odds of 1 to 55 before anything is measured."""
UNNAMED_COST = NAME_COST + math.log(20.0)
"""Of twenty causes one is none that an entry describes (assumption)."""
_ROUNDS, _AT_ONCE, _PINNED, _LEAST_GAIN = 6, 256, 1e9, 3.0
_MOST_LEADERS, _MOST_REGRESSORS, _MOST_SPARED = 12, 14, 5
MOST_EFFECTS = 3
_LEADING = 12
"""Sets whose shapes are sought once more, all of their effects together."""
LEAST_RISE_OF_GAP = 0.05
"""An effect that is less than this part of the whole gap is no better known than others."""
LEAST_RISE_BESIDE_ALIKE = 0.22
"""Beside a greater effect whose entry, or a greater cause whose guess, may lack what it adds."""
COMPLETE = 0.3
"""Of what it adds: with less left beyond the floor one shape of an effect is no stopgap for
another one's entry, which would be wrong in some way of its own."""
MISSED = 0.5
"""Of the energy that a fit explains in a channel: so much of it has a cause among its effects."""
MOST_STRETCH = 6.0
"""Tolerances by which a parameter that is not named may be off."""


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Fit of a set of candidate regressors and the nuisances to all channels."""

    chosen: tuple[int, ...]  # the candidates
    names: frozenset[str]  # effects among them
    regressors: tuple[int, ...]  # nuisances first, then the candidates
    columns: Integers  # of the regressors, (p,)
    coefficients: Floats  # of the same, (p,)
    rms: Mapping[str, float]  # root mean square that is left, by channel
    score: float  # logarithm of the evidence, up to a constant


@dataclass(frozen=True, slots=True, eq=False)
class EffectSet:
    """Fit of a set of effects, and those of it that matter."""

    fit: Fit
    material: frozenset[str]


@dataclass(frozen=True, slots=True, eq=False)
class SelectionProblem:
    """Session, candidates, noise and priors, by which any set of effects is scored."""

    session: Session
    machine: Machine
    design: DesignMatrix
    noise: Noise
    priors: Mapping[str, tuple[float, float]]  # parameter effect -> healthy mean, tolerance
    pinned: Floats | None = None  # coefficients of the nuisances, (p,), if they must not follow

    @classmethod
    def of_session(cls, session: Session, machine: Machine, library: Sequence[Effect]) -> Self:
        """Pose the selection among the effects of a library that a session could show."""
        names = {each.name for each in library}
        entries = candidates_of(session, [each for each in library if each.name != FORCE])
        more: list[CandidateRegressor] = list(null_shapes(session, names))
        noise = Noise.of_gap(session, machine)
        prior = healthy_priors(machine, session.runs[0].period_s, session.baseline.coulomb_nm)
        if TORQUE_GAP in session.channels and FORCE in names:
            bare = DesignMatrix.of_session(session, prior)
            healthy = cls(session, machine, bare, noise, {})
            more += force_pulses(session, healthy.residuals(healthy.fit(()))[TORQUE_GAP])
        design = DesignMatrix.of_session(session, prior, entries, more)
        alone = (p for p in prior if len(p.regressor.effect.parameters) == 1)
        priors = {p.regressor.name: (p.mean, p.sigma) for p in alone if not p.regressor.shape}
        return cls(session, machine, design, noise, priors)

    def pinned_to(self, whole: Fit) -> Self:
        """Pin the nuisances to those of a fit: they must not stretch to hide a cause."""
        return replace(self, pinned=whole.coefficients[: self.design.first[self.design.nuisances]])

    def fit(self, chosen: Sequence[int]) -> Fit:
        """Fit the nuisances and the chosen candidates."""
        return self.fits([chosen])[0]

    def fits(self, sets: Sequence[Sequence[int]]) -> list[Fit]:
        """Fit many sets of candidates; those with as many columns are solved at once.

        Each channel has its own noise scale, found together with the coefficients. The score is
        -1/2 sum_c n_c log(s_c^2) with n_c effective observations, less what the prior of the
        nuisances and, as in Schwarz (1978), the number of coefficients and of shapes tried cost.
        """
        regressors = self.design.regressors
        sizes: dict[int, list[int]] = {}
        for k, chosen in enumerate(sets):
            sizes.setdefault(sum(regressors[a].size for a in chosen), []).append(k)
        found: dict[int, Fit] = {}
        for alike in sizes.values():
            for start in range(0, len(alike), _AT_ONCE):
                some = alike[start : start + _AT_ONCE]
                found.update(zip(some, self._solved([sets[k] for k in some]), strict=True))
        return [found[k] for k in range(len(sets))]

    def _solved(self, sets: Sequence[Sequence[int]]) -> list[Fit]:
        design, noise = self.design, self.noise
        regressors = [(*range(design.nuisances), *chosen) for chosen in sets]
        index = np.array([design.indices(each) for each in regressors])
        equations = {name: each.of_sets(index) for name, each in design.equations.items()}
        prior, mean = design.precision[index], design.mean[index]
        if self.pinned is not None:
            mean[:, : len(self.pinned)] = self.pinned
            prior[:, : len(self.pinned)] *= _PINNED
        left = {n: np.full(len(sets), each.square / each.rows) for n, each in equations.items()}
        variance = {name: np.maximum(each, 1e-300) for name, each in left.items()}
        for _ in range(_ROUNDS):
            normal, target = np.eye(index.shape[1]) * prior[:, None, :], prior * mean
            for name, each in equations.items():
                weight = noise.effective[name] / each.rows / variance[name]
                normal += weight[:, None, None] * each.gram
                target += weight[:, None] * each.cross
            beta = solved(normal, target[..., None])[..., 0]
            left = {name: each.mean_square(beta) for name, each in equations.items()}
            variance = {name: left[name] + noise.discrepancy[name] ** 2 for name in equations}
        score = -0.5 * np.sum((beta - mean) ** 2 * prior, axis=1)
        for name, each in variance.items():
            score -= 0.5 * noise.effective[name] * np.log(each)
        each_cost = 0.5 * math.log(sum(noise.effective.values()))
        found = []
        for k, chosen in enumerate(sets):
            some = [design.regressors[a] for a in chosen]
            shapes = sum(math.log(design.alternatives[a]) for a in chosen)
            shapes += each_cost * sum(each.size for each in some)
            unnamed = [x for x in some if isinstance(x, EmpiricalShape) and x.name == UNKNOWN]
            causes = UNNAMED_COST * len({bool(each.curves.torque) for each in unnamed})
            names = frozenset(each.name for each in some)
            causes += NAME_COST * len(names - {UNKNOWN})  # of no name one a channel
            evidence = float(score[k] - (shapes + causes))
            rms = {name: math.sqrt(each[k]) for name, each in left.items()}
            solution = regressors[k], index[k], beta[k], rms, evidence
            found.append(Fit(tuple(chosen), names, *solution))
        return found

    def stretched(self, whole: Fit) -> dict[str, float]:
        """Parameters that a fit has further off than a healthy axis may, in tolerances."""
        design, places = self.design, self.design.first[: self.design.nuisances]
        off = np.abs(whole.coefficients[places] - design.mean[places])
        off *= design.precision[places] ** 0.5
        return {design.regressors[k].name: off[k] for k in np.flatnonzero(off > MOST_STRETCH)}

    def without(self, whole: Fit, name: str) -> Fit:
        """Fit the set without one of its effects."""
        return self.fit([a for a in whole.chosen if self.design.regressors[a].name != name])

    def names_by_weight(self, whole: Fit) -> list[str]:
        """Names of a fit, the one that it can spare least first."""
        return sorted(whole.names, key=lambda name: self.without(whole, name).score)

    def reductions(self, base: Fit, candidates: Sequence[int]) -> Floats:
        """Fall of the weighted square by each candidate added to a fit, to first order, (n,)."""
        design, noise = self.design, self.noise
        index = design.indices(base.regressors)
        weighted = [
            (noise.effective[name] / each.rows / noise.variance(name, base.rms[name]), each)
            for name, each in design.equations.items()
        ]
        across = np.sum([weight * each.gram[:, index] for weight, each in weighted], axis=0)
        cross = np.sum([weight * each.cross for weight, each in weighted], axis=0)
        prior, mean = design.precision[index], design.mean[index]
        carried = solved(np.diag(prior) + across[index], across.T).T
        rest = cross - carried @ (prior * mean + cross[index])
        found = np.zeros(len(candidates))
        sizes = np.array([design.regressors[a].size for a in candidates])
        for size in np.unique(sizes).tolist():
            which = np.flatnonzero(sizes == size)
            mine = design.first[np.array(candidates)[which]][:, None] + np.arange(size)
            square = mine[:, :, None], mine[:, None, :]
            own = np.sum([weight * each.gram[square] for weight, each in weighted], axis=0)
            schur = own - carried[mine] @ across[mine].swapaxes(1, 2)
            found[which] = square_falls(own, schur, rest[mine])
        return found

    def stepwise(
        self,
        candidates: Sequence[int],
        most_of: Callable[[str], int] = most_shapes,
        known: Sequence[int] = (),
    ) -> Fit:
        """Select a set that grows by the best regressor and loses what has become idle.

        An effect may be there several times: two ripples, two rough stretches.

        Args:
            most_of: effect -> number of its regressors that a set may hold.
            known: regressors to begin with as well: of two that help only together, none is first.
        """
        begun = [self.fit(()), *([self._pruned(self.fit(known))] if known else [])]
        return max((self._grown(candidates, most_of, x) for x in begun), key=lambda x: x.score)

    def _grown(self, candidates: Sequence[int], most_of: Callable[[str], int], best: Fit) -> Fit:
        while len(best.chosen) < _MOST_REGRESSORS:
            open_ = self._open(best, candidates, most_of)
            # the best regressor of each effect and form, the best of all first
            falls: dict[tuple[str, str], tuple[float, int]] = {}
            for a, fall in zip(open_, self.reductions(best, open_).tolist(), strict=True):
                family = self.design.regressors[a].name, self.design.regressors[a].form
                if fall > falls.get(family, (0.0, 0))[0]:
                    falls[family] = fall, a
            leaders = sorted(falls.values(), reverse=True)[:_MOST_LEADERS]
            larger = self.fits([(*best.chosen, a) for _, a in leaders])
            grown = max(larger, key=lambda each: each.score, default=best)
            if grown.score < best.score + _LEAST_GAIN:
                return best
            best = self._pruned(grown)
        return best

    def _open(
        self, base: Fit, candidates: Sequence[int], most_of: Callable[[str], int]
    ) -> list[int]:
        """Candidates that may come to a set: only one may state what loads a spring."""
        regressors = self.design.regressors
        chosen = [regressors[a] for a in base.chosen]
        used = Counter(each.name for each in chosen)
        loads = {each.form for each in chosen if _is_load(each)}
        loaded = most_of is most_shapes and bool(loads)
        return [
            a
            for a in candidates
            if a not in base.regressors and used[regressors[a].name] < most_of(regressors[a].name)
            if not ((loaded or regressors[a].form in loads) and _is_load(regressors[a]))
        ]

    def _pruned(self, best: Fit) -> Fit:
        while len(best.chosen) > 1:
            smaller = [[b for b in best.chosen if b != a] for a in best.chosen]
            fewer = max(self.fits(smaller), key=lambda each: each.score)
            if fewer.score <= best.score:
                return best
            best = fewer
        return best

    def considered(self, known: Sequence[int] = ()) -> list[EffectSet]:
        """Sets worth weighing: greedy ones, the best of up to three effects, parameters alone."""
        design = self.design
        best = self.stepwise(design.candidates, known=known)
        among = [
            {each.name for each in design.regressors} - {name}
            for name in self.names_by_weight(best)[:_MOST_SPARED]
        ]
        fits = [best, self.fit(())]
        fits += [self.stepwise(design.of_effects(names)) for names in among]
        fits += self.leading_sets(fits)
        parameters = [*({name} for name in sorted(self.priors)), set(self.priors)]
        fits += [self.stepwise(design.of_effects(names)) for names in parameters]
        unique = {tuple(sorted(each.regressors)): each for each in fits}
        return [EffectSet(each, self.material_names(each)) for each in unique.values()]

    def leading_sets(self, known: Sequence[Fit]) -> list[Fit]:
        """Best sets of up to three effects, each with the shapes that suit it.

        Every effect comes with its shapes where it is alone, and with those beside others.

        Args:
            known: fits found so far, the best of all first.
        """
        shapes: dict[str, set[tuple[int, ...]]] = {}
        for name in dict.fromkeys(self.design.regressors[k].name for k in self.design.candidates):
            allowed = self.design.of_effects({name})
            alone = tuple(sorted(self.stepwise(allowed).chosen))
            beside = (allowed[int(self.reductions(known[0], allowed).argmax())],)
            mine = (tuple(sorted(set(each.chosen) & set(allowed))) for each in known)
            shapes[name] = {alone, next((each for each in mine if each), beside)} - {()}
        sets = []
        for count in range(1, MOST_EFFECTS + 1):
            for names in itertools.combinations(shapes, count):
                parts = itertools.product(*(shapes[name] for name in names))
                sets += [tuple(itertools.chain(*each)) for each in parts]
        found: dict[frozenset[str], Fit] = {}
        for each in self.fits(sets):
            if each.names not in found or each.score > found[each.names].score:
                found[each.names] = each
        leading = sorted(found.values(), key=lambda each: -each.score)[:_LEADING]
        return [
            self.stepwise(self.design.of_effects(each.names), known=each.chosen) for each in leading
        ]

    def material_names(self, whole: Fit) -> frozenset[str]:
        """Effects of a fit that matter: significance is not enough.

        Two that stand in for one another would both be idle: the one that can be spared is taken
        out, as long as the material ones leave most of what all explain of a channel.
        """
        while True:
            material = self._material(whole)
            if material == whole.names:
                return material
            kept = [a for a in whole.chosen if self.design.regressors[a].name in material]
            alone = self.pinned_to(whole).fit(kept)
            is_missed = any(
                self.noise.matters(channel, alone.rms[channel])
                and alone.rms[channel] ** 2 - whole.rms[channel] ** 2
                > MISSED * (each.square / each.rows - whole.rms[channel] ** 2)
                for channel, each in self.design.equations.items()
            )
            if not is_missed:
                return material
            idle = [name for name in self.names_by_weight(whole) if name not in material]
            whole = self.without(whole, idle[-1])

    def _material(self, whole: Fit) -> frozenset[str]:
        """Effects that add to a gap what nothing else that is named can replace."""
        design, noise, pinned = self.design, self.noise, self.pinned_to(whole)
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
            regressors, coefficients = self.coefficients(whole, name)
            healthy, sigma = self.priors.get(name, (math.inf, 1.0))
            if abs(float(coefficients.sum()) - healthy) <= MATERIAL_TOLERANCES * sigma:
                continue
            effect = effects().get(name)
            alike = {UNKNOWN, *effect.imitates} & whole.names if effect else set()
            is_one = UNKNOWN not in alike and sum(a in whole.chosen for a in regressors) == 1
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

    def coefficients(self, whole: Fit, name: str) -> tuple[list[int], Floats]:
        """Regressors of a fit that bear a name, and their coefficients."""
        mine = [a for a in whole.regressors if self.design.regressors[a].name == name]
        owner = np.searchsorted(self.design.first, whole.columns, side="right") - 1
        return mine, whole.coefficients[np.isin(owner, mine)]

    def residuals(self, best: Fit) -> dict[str, Floats]:
        """Residual that a fit leaves of the gap with all its regressors, by channel, (n,)."""
        return {
            name: rows.gap
            - self.design.columns[name][:, best.columns].astype(np.float64) @ best.coefficients
            for name, rows in self.session.channels.items()
        }


def _is_load(regressor: CandidateRegressor) -> bool:
    """Flag of what loads a spring: the difference of two could be any."""
    effect = effects().get(regressor.name)
    return effect is not None and effect.has_one_load and regressor.form != "late"
