"""Deviations that a healthy axis may have: parameters within tolerance, a trace of everything."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ...models.effects.effect import Effect, Kind, Term
from ...models.effects.registry import effects, error_of, get_effect
from ...models.machine import DEFAULT_TOLERANCE, Machine
from ..candidates.regressor import EntryRegressor, entry_regressor
from .session import TORQUE_GAP, TRANSMISSION_GAP

TOLERANCE_OF_FLOOR = 1.0
"""Gap beyond its floor that nobody acts on where the machine file states none, over the floor."""
MOST_OF_TORQUE = 0.1
"""Of the torque in motion: a gap beyond that is acted on, however much else is noise."""
TOLERANCE_OF_TORQUE = 1e-3
"""The same over the greatest torque: drives state their torque in such steps."""
INTERPOLATION_M = 5e-8
"""Error of interpolation within a signal period of a good linear encoder (assumption)."""


@dataclass(frozen=True, slots=True)
class HealthyPrior:
    """Nuisance effect of a healthy axis: its coefficient is normal with `mean` and `sigma`."""

    regressor: EntryRegressor
    mean: float
    sigma: float


def parameter_tolerances(machine: Machine) -> dict[str, float]:
    """Standard deviation of each parameter effect's amount, as the machine file states it.

    How well the inertia is known says nothing of the torque's own scale.
    """
    model = machine.model
    drag = model.preload_drag_nm
    tolerances = {
        Term.INERTIA: model.inertia_kg_m2.sigma,
        Term.VISCOUS: model.viscous_nm_s_per_rad.sigma,
        Term.COULOMB: machine.other_drag_nm.sigma + (drag.sigma if drag else 0.0),
        Term.GAIN: min(model.inertia_kg_m2.tolerance, DEFAULT_TOLERANCE),
    }
    return {error_of(term): sigma for term, sigma in tolerances.items()}


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


def stated_tolerance(
    machine: Machine, floor: Mapping[str, float], torque_nm: float
) -> dict[str, float]:
    """Gap beyond the floor that nobody acts on, by channel.

    As the machine file states it; otherwise as much as the floor, in the torque no more than a
    tenth of the torque in motion, and no less than a thousandth of the drive's greatest torque, and
    what a linear encoder's own interpolation makes.

    Args:
        torque_nm: root mean square of the torque in motion.
    """
    stated = {
        TORQUE_GAP: machine.tolerance.torque_nm,
        TRANSMISSION_GAP: machine.tolerance.position_m,
    }
    least = {
        TORQUE_GAP: TOLERANCE_OF_TORQUE * (machine.axis.max_torque_nm or 0.0),
        TRANSMISSION_GAP: INTERPOLATION_M,
    }
    most = {TORQUE_GAP: MOST_OF_TORQUE * torque_nm}
    return {
        name: stated[name]
        or max(min(TOLERANCE_OF_FLOOR * rms, most.get(name, math.inf)), least[name])
        for name, rms in floor.items()
    }


def parameter_priors(prior: Sequence[HealthyPrior]) -> dict[str, tuple[float, float]]:
    """Effect -> healthy mean and tolerance, where its amount is all that it has."""
    return {
        each.regressor.name: (each.mean, each.sigma)
        for each in prior
        if not each.regressor.shape and len(each.regressor.effect.parameters) == 1
    }
