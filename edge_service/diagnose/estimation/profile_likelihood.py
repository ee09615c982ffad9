"""Intervals of shapes from the profile likelihood: all other values follow as a shape is moved."""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ...messages.samples import Floats
from ...models.effects.effect import Parameter
from ..candidates.regressor import EntryRegressor
from .least_squares import WeightedLeastSquares

RISE_90 = 2.706
"""Rise of twice the negative log-likelihood at the ends of a 90 % interval (Wilks, 1938)."""
LEANING = 4.0
"""Variance factor: an approximate entry leaves bias, not noise, and it pulls the values along."""
_SLOPE_STEP = 0.02
_FIRST_STEP = 0.01
_DOUBLINGS = 11
_HALVINGS = 5


Slopes = Mapping[str, Mapping[str, Floats]]
"""Shape -> channel -> (n, 1)."""


def slopes_of(system: WeightedLeastSquares, entry: EntryRegressor, coefficients: Floats) -> Slopes:
    """Sensitivity of an entry to each of its shapes, per relative change of the shape."""
    found = {}
    for parameter in entry.effect.parameters:
        value = dict(entry.shape).get(parameter.name, 0.0)
        step = _SLOPE_STEP * value
        if parameter.whole or value == 0.0 or not parameter.low < value < parameter.high:
            continue
        more, less = (
            system.columns(entry.with_shape(parameter.name, value + way * step))
            for way in (1.0, -1.0)
        )
        found[parameter.name] = {
            name: ((more[name] - less[name]) @ coefficients / (2.0 * _SLOPE_STEP))[:, None]
            for name in more
        }
    return found


def joined(system: WeightedLeastSquares, slopes: Slopes, but: str = "") -> Mapping[str, Floats]:
    """Slopes of all shapes but one as columns, by channel, (n, m)."""
    kept = [each for name, each in slopes.items() if name != but]
    return {
        name: np.hstack([np.empty((len(rows.gap), 0)), *(each[name] for each in kept)])
        for name, rows in system.session.channels.items()
    }


def profile_interval(
    system: WeightedLeastSquares,
    entries: Sequence[EntryRegressor],
    columns: Sequence[Mapping[str, Floats]],
    k: int,
    parameter: Parameter,
    slopes: Slopes,
) -> tuple[float, float]:
    """90 % interval of one shape of entry `k`, within the bounds of the library.

    Its other shapes follow, as far as their slopes at the fit tell.
    """
    value = dict(entries[k].shape)[parameter.name]
    beside = joined(system, slopes, parameter.name)

    def square(wanted: float) -> float:
        entry = entries[k].with_shape(parameter.name, wanted)
        changed = [*columns[:k], system.columns(entry), *columns[k + 1 :]]
        return system.solve_beside([*entries[:k], entry, *entries[k + 1 :]], changed, beside)[2]

    least = square(value)
    scale = misfit(system, least)
    if parameter.whole:
        return _whole_interval(lambda wanted: (square(wanted) - least) / scale, value, parameter)
    unit = abs(value) if value != 0.0 else 0.1 * abs(parameter.faulty)

    def rise(wanted: float) -> float:
        return (square(wanted) - least) / scale

    return _end(rise, value, -unit, parameter), _end(rise, value, unit, parameter)


def misfit(system: WeightedLeastSquares, square: float) -> float:
    """Variance of a fit over that of its weights, 1 or more, with what it leans by."""
    return LEANING * max(square / system.observations, 1.0)


def _whole_interval(
    rise: Callable[[float], float], value: float, parameter: Parameter
) -> tuple[float, float]:
    ends = []
    for way in (-1.0, 1.0):
        end = value
        while parameter.low <= end + way <= parameter.high and rise(end + way) <= RISE_90:
            end += way
        ends.append(end)
    return ends[0], ends[1]


def _end(rise: Callable[[float], float], value: float, unit: float, parameter: Parameter) -> float:
    """Value at which the rise reaches `RISE_90` on one side: steps that double, then halve."""
    inside, step = 0.0, _FIRST_STEP
    for _ in range(_DOUBLINGS):
        if _at(value, step, unit, parameter) == _at(value, inside, unit, parameter):
            return _at(value, inside, unit, parameter)
        if rise(_at(value, step, unit, parameter)) > RISE_90:
            break
        inside, step = step, 2.0 * step
    else:
        return _at(value, math.inf, unit, parameter)
    for _ in range(_HALVINGS):
        middle = 0.5 * (inside + step)
        if rise(_at(value, middle, unit, parameter)) > RISE_90:
            step = middle
        else:
            inside = middle
    return _at(value, step, unit, parameter)


def _at(value: float, steps: float, unit: float, parameter: Parameter) -> float:
    return float(np.clip(value + steps * unit, parameter.low, parameter.high))
