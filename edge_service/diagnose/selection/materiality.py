"""Materiality of effects: what a fit would lose without each; significance is not enough."""

import math

from ...models.effects.effect import MATERIAL_TOLERANCES, Kind
from ...models.effects.registry import effects, effects_where
from ..session.session import TRANSMISSION_GAP
from .problem import Fit, SelectionProblem

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


def material_names(problem: SelectionProblem, whole: Fit) -> frozenset[str]:
    """Effects of a fit that matter.

    Two that stand in for one another would both be idle, and nothing would be named of a gap that
    they explain: the one that can be spared is taken out, and the others are looked at again.
    """
    while True:
        material = frozenset(name for name in whole.names if _is_material(problem, whole, name))
        if material == whole.names or not _is_missed(problem, whole, material):
            return material
        idle = [name for name in problem.names_by_weight(whole) if name not in material]
        whole = problem.without(whole, idle[-1])


def _is_missed(problem: SelectionProblem, whole: Fit, material: frozenset[str]) -> bool:
    """Tell whether the material effects leave most of what all effects explain of a channel."""
    design, noise = problem.design, problem.noise
    kept = [a for a in whole.chosen if design.regressors[a].name in material]
    alone = problem.pinned_to(whole).fit(kept)
    return any(
        noise.matters(channel, alone.rms[channel])
        and alone.rms[channel] ** 2 - whole.rms[channel] ** 2
        > MISSED * (each.square / each.rows - whole.rms[channel] ** 2)
        for channel, each in design.equations.items()
    )


def _is_material(problem: SelectionProblem, whole: Fit, name: str) -> bool:
    """Tell whether an effect adds to a gap what nothing else that is named can replace."""
    design, noise = problem.design, problem.noise
    if name in problem.priors and _excess(problem, whole, name) <= MATERIAL_TOLERANCES:
        return False
    rises = _rises(problem, whole, name)
    between_encoders = effects_where(lambda effect: effect.kind is Kind.LOST_MOTION)
    alike = [_rises(problem, whole, other) for other in _imitated(name) & whole.names]
    count = sum(design.regressors[a].name == name for a in whole.chosen)
    for channel, each in design.equations.items():
        elsewhere = channel != TRANSMISSION_GAP and TRANSMISSION_GAP in design.equations
        if name in between_encoders and elsewhere:
            continue
        before = math.sqrt(each.square / each.rows)
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


def _rises(problem: SelectionProblem, whole: Fit, name: str) -> dict[str, float]:
    """Contribution of an effect to each channel's gap, as a root mean square."""
    lesser = problem.pinned_to(whole).without(whole, name)
    return {
        channel: math.sqrt(max(lesser.rms[channel] ** 2 - rms**2, 0.0))
        for channel, rms in whole.rms.items()
    }


def _excess(problem: SelectionProblem, whole: Fit, name: str) -> float:
    """Number of tolerances by which a parameter is off, the nuisance part included."""
    healthy, sigma = problem.priors[name]
    mine = [a for a in whole.regressors if problem.design.regressors[a].name == name]
    return abs(float(whole.of_regressors(problem.design, mine).sum()) - healthy) / sigma
