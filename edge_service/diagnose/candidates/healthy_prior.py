"""Priors of a healthy axis: parameters within their tolerance, traces of what none is free of."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ...models.effects.effect import Effect, Kind
from ...models.effects.registry import effects, get_effect
from ...models.machine import Machine
from ..session.tolerance import parameter_tolerances
from .regressor import EntryRegressor, entry_regressor


@dataclass(frozen=True, slots=True)
class HealthyPrior:
    """Nuisance effect of a healthy axis: its coefficient is normal with `mean` and `sigma`."""

    regressor: EntryRegressor
    mean: float
    sigma: float


def healthy_priors(machine: Machine, period_s: float, coulomb_nm: float) -> Sequence[HealthyPrior]:
    """Parameters within their tolerance, and traces of what no axis is free of."""
    known = [
        HealthyPrior(_one(get_effect(name), {}), 0.0, sigma)
        for name, sigma in parameter_tolerances(machine).items()
        if sigma > 0.0
    ]
    traces = [
        HealthyPrior(_one(effect, trace.shape), *trace.prior(period_s, coulomb_nm))
        for effect in sorted(effects().values(), key=_parameters_first)
        for trace in (effect.trace,)
        if trace.prior
    ]
    return known + traces


def _parameters_first(effect: Effect) -> tuple[bool, int, str]:
    """Order of columns, on which the last digits of an answer depend."""
    return effect.term is None, list(Kind).index(effect.kind), effect.name


def _one(effect: Effect, shape: Mapping[str, float]) -> EntryRegressor:
    amounts = [p.name for p in effect.parameters if p.role.value == "amount"]
    return entry_regressor(effect, amounts[0] if amounts else "", shape)


def parameter_priors(prior: Sequence[HealthyPrior]) -> dict[str, tuple[float, float]]:
    """Effect -> healthy mean and tolerance, where its amount is all that it has."""
    return {
        each.regressor.name: (each.mean, each.sigma)
        for each in prior
        if not each.regressor.shape and len(each.regressor.effect.parameters) == 1
    }
