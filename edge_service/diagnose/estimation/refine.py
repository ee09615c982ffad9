"""Refinement of the shapes of entries between the points of their grid."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy import optimize

from ...messages.samples import Floats
from ...models.effects.effect import Kind, Parameter, Role
from ..candidates.regressor import EntryRegressor
from .least_squares import WeightedLeastSquares

_MOST_SWEEPS = 4
_SETTLED = 1e-2  # fall of the square, as a part of it, that is worth no further sweep
_EVALUATIONS = 10
_REACH = 2.0  # of a shape's search around its point of the grid, as a factor
_FINE_REACH = 1.1
"""The same where the grid is fine."""


def refine(system: WeightedLeastSquares, entries: Sequence[EntryRegressor]) -> list[EntryRegressor]:
    """Move the shapes of entries to where they fit best, one after another."""
    entries = [_started(system, entry, entries) for entry in entries]
    columns: list[Mapping[str, Floats]] = [system.columns(entry) for entry in entries]
    left = system.solve(entries, columns)[2]
    for _ in range(_MOST_SWEEPS):
        before = left
        for k, entry in enumerate(entries):
            for parameter in _shapes(entry):
                entries[k], columns[k], left = _moved(system, entries, columns, k, parameter)
        if left > (1.0 - _SETTLED) * before:
            break
    return list(entries)


def _shapes(entry: EntryRegressor) -> list[Parameter]:
    if entry.effect.kind is Kind.DISTURBANCE:
        return []  # the search for it has its own, finer resolution
    moved = {name for name, _ in entry.shape}
    return [
        p
        for p in entry.effect.parameters
        if p.role is Role.SHAPE and not p.whole and p.name in moved
    ]


def _started(
    system: WeightedLeastSquares,
    entry: EntryRegressor,
    entries: Sequence[EntryRegressor],
) -> EntryRegressor:
    """Start an effect without an amount where its strength would be 1."""
    if entry.amount or entry.effect.follows_own_torque:
        return entry
    strength = entry.effect.parameters[0].name
    free = replace(entry, amount=strength)
    others = [each for each in entries if each is not entry]
    beta, _, _ = system.solve([*others, free], [system.columns(each) for each in (*others, free)])
    value = dict(entry.shape)[strength]
    return entry.with_shape(strength, value * float(np.clip(beta[-1], 0.2, 3.0)))


def _moved(
    system: WeightedLeastSquares,
    entries: Sequence[EntryRegressor],
    columns: Sequence[Mapping[str, Floats]],
    k: int,
    parameter: Parameter,
) -> tuple[EntryRegressor, Mapping[str, Floats], float]:
    """Entry with one shape moved, its columns, and the weighted square left."""
    value = dict(entries[k].shape)[parameter.name]
    is_scale = parameter.low >= 0.0 and value > 0.0

    def trial(x: float) -> tuple[EntryRegressor, dict[str, Floats], float]:
        wanted = value * float(np.exp(x)) if is_scale else value + x * _span(entries[k], parameter)
        entry = entries[k].with_shape(
            parameter.name, float(np.clip(wanted, parameter.low, parameter.high))
        )
        mine = system.columns(entry)
        changed = [*entries[:k], entry, *entries[k + 1 :]]
        left = system.solve(changed, [*columns[:k], mine, *columns[k + 1 :]])[2]
        return entry, mine, left

    factor = _FINE_REACH if entries[k].effect.follows_own_torque else _REACH
    reach = float(np.log(factor)) if is_scale else 1.0
    found = optimize.minimize_scalar(
        lambda x: trial(x)[2],
        bounds=(-reach, reach),
        method="bounded",
        options={"maxiter": _EVALUATIONS, "xatol": 0.01 * reach},
    )
    here, there = trial(0.0), trial(float(found.x))
    return there if there[2] < here[2] else here


def _span(entry: EntryRegressor, parameter: Parameter) -> float:
    """Span by which a place or a time is moved: the width or the length of what is there."""
    shape = dict(entry.shape)
    return shape.get("width_m", shape.get("duration_s", 0.1 * abs(parameter.faulty)))
