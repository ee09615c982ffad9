"""Assessment of the named effects: how sure each is, and how far it shrinks motion not fitted.

An effect may be a misattribution, by the structure that it leaves; and the best explanation of a
channel may be none, by how much it leaves and what it had to bend for it.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...messages.samples import Floats
from ...models.effects.effect import Role
from ...models.effects.registry import effects_where, get_effect
from ..candidates.regressors import FORCE, UNKNOWN
from ..estimation.estimates import Contributions, Estimates
from ..residual.noise import predicted_structure
from ..result import SUREST, NamedEffect, Shrink
from ..selection.posterior import Posterior
from ..session.session import FOLDS, TORQUE_GAP, Rows, rms

BESIDE_UNNAMED = 0.8
"""Of the probability of an effect, where something that has no name is needed beside it."""
DOUBTED = 0.5
"""The same of one that may make the gap of other motion, or of a part of this one, greater; whose
shape would have to leave what the library allows; or most of whose part is another's."""
LEAST_SHRINK = 0.04
"""Of what the other causes leave, on held-out motion: with less an effect is no cause."""
LESSER_PART = 0.5
"""Of the gap's energy that is left by a force: with more, the force is not what it is about."""
LEAST_PROBABILITY = 0.02
"""Probability below which an effect is not named at all."""
_EVEN = 0.08
"""With this much structure left, over what it explains, an effect is as likely a misattribution:
one of 168 true causes left more (split conformal prediction, Vovk et al., 2005), of 38 false 32."""
_STEEP = 3.0
BY_CHANCE = 0.5
"""Of a force's energy: so much the motion may predict, for a force also falls on some motion."""
OWN = 1.0 / 3.0
"""Weight of an effect's own gain in what is missed beside it."""
LEFT_WEIGHT = 0.8
"""Of what is left but follows nothing that is known."""
FORCE_WEIGHT = 0.2
"""The same of a force's bursts, over other effects': its entry is a rectangle."""
MOST_STRAIN = 3.0
"""Energy of effects in one channel over that of its gap: beyond it they fit each other."""
UNKNOWN_SHARE = 0.15
"""Share of the gap's energy above the floor; with more left over, the named effects are doubted."""
UNKNOWN_ENTRY_SHARE = 0.6
"""The same of what the entries alone leave, without the forms that an effect takes beside them."""
MOST_CAUSES = 3
"""It takes more than this many, the greatest, or they fit each other, only where none is true."""
LEVEL = 0.9
PACES = (0.5, 2.0)
"""Paces at which another session may warm the axis: heat comes from motion (assumption)."""
_SPEED_CLASSES = 4
_REGIMES = 4 * _SPEED_CLASSES
_SHAPE = 0.5
"""Of a Dirichlet distribution that knows nothing (Jeffreys)."""
_RESAMPLES = 1000
_PART = 0.2
"""Share of a session that one more recording is like."""
_TIME_CONSTANT = "time_constant_s"


@dataclass(frozen=True, slots=True)
class Attribution:
    """Contribution of an effect to the channel that it affects most, as shares of its energy."""

    gain: float  # what leaving it out would bring back
    explained: float  # what all effects in the channel take away
    missed: float  # what is left although smooth functions predict it on other motion
    left: float  # what the best fit leaves, with all shapes that bear the effect's name
    strain: float  # energy of all effects in the channel

    @property
    def structure(self) -> float:
        """Structure that is left beside it, over what it explains; infinite if it explains nothing.

        What is missed is its own, or that of greater effects beside it: it counts by a mean, in
        logarithms, of what this one and what all of them explain.
        """
        if self.gain <= 0.0:
            return math.inf
        share = self.gain**OWN * max(self.explained, self.gain) ** (1.0 - OWN)
        strain = max(self.strain / MOST_STRAIN, 1.0)
        return float((self.missed / share + LEFT_WEIGHT * self.left) * strain)

    @property
    def trust(self) -> float:
        """Probability that it is no misattribution."""
        return 1.0 / (1.0 + math.pow(self.structure / _EVEN, _STEEP))


def attributions(posterior: Posterior, contributions: Contributions) -> dict[str, Attribution]:
    """Attributions of named effects.

    Structure up to the tolerance does not count. An effect of heat leaves it with all its shapes.
    """
    problem, session = posterior.problem, posterior.problem.session
    tolerance, channel_of = problem.noise.tolerance, contributions.channel_of
    left, by_shapes = contributions.left_beside_nuisances, problem.residuals(posterior.best.fit)
    thermal = effects_where(lambda effect: effect.is_thermal)
    heated = {channel for effect, channel in channel_of.items() if effect in thermal}
    residuals = {c: (by_shapes if c in heated else left)[c] for c in set(channel_of.values())}
    for channel, moves in contributions.estimates.fitted.system.moving.items():
        residuals[channel] = np.where(moves, residuals.get(channel, 0.0), 0.0)
    missed = _missed(residuals, predicted_structure(session, residuals), tolerance)
    found, unexplained = {}, posterior.unexplained
    for effect, channel in channel_of.items():
        rest, mine = left[channel], contributions.by_effect[effect][channel]
        whole = float(np.sum(session.channels[channel].gap ** 2))
        gain = float(np.sum((rest + mine) ** 2) - np.sum(rest**2))
        energies = [float(np.sum(e[channel] ** 2)) for e in contributions.by_effect.values()]
        share, missed_here = unexplained[channel], missed[channel]
        if effect == FORCE:
            share = FORCE_WEIGHT * max(share, float(np.sum(rest**2)) / whole)
            own = {channel: rest + mine}
            by_motion = predicted_structure(session, own, timed=False)
            by_chance = _missed(own, by_motion, tolerance)[channel]
            missed_here = max(missed_here, by_chance - BY_CHANCE * float(np.sum(own[channel] ** 2)))
        explained = 1.0 - float(np.sum(rest**2)) / whole
        others = missed_here / whole, share, math.fsum(energies) / whole
        found[effect] = Attribution(gain / whole, explained, *others)
    return found


def _missed(
    left: Mapping[str, Floats], structure: Mapping[str, Floats], tolerance: Mapping[str, float]
) -> dict[str, float]:
    """Energy of what is left that smooth functions predict, beyond the tolerance, by channel."""
    found = {}
    for name, rest in left.items():
        predicted = np.sum(rest**2 - (rest - structure[name]) ** 2 - tolerance[name] ** 2)
        found[name] = max(float(predicted), 0.0)
    return found


def confidences(posterior: Posterior, contributions: Contributions) -> dict[str, float]:
    """Factor on the probabilities of the causes in each channel; below 1 the cause is unknown.

    They leave too much, with the empirical shapes or, where they claim a channel, by their entries
    alone; they are too many; or a parameter that is not named has to leave its tolerance for them.
    """
    problem, session = posterior.problem, posterior.problem.session
    entries_left, by_effect = contributions.left_beside_nuisances, contributions.by_effect
    if FORCE in by_effect and TORQUE_GAP in entries_left:  # a force is taken as its pulses were
        more_nm = by_effect[FORCE][TORQUE_GAP] - posterior.part(FORCE, TORQUE_GAP)
        entries_left[TORQUE_GAP] = entries_left[TORQUE_GAP] + more_nm
    left_rms = {name: rms(each) for name, each in entries_left.items()}
    by_entries = problem.noise.unexplained_shares(session, left_rms)
    crowded = False
    for name, each in entries_left.items():
        parts = sorted((effect[name] for effect in by_effect.values()), key=rms)
        left_rms[name] = rms(sum(parts[:-MOST_CAUSES], each))
        strain = math.fsum(rms(x) ** 2 for x in parts) / session.channels[name].rms ** 2
        crowded |= len(parts) > MOST_CAUSES and strain > MOST_STRAIN
    by_few = problem.noise.unexplained_shares(session, left_rms)
    crowded |= any(by_few[name] - by_entries[name] > UNKNOWN_SHARE for name in by_few)
    claimed, left = set(contributions.channel_of.values()), posterior.unexplained
    found = {}
    for name in session.channels:
        is_unknown = crowded or left[name] > UNKNOWN_SHARE
        is_unknown |= name in claimed and by_entries[name] > UNKNOWN_ENTRY_SHARE
        found[name] = 0.5 * (1.0 - left[name]) if is_unknown else 1.0
    unnamed = problem.stretched(posterior.best.fit).keys() - contributions.named
    if TORQUE_GAP in posterior.exceeding and unnamed:
        found[TORQUE_GAP] = 0.5
    return found


@dataclass(frozen=True, slots=True, eq=False)
class CrossValidation:
    """Values fitted on all blocks of time, and without each fold of them, in their order."""

    values: Estimates
    folds: tuple[Estimates, ...]

    @classmethod
    def of_estimates(cls, values: Estimates) -> "CrossValidation":
        """Fit the values once more without each fold."""
        number = values.fitted.system.session.fold
        kept = ({name: each != k for name, each in number.items()} for k in range(FOLDS))
        betas = (values.fitted.solve(rows=rows).beta for rows in kept)
        return cls(values, tuple(replace(values, beta=beta) for beta in betas))

    def held_out(self, name: str, channel: str) -> Floats:
        """Contribution of an effect to a channel's gap, (n,), each row by values of other folds."""
        number = self.values.fitted.system.session.fold[channel]
        return np.choose(number, [x.contribution(name, channel) for x in self.folds])

    def at_pace(self, name: str, channel: str, pace: float) -> Floats | None:
        """Contribution of an effect, were its clock to go at `pace`; None if it keeps no time."""
        values, session = self.values, self.values.fitted.system.session
        entries = {k: values.fitted.regressors[k] for k in values.of_effect(name)}
        if not any(_TIME_CONSTANT in dict(each.shape) for each in entries.values()):
            return None
        found = np.zeros(len(session.channels[channel].gap))
        for k, entry in entries.items():
            constant_s = dict(entry.shape).get(_TIME_CONSTANT, 0.0)
            paced = {_TIME_CONSTANT: constant_s / pace} if constant_s else {}
            found += entry.with_shape(**paced).columns(session, channel) @ values.coefficients(k)
        return found

    def shrink(self, name: str, channel: str, paces: Sequence[float] = PACES) -> Shrink:
        """Shrink of a channel by one effect beside all others, expected on other motion.

        The estimate is that of held-out blocks: from what the others leave to what all leave. A
        force among the others, which no block predicts of another, is taken off as it was here. An
        effect that follows time does so at another pace in two thirds of the draws of the interval.
        """
        rows = self.values.fitted.system.session.channels[channel]
        without = rows.gap.copy()
        for other in sorted({*self.values.names} - {name, FORCE}):
            without -= self.held_out(other, channel)
        if name != FORCE:
            without -= self.values.contribution(FORCE, channel)
        left = [without - self.held_out(name, channel)]
        paced = (self.at_pace(name, channel, pace) for pace in paces)
        left += [without - made for made in paced if made is not None]
        return on_other_motion(replace(rows, gap=without), left)


def on_other_motion(rows: Rows, left: Sequence[Floats]) -> Shrink:
    """Shrink from a gap to what is left of it, (n,), with an interval for motion of other kinds.

    Another motion visits the regimes of this one in unknown proportions: each draw weighs them by
    a Dirichlet distribution (after Rubin, 1981, The Bayesian Bootstrap). It is one recording, as
    warm as a part of this session and in no more places: each draw looks at one part.

    Args:
        left: the first gives the estimate; each is as likely on other motion.
    """
    random = np.random.default_rng(11)
    proportions = random.standard_gamma(_SHAPE, (_RESAMPLES, _REGIMES))
    # regimes: speed in four classes, accelerating or not, which side of the travel
    known = rows.variables
    speed = np.abs(known["motor_speed_rad_s"])
    acceleration = np.abs(known["motor_acceleration_rad_s2"])
    place = known["table_position_m"]
    edges = np.quantile(speed, np.arange(1, _SPEED_CLASSES) / _SPEED_CLASSES)
    regime = 4 * np.digitize(speed, edges) + 2 * (acceleration > np.median(acceleration))
    regime = (regime + (place > np.median(place))).astype(np.int64)
    # weight of each block, (k, count): those of one part of the session
    blocks = int(rows.block.max()) + 1
    length = max(round(blocks * _PART), 1)
    first = np.random.default_rng(7).integers(0, blocks - length + 1, _RESAMPLES)[:, None]
    block = np.arange(blocks)
    weights = ((block >= first) & (block < first + length)).astype(np.float64)

    def drawn(series: Floats) -> Floats:
        cells = np.bincount(regime * blocks + rows.block, series**2, minlength=_REGIMES * blocks)
        return np.asarray(np.sum((proportions @ cells.reshape(_REGIMES, blocks)) * weights, axis=1))

    before, after = drawn(rows.gap), [drawn(each) for each in left]
    chosen = np.choose(random.integers(0, len(after), _RESAMPLES), after)
    estimate = float(_shrink(np.sum(rows.gap**2), np.sum(left[0] ** 2)))
    low, high = np.quantile(_shrink(before, chosen), (0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL))
    return Shrink(estimate=estimate, low=float(min(low, estimate)), high=float(max(high, estimate)))


def _shrink(before: Floats | float, after: Floats | float) -> Floats:
    return np.asarray(1.0 - np.sqrt(np.asarray(after) / np.maximum(before, 1e-300)))


@dataclass(frozen=True, slots=True, eq=False)
class Assessment:
    """Named effects of the best set, held against what they leave."""

    posterior: Posterior
    contributions: Contributions
    validation: CrossValidation
    attributions: Mapping[str, Attribution]  # effect -> what it has in its channel
    confidence: Mapping[str, float]  # on the probabilities, by channel; below 1: cause unknown
    effects: tuple[NamedEffect, ...]  # with the probability, the shrinkage, the values of each

    @classmethod
    def of_effects(cls, posterior: Posterior, named: frozenset[str]) -> "Assessment":
        """Assess some effects of the best set."""
        contributions = Contributions.of_effects(posterior, named)
        attributed = attributions(posterior, contributions)
        confidence = confidences(posterior, contributions)
        others = sorted(posterior.best.fit.names - named - {UNKNOWN, FORCE})
        noise, estimates = posterior.problem.noise, contributions.estimates
        validation, effects = CrossValidation.of_estimates(estimates), []
        for name, attribution in attributed.items():
            channel, parts = contributions.channel_of[name], contributions.by_effect[name]
            shown = sorted(estimates.shown(*estimates.of_effect(name)))
            # it must be right in each channel that it is a part of, beside what has no name there
            within = {channel} | {x for x in shown if rms(parts[x]) > noise.tolerance[x]}
            trust = attribution.trust * min(confidence[each] for each in within)
            trust *= BESIDE_UNNAMED if within & posterior.unnamed else 1.0
            shrink, tolerated = validation.shrink(name, channel), noise.tolerance[channel]
            mine = parts[channel]
            before = rms(contributions.left[channel] + mine)
            low = validation.shrink(name, channel, ()).low  # at another pace it is the same cause
            helps = shrink.estimate * before >= tolerated >= -low * before
            contradicted = low < 0.0 and not helps and name != FORCE
            rivals = [x for x in others if 2.0 * posterior.part(x, channel) @ mine > mine @ mine]
            trust *= DOUBTED ** (contradicted + estimates.is_at_bound(name) + bool(rivals))
            ratios = ((each, 1.0 - validation.shrink(name, each).estimate) for each in shown)
            less = sum(noise.effective[each] * math.log(left) for each, left in ratios)
            trust *= name == FORCE or less <= 0.0  # all channels together must be likelier with it
            if name == FORCE:
                rows = posterior.problem.session.channels[TORQUE_GAP]
                left = rms(rows.gap - posterior.part(FORCE, TORQUE_GAP)) / rows.rms
                high = 1.0 - left if left**2 < LESSER_PART else max(shrink.high, 0.0)
                shrink = Shrink(estimate=0.0, low=0.0, high=high)  # it does not come again
            effects.append(
                NamedEffect(
                    name=name,
                    channel=channel,
                    probability=min(posterior.probability[name], SUREST) * trust,
                    tied=tuple(dict.fromkeys((*posterior.classes[name], *rivals))),
                    shrink=shrink,
                    parameters=estimates.parameters(name),
                    entries=estimates.entries(name),
                )
            )
        return cls(posterior, contributions, validation, attributed, confidence, tuple(effects))

    @property
    def misattributed(self) -> set[str]:
        """Channels whose greatest cause is more likely a misattribution than not."""
        by_gain = sorted(self.attributions.items(), key=lambda item: item[1].gain)
        leaders = {self.contributions.channel_of[effect]: each for effect, each in by_gain}
        return {channel for channel, each in leaders.items() if each.trust < 0.5}

    @property
    def is_unknown(self) -> bool:
        """Flag of a cause whose better part the library lacks."""
        is_unsure = any(each < 1.0 for each in self.confidence.values())
        return UNKNOWN in self.posterior.best.material or bool(self.misattributed) or is_unsure

    def idlest(self) -> str:
        """Named effect that is least of a cause, as one not told from zero; empty without any."""
        if FORCE in self.contributions.named and all(each.name != FORCE for each in self.effects):
            return FORCE  # no entry can say how it acts
        idle = []
        for each in self.effects:
            is_force = each.name == FORCE  # which nobody foresees
            helps = each.shrink.high if is_force else each.shrink.estimate
            told = helps >= LEAST_SHRINK and (is_force or is_told(each))
            if each.probability < LEAST_PROBABILITY or not told:
                idle.append(each)
        return min(idle, key=lambda x: (x.shrink.estimate, x.probability)).name if idle else ""


def is_told(each: NamedEffect) -> bool:
    """Flag of an amount told from zero; of several entries, or with an end at 0, the sum is."""
    amounts = {p.name for p in get_effect(each.name).parameters if p.role is Role.AMOUNT}
    values = [value for name, value in each.parameters.items() if name in amounts]
    known = (v.low is not None and v.high is not None and v.low * v.high >= 0 for v in values)
    return len(each.entries) > 1 or all(known)


def assess_causes(posterior: Posterior) -> Assessment:
    """Assess the material effects, and drop one after another of those that are no causes.

    One at a time: what two effects share is lost only with both. A force that is none hides what
    else there is: without it all sets are weighed anew.
    """
    named = posterior.best.material - {UNKNOWN}
    while True:
        assessment = Assessment.of_effects(posterior, named)
        idle = assessment.idlest()
        if not idle:
            return assessment
        calmer = posterior.without(FORCE) if idle == FORCE else None
        posterior = calmer or posterior
        named = calmer.best.material - {UNKNOWN} if calmer else named - {idle}
