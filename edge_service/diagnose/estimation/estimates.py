"""Values of the named effects with their intervals, and their parts of the gap.

Amounts and shapes have the interval of one fit, in which a shape may move by its slope; phases
have that of their amplitude.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...messages.samples import Floats
from ...messages.stored import finite_or_none
from ...models.effects.effect import ActiveEffect, Parameter, Role, Term
from ...models.effects.registry import active_effect, error_of, get_effect
from ..candidates.regressors import entry_regressor
from ..result import ParameterValue, WaterfallStep
from ..selection.posterior import Posterior
from ..session.session import TORQUE_GAP, Session, rms
from .entries import Entries, entries_of

Z_90 = 1.645
RISE_90 = 2.706
"""Rise of twice the negative log-likelihood at the ends of a 90 % interval (Wilks, 1938)."""
_GAIN, _LAG = error_of(Term.GAIN), error_of(Term.LAG)
_COUPLINGS = 4
"""Rounds in which a lag and what it delays settle."""
_SLOPE_STEP = 0.02
Slopes = Mapping[str, Mapping[str, Floats]]
"""Shape -> channel -> (n, 1)."""


@dataclass(frozen=True, slots=True, eq=False)
class Estimates:
    """Coefficients of entries; a parameter's nuisance part belongs to its effect."""

    # parameter effect, in the order of the columns -> its healthy mean and spread
    healthy: Mapping[str, tuple[float, float]]
    # effect and form -> the negative of what is there beside the entries, and its spread
    traces: Mapping[tuple[str, str], tuple[float, float]]
    fitted: Entries
    beta: Floats  # of the nuisances and the entries, (p,)
    square: float  # weighted square that the fit leaves

    @property
    def names(self) -> tuple[str, ...]:
        """Effects in the order of their first entries."""
        return tuple(dict.fromkeys(each.name for each in self.fitted.regressors))

    def of_effect(self, name: str) -> list[int]:
        """Entries of an effect."""
        return [k for k, each in enumerate(self.fitted.regressors) if each.name == name]

    def contribution(self, name: str, channel: str) -> Floats:
        """Contribution of an effect to a channel's gap, (n,)."""
        mine = (
            self.fitted.columns[k][channel] @ self.coefficients(k) for k in self.of_effect(name)
        )
        return sum(mine, np.zeros(len(self.fitted.system.session.channels[channel].gap)))

    def shown(self, *entries: int) -> set[str]:
        """Channels that some entries show in."""
        return {c for k in entries for c, each in self.fitted.columns[k].items() if np.any(each)}

    def coefficients(self, k: int) -> Floats:
        """Coefficients of one entry, bounded as the library bounds its amount."""
        found = self.beta[self.fitted.place(k)].copy()
        regressor = self.fitted.regressors[k]
        if regressor.name in self.healthy:
            found[0] += self.beta[tuple(self.healthy).index(regressor.name)]
        bound = regressor.bound
        if bound is not None and regressor.size == 1:
            found = np.clip(found, bound.low, bound.high)
        return found

    def is_at_bound(self, name: str) -> bool:
        """Flag of a shape that has gone as far up as the library lets it."""
        highest = {p.name: p.high for p in get_effect(name).parameters if not p.whole}
        return any(
            value >= 0.99 * highest.get(shape, math.inf)
            for k in self.of_effect(name)
            for shape, value in self.fitted.regressors[k].shape
        )

    def entries(self, name: str) -> tuple[dict[str, float], ...]:
        """Complete values of an effect, once for each time it is there."""
        regressors = self.fitted.regressors
        return tuple(regressors[k].values(self.coefficients(k)) for k in self.of_effect(name))

    def active(self, names: Iterable[str]) -> list[ActiveEffect]:
        """Some effects as they are there."""
        return [active_effect(name, each) for name in names for each in self.entries(name)]

    def parameters(self, name: str) -> dict[str, ParameterValue]:
        """Values of the strongest entry with 90 % intervals."""
        mine = self.of_effect(name)
        if not mine:
            return {}
        k = max(mine, key=self._weight)
        regressor, coefficients = self.fitted.regressors[k], self.coefficients(k)
        values = regressor.values(coefficients)
        slopes = slopes_of(self.fitted, k, coefficients)
        sigma, changes = self._sigmas(k, slopes)
        twins, shown = self._twins(k), {}
        for parameter in regressor.effect.parameters:
            if parameter.amounts and regressor.form not in parameter.amounts:
                continue
            value = values[parameter.name]
            if parameter.name in twins:
                low, high = self._amount_interval(k, values[regressor.form], sigma)
                low, high = (min(low, 0.0), max(high, 0.0)) if len(twins) > 1 else (low, high)
            elif parameter.name in changes:
                reach = Z_90 * changes[parameter.name] * abs(value)
                low, high = np.clip((value - reach, value + reach), parameter.low, parameter.high)
            elif parameter.whole and parameter.name in dict(regressor.shape):
                low, high = _whole_interval(self.fitted, k, parameter)
            elif parameter.role is Role.PHASE and regressor.size == 2:
                reach = min(Z_90 * sigma / max(abs(values[regressor.form]), 1e-300), math.pi)
                low, high = value - reach, value + reach
            elif value != 0.0:
                low, high = parameter.low, parameter.high
            else:
                continue
            ends = {"low": finite_or_none(low), "high": finite_or_none(high)}
            shown[parameter.name] = ParameterValue(value=value, unit=parameter.unit, **ends)
        return shown

    def _usual_lag(self) -> list[dict[str, Floats]]:
        """Sensitivity of a lag, per standard deviation, to a healthy drive's, which it delays."""
        found = []
        for k in self.of_effect(_LAG):
            usual = active_effect(_LAG, {"lag_s": self.healthy[_LAG][1]})
            others = self.active(name for name in self.names if name != _LAG)
            late = self.fitted.delayed(_LAG, [*others, usual]).columns[k]
            pairs = ((c, late[c] - each) for c, each in self.fitted.columns[k].items())
            found.append({c: (more @ self.coefficients(k))[:, None] for c, more in pairs})
        return found

    def _twins(self, k: int) -> set[str]:
        """Amounts that show as an entry's does, and its own: the data tell only their sum."""
        entry, system, mine = self.fitted.regressors[k], self.fitted.system, self.fitted.columns[k]
        found = {entry.form}
        for name in (p.name for p in entry.effect.parameters if p.role is Role.AMOUNT):
            other = entry_regressor(entry.effect, name, dict(entry.shape))
            if other.size == entry.size:
                made = ((c, x - system.columns(other)[c]) for c, x in mine.items())
                off = (system.weights[c] * x @ self.coefficients(k) for c, x in made)
                if sum(x @ x for x in off) < system.misfit(self.square):
                    found.add(name)
        return found

    def _weight(self, k: int) -> float:
        """Contribution of an entry to the gap, in the channel where it is greatest."""
        made = {name: each @ self.coefficients(k) for name, each in self.fitted.columns[k].items()}
        return max(rms(each) * self.fitted.system.weights[name] for name, each in made.items())

    def _amount_interval(self, k: int, value: float, sigma: float) -> tuple[float, float]:
        """90 % interval of an amount, with and without a named gain that acts on it as well."""
        regressor = self.fitted.regressors[k]
        trace = self.traces.get((regressor.name, regressor.form), (0.0, 0.0))
        mean, spread = self.healthy.get(regressor.name, trace)
        gain = self.healthy.get(_GAIN, (0.0, 0.0))[1] if TORQUE_GAP in self.shown(k) else 0.0
        reach = Z_90 * math.hypot(sigma, spread, gain * value, spread if gain else 0.0)
        low, high = value - max(mean, 0.0) - reach, value - min(mean, 0.0) + reach
        named = self.of_effect(_GAIN) if gain and regressor.name != _GAIN else []
        share = 1.0 + sum(float(self.coefficients(j)[0]) for j in named)
        return min(low, low / share), max(high, high / share)

    def _sigmas(self, k: int, slopes: Slopes) -> tuple[float, dict[str, float]]:
        """Standard deviation of the amount of a regressor, and relative ones of its shapes."""
        system = self.fitted.system
        moving = [*self._usual_lag(), *slopes.values()]
        variance = np.diag(self.fitted.solve(moving).covariance)
        sigma = np.sqrt(system.misfit(self.square) * np.maximum(variance, 0.0))
        moved = sigma[len(sigma) - len(slopes) :].tolist()
        return float(sigma[self.fitted.place(k)].max()), dict(zip(slopes, moved, strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class Contributions:
    """Entries of the named effects and their parts of the gap."""

    session: Session
    # effects that were to be fitted; of one without an entry nothing is known
    named: frozenset[str]
    estimates: Estimates
    # effect -> channel -> its contribution to the gap, (n,)
    by_effect: Mapping[str, Mapping[str, Floats]]
    left: Mapping[str, Floats]  # what all of them leave of the gap, by channel, (n,)
    channel_of: Mapping[str, str]  # effect -> channel that matters of whose gap it has most

    @classmethod
    def of_effects(cls, posterior: Posterior, named: frozenset[str]) -> "Contributions":
        """Fit the entries of some effects."""
        problem, session = posterior.problem, posterior.problem.session
        entries = entries_of(problem, posterior.best.fit, named)
        solution, design = entries.solve(), problem.design
        traces = {
            (each.name, each.form): (-float(solution.beta[k]), float(design.precision[k] ** -0.5))
            for each, k in zip(design.regressors[: design.nuisances], design.first, strict=False)
            if each.size == 1
        }
        estimates = Estimates(problem.priors, traces, entries, solution.beta, solution.square)
        for _ in range(_COUPLINGS if _LAG in estimates.names else 0):
            others = estimates.active(name for name in estimates.names if name != _LAG)
            entries = entries.delayed(_LAG, others)
            beta, _, square = entries.solve()
            estimates = replace(estimates, fitted=entries, beta=beta, square=square)
        by_effect = {
            name: {channel: estimates.contribution(name, channel) for channel in session.channels}
            for name in estimates.names
        }
        left = {}
        for channel, rows in session.channels.items():
            parts = [each[channel] for each in by_effect.values()]
            left[channel] = rows.gap - sum(parts, np.zeros(len(rows.gap)))
        mattering = posterior.exceeding or set(session.channels)
        channel_of = {
            name: max(sorted(mattering), key=lambda c: rms(parts[c]) / session.channels[c].rms)
            for name, parts in by_effect.items()
        }
        return cls(session, named, estimates, by_effect, left, channel_of)

    @property
    def left_beside_nuisances(self) -> dict[str, Floats]:
        """Residual when what a healthy axis may have is taken away too, by channel, (n,)."""
        system = self.estimates.fitted.system
        return {name: each - system.fixed[name] @ system.mean for name, each in self.left.items()}

    def waterfall(self) -> dict[str, tuple[WaterfallStep, ...]]:
        """Root mean square as effects are added, the most helpful first, by channel."""
        found = {}
        for channel, rows in self.session.channels.items():
            left, open_, steps = rows.gap, sorted(self.by_effect), list[WaterfallStep]()
            while open_:
                rest = {name: left - self.by_effect[name][channel] for name in open_}
                name = min(rest, key=lambda n: rms(rest[n]))
                left = rest[name]
                open_.remove(name)
                steps.append(WaterfallStep(effect=name, rms=rms(left)))
            found[channel] = tuple(steps)
        return found


def slopes_of(entries: Entries, k: int, coefficients: Floats) -> Slopes:
    """Sensitivity of an entry to each of its shapes, per relative change of the shape."""
    entry, found = entries.regressors[k], {}
    for parameter in entry.effect.parameters:
        value = dict(entry.shape).get(parameter.name, 0.0)
        step = _SLOPE_STEP * value
        if parameter.whole or value == 0.0 or not parameter.low < value < parameter.high:
            continue
        more, less = (
            entries.system.columns(entry.with_shape(**{parameter.name: value + way * step}))
            for way in (1.0, -1.0)
        )
        found[parameter.name] = {
            name: ((more[name] - less[name]) @ coefficients / (2.0 * _SLOPE_STEP))[:, None]
            for name in more
        }
    return found


def _whole_interval(entries: Entries, k: int, parameter: Parameter) -> tuple[float, float]:
    """90 % interval of a whole number that is a shape of entry `k`, by the likelihood."""
    value = dict(entries.regressors[k].shape)[parameter.name]
    least = entries.solve().square
    most, ends = least + RISE_90 * entries.system.misfit(least), []
    for way in (-1.0, 1.0):
        end = value
        while parameter.low <= end + way <= parameter.high:
            if entries.with_shape(k, **{parameter.name: end + way}).solve().square > most:
                break
            end += way
        ends.append(end)
    return ends[0], ends[1]
