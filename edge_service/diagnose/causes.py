"""Choice of effects: material ones, a posterior over sets of them, and indistinguishable ones."""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from .dictionary import Dictionary
from .evidence import Fit, Noise, fit
from .nameless import UNKNOWN
from .pursuit import pursue
from .session import TORQUE_GAP, TRANSMISSION_GAP
from .tolerance import MATERIAL_TOLERANCES

LEAST_RISE_OF_FLOOR = {TORQUE_GAP: 0.5, TRANSMISSION_GAP: 1.0}
"""An effect that adds less than this many healthy gaps to a channel is immaterial."""
LEAST_GAP_OF_FLOOR = {TORQUE_GAP: 1.15, TRANSMISSION_GAP: 1.4}
"""A channel in which a healthy axis has as great a gap has no cause."""
LEAST_RISE_OF_GAP = 0.1
"""So is one that is less than this part of the whole gap: the others are no better known."""
LEAST_RISE_BESIDE_ALIKE = 0.22
"""Beside a greater effect whose entry may lack what this one adds."""
LEAST_RISE_OF_COMPLIANCE = 0.15
"""The same for compliance, which is small beside any play."""
BETWEEN_ENCODERS = frozenset({"backlash", "compliance"})
"""Effects that give between motor and table show between their encoders, whatever else they do."""
ALIKE = (
    frozenset({"backlash", "compliance", "presliding"}),
    frozenset({"stribeck", "presliding", "quadratic_friction"}),
    frozenset({"lead_error", "thermal_growth"}),
)
"""Effects that resemble what a few numbers leave of one another."""
TIED = 5.0
"""Scores closer than this leave a doubt worth naming."""
_LEADERS = 5


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A set of effects, and those of it that matter."""

    fit: Fit
    material: frozenset[str]


@dataclass(frozen=True, slots=True, eq=False)
class Causes:
    """The posterior.

    Attributes:
        best: the most probable set.
        probability: of each effect to be part of the cause.
        classes: effect -> itself and what this data cannot tell from it.
        candidates: all sets considered, best first, with their probabilities.
    """

    best: Candidate
    probability: Mapping[str, float]
    classes: Mapping[str, tuple[str, ...]]
    candidates: Sequence[tuple[Candidate, float]]


def find_causes(
    dictionary: Dictionary, noise: Noise, limits: Mapping[str, tuple[float, float]]
) -> Causes:
    """Weigh sets of effects.

    Args:
        limits: effect -> healthy mean and tolerance of its amount, for parameters.
    """
    best = pursue(dictionary, noise, dictionary.candidates)
    fits = [fit(dictionary, (), noise), best]
    leaders = list(_by_weight(dictionary, best, noise))[:_LEADERS]
    for name in leaders:
        other = _pursue_names(dictionary, noise, {name}, banned=True)
        fits.append(other)
        fits.append(_pursue_names(dictionary, noise, {name}))
    rivals = {n for f in fits for n in f.names(dictionary)} - set(leaders)
    for pair in itertools.combinations(leaders[:3], 2):
        fits.append(_pursue_names(dictionary, noise, set(pair)))
    for name in sorted(rivals):
        fits.append(_pursue_names(dictionary, noise, {name}))
    judged = [
        Candidate(each, material_names(dictionary, each, noise, limits)) for each in _unique(fits)
    ]
    return _posterior(judged)


def _pursue_names(
    dictionary: Dictionary, noise: Noise, names: Iterable[str], *, banned: bool = False
) -> Fit:
    wanted = set(names)
    allowed = [a for a in dictionary.candidates if (dictionary.atoms[a].name in wanted) != banned]
    return pursue(dictionary, noise, allowed)


def _unique(fits: Sequence[Fit]) -> list[Fit]:
    best: dict[tuple[int, ...], Fit] = {}
    for each in fits:
        best[tuple(sorted(each.atoms))] = each
    return list(best.values())


def _by_weight(dictionary: Dictionary, whole: Fit, noise: Noise) -> Iterable[str]:
    """Names of a fit, the one that it can spare least first."""
    loss = {
        name: whole.score - _without(dictionary, whole, name, noise).score
        for name in whole.names(dictionary)
    }
    return sorted(loss, key=lambda name: -loss[name])


def _without(dictionary: Dictionary, whole: Fit, name: str, noise: Noise) -> Fit:
    kept = [a for a in whole.atoms[dictionary.tolerated :] if dictionary.atoms[a].name != name]
    return fit(dictionary, kept, noise)


def material_names(
    dictionary: Dictionary, whole: Fit, noise: Noise, limits: Mapping[str, tuple[float, float]]
) -> frozenset[str]:
    """Effects of a fit that matter: significant alone is not enough."""
    return frozenset(
        name
        for name in whole.names(dictionary)
        if _is_material(dictionary, whole, name, noise, limits)
    )


def _is_material(
    dictionary: Dictionary,
    whole: Fit,
    name: str,
    noise: Noise,
    limits: Mapping[str, tuple[float, float]],
) -> bool:
    """Tell whether an effect adds to a gap what nothing else that is named can replace."""
    if name in limits and _excess(dictionary, whole, name, *limits[name]) <= MATERIAL_TOLERANCES:
        return False
    rises = _rises(dictionary, whole, name, noise)
    alike = [
        _rises(dictionary, whole, other, noise)
        for group in ALIKE
        if name in group
        for other in (group - {name}) & whole.names(dictionary)
    ]
    for channel, sums in dictionary.sums.items():
        elsewhere = channel != TRANSMISSION_GAP and TRANSMISSION_GAP in dictionary.sums
        if name in BETWEEN_ENCODERS and elsewhere:
            continue
        before = math.sqrt(sums.square / sums.rows)
        if before < LEAST_GAP_OF_FLOOR[channel] * noise.floor[channel]:
            continue
        overshadowed = any(other[channel] > rises[channel] for other in alike)
        beside = LEAST_RISE_OF_COMPLIANCE if name == "compliance" else LEAST_RISE_BESIDE_ALIKE
        part = beside if overshadowed else LEAST_RISE_OF_GAP
        least = LEAST_RISE_OF_FLOOR[channel] * noise.floor[channel]
        if rises[channel] >= max(least, part * before):
            return True
    return False


def _rises(dictionary: Dictionary, whole: Fit, name: str, noise: Noise) -> dict[str, float]:
    """Contribution of an effect to each channel's gap, as a root mean square.

    What is tolerated stays as it is meanwhile: it must not stretch to hide a cause.
    """
    kept = [a for a in whole.atoms[dictionary.tolerated :] if dictionary.atoms[a].name != name]
    count = int(dictionary.first[dictionary.tolerated])
    lesser = fit(dictionary, kept, noise, whole.coefficients[:count])
    return {
        channel: math.sqrt(max(lesser.rms[channel] ** 2 - whole.rms[channel] ** 2, 0.0))
        for channel in dictionary.sums
    }


def _excess(dictionary: Dictionary, whole: Fit, name: str, healthy: float, sigma: float) -> float:
    """By how many tolerances a parameter is off, the tolerated part included."""
    mine = [a for a in whole.atoms if dictionary.atoms[a].name == name]
    return abs(float(whole.of_atoms(dictionary, mine).sum()) - healthy) / sigma


def _posterior(judged: Sequence[Candidate]) -> Causes:
    ranked = sorted(judged, key=lambda each: -each.fit.score)
    top = ranked[0].fit.score
    weights = [math.exp(max(each.fit.score - top, -700.0)) for each in ranked]
    total = sum(weights)
    candidates = [(each, weight / total) for each, weight in zip(ranked, weights, strict=True)]
    names = {name for each in ranked for name in each.material}
    probability = {
        name: sum(p for each, p in candidates if name in each.material) for name in sorted(names)
    }
    best = ranked[0]
    classes = {name: (name, *sorted(_rivals(name, best, ranked))) for name in sorted(best.material)}
    return Causes(best, probability, classes, candidates)


def _rivals(name: str, best: Candidate, ranked: Sequence[Candidate]) -> set[str]:
    """Effects that stand in for one in a set that is as good."""
    found: set[str] = set()
    for each in ranked:
        close = each.fit.score >= best.fit.score - TIED
        if close and name not in each.material and each.material:
            found |= each.material - best.material
    return found - {UNKNOWN}
