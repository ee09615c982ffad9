"""Values of the entries of a diagnosis, with their intervals."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ...models.effects.effect import Role, Term
from ...models.effects.registry import error_of, get_effect
from ..candidates.regressor import EntryRegressor
from ..session.session import TORQUE_GAP
from .least_squares import WeightedLeastSquares
from .profile_likelihood import Slopes, joined, misfit, profile_interval, slopes_of

Z_90 = 1.645
_GAIN = error_of(Term.GAIN)


@dataclass(frozen=True, slots=True)
class Interval:
    """Value with its 90 % interval."""

    value: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True, slots=True, eq=False)
class Estimates:
    """Coefficients of entries; a parameter's nuisance part belongs to its effect.

    Attributes:
        healthy: parameter effect -> mean and spread of its amount on a healthy axis, in the order
            of the fixed columns.
        square: weighted square that the fit leaves.
    """

    healthy: Mapping[str, tuple[float, float]]
    system: WeightedLeastSquares
    regressors: tuple[EntryRegressor, ...]
    columns: tuple[Mapping[str, Floats], ...]
    beta: Floats
    covariance: Floats
    square: float

    @property
    def names(self) -> tuple[str, ...]:
        """Effects in the order of their first entries."""
        return tuple(dict.fromkeys(each.name for each in self.regressors))

    def of_effect(self, name: str) -> list[int]:
        """Entries of an effect."""
        return [k for k, each in enumerate(self.regressors) if each.name == name]

    def contribution(self, name: str, channel: str) -> Floats:
        """Contribution of an effect to a channel's gap, (n,)."""
        found = np.zeros(len(self.system.session.channels[channel].gap))
        for k in self.of_effect(name):
            found += self.columns[k][channel] @ self.coefficients(k)
        return found

    def shown(self, name: str) -> set[str]:
        """Channels that an effect shows in."""
        return set().union(*(self._shown(k) for k in self.of_effect(name)))

    def _place(self, k: int) -> slice:
        start = len(self.system.mean) + sum(regressor.size for regressor in self.regressors[:k])
        return slice(start, start + self.regressors[k].size)

    def coefficients(self, k: int) -> Floats:
        """Coefficients of one entry, bounded as the library bounds its amount."""
        found = self.beta[self._place(k)].copy()
        regressor = self.regressors[k]
        if regressor.name in self.healthy:
            found[0] += self.beta[tuple(self.healthy).index(regressor.name)]
        bound = next((p for p in regressor.effect.parameters if p.name == regressor.amount), None)
        if bound is not None and regressor.size == 1:
            found = np.clip(found, bound.low, bound.high)
        return found

    def is_at_bound(self, name: str) -> bool:
        """Tell whether a shape of an effect has gone as far up as the library lets it."""
        highest = {p.name: p.high for p in get_effect(name).parameters if not p.whole}
        return any(
            value >= 0.99 * highest.get(shape, math.inf)
            for k in self.of_effect(name)
            for shape, value in self.regressors[k].shape
        )

    def entries(self, name: str) -> tuple[dict[str, float], ...]:
        """Complete values of an effect, once for each time it is there."""
        return tuple(self.regressors[k].values(self.coefficients(k)) for k in self.of_effect(name))

    def parameters(self, name: str) -> dict[str, Interval]:
        """Values of the strongest entry with 90 % intervals: amounts as the fit has them, phases
        by their amplitude, shapes by the profile likelihood."""
        mine = self.of_effect(name)
        if not mine:
            return {}
        k = max(mine, key=self._weight)
        regressor = self.regressors[k]
        values = regressor.values(self.coefficients(k))
        slopes = slopes_of(self.system, regressor, self.coefficients(k))
        sigma = self._sigma(k, slopes)
        moved = {shape for shape, _ in regressor.shape}
        shown = {}
        for parameter in regressor.effect.parameters:
            if parameter.amounts and regressor.amount not in parameter.amounts:
                continue
            value = values[parameter.name]
            if parameter.name == regressor.amount:
                low, high = self._amount_interval(k, value, sigma)
            elif parameter.name in moved:
                low, high = profile_interval(
                    self.system, self.regressors, self.columns, k, parameter, slopes
                )
            elif parameter.role is Role.PHASE and regressor.size == 2:
                reach = min(Z_90 * sigma / max(abs(values[regressor.amount]), 1e-300), math.pi)
                low, high = value - reach, value + reach
            elif value != 0.0:
                low, high = parameter.low, parameter.high
            else:
                continue
            shown[parameter.name] = Interval(value, low, high, parameter.unit)
        return shown

    def _weight(self, k: int) -> float:
        """Contribution of an entry to the gap, in the channel where it is greatest."""
        return max(
            float(np.mean((column @ self.coefficients(k)) ** 2)) * self.system.weights[name] ** 2
            for name, column in self.columns[k].items()
        )

    def _amount_interval(self, k: int, value: float, sigma: float) -> tuple[float, float]:
        """90 % interval of an amount.

        Of a parameter, what a healthy axis has of it is not known to belong to the effect.

        A torque is read through a gain that is known to its tolerance alone, and with the amount
        what the model has of it already, whose own tolerance stands for that of the product.
        """
        mean, spread = self.healthy.get(self.regressors[k].name, (0.0, 0.0))
        gain = self.healthy.get(_GAIN, (0.0, 0.0))[1] if TORQUE_GAP in self._shown(k) else 0.0
        reach = Z_90 * math.hypot(sigma, spread, gain * value, spread if gain else 0.0)
        return value - max(mean, 0.0) - reach, value - min(mean, 0.0) + reach

    def _shown(self, k: int) -> set[str]:
        """Channels that a regressor shows in."""
        return {name for name, column in self.columns[k].items() if np.any(column)}

    def _sigma(self, k: int, slopes: Slopes) -> float:
        """Standard deviation of the amount of one regressor whose shapes are not known either."""
        beside = joined(self.system, slopes)
        covariance = self.system.solve_beside(self.regressors, self.columns, beside)[1]
        variance = max(float(np.diag(covariance)[self._place(k)].max()), 0.0)
        return math.sqrt(misfit(self.system, self.square) * variance)
