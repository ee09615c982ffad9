"""Deviations that a healthy axis may have: parameters within tolerance, a trace of everything."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ...models.effects.registry import get_effect
from ...models.machine import DEFAULT_TOLERANCE, Machine
from ..candidates.regressor import EntryRegressor, entry_regressor
from .session import TORQUE_GAP, TRANSMISSION_GAP

_CURRENT_LOOP_S, _STAMPED_S = 3e-4, 1e-4
"""Assumption: no current loop answers later, and no torque is stamped less exactly."""
TOLERANCE_OF_FLOOR = 1.0
"""Gap beyond its floor that nobody acts on where the machine file states none, over the floor."""
MOST_OF_TORQUE = 0.1
"""Of the torque in motion: a gap beyond that is acted on, however much else is noise."""
TOLERANCE_OF_TORQUE = 1e-3
"""The same over the greatest torque: drives state their torque in such steps."""
INTERPOLATION_M = 5e-8
"""Error of interpolation within a signal period of a good linear encoder (assumption)."""
MATERIAL_TOLERANCES = 3.0
"""A parameter that is off by more tolerances than this is a cause."""


@dataclass(frozen=True, slots=True)
class HealthyPrior:
    """An effect of a healthy axis: its coefficient is normal with `mean` and `sigma`."""

    regressor: EntryRegressor
    mean: float
    sigma: float


def parameter_tolerances(machine: Machine) -> dict[str, float]:
    """Standard deviation of each parameter effect's amount, as the machine file states it."""
    model = machine.model
    drag = model.preload_drag_nm
    return {
        "inertia_error": model.inertia_kg_m2.sigma,
        "viscous_error": model.viscous_nm_s_per_rad.sigma,
        "drag_error": machine.other_drag_nm.sigma + (drag.sigma if drag else 0.0),
        "torque_gain_error": min(model.inertia_kg_m2.tolerance, DEFAULT_TOLERANCE),
    }


def healthy_priors(machine: Machine, period_s: float, coulomb_nm: float) -> Sequence[HealthyPrior]:
    """Parameters within their tolerance, and traces of what no axis is free of.

    A torque may be recorded as it acts, or as a command that is held for a period and acts half a
    period late, behind a current loop of a few tenths of a millisecond. Sliding begins after a
    micrometre; dry friction is a few percent higher at a creep. How well the inertia is known says
    nothing of the torque's own scale.
    """
    found = [
        HealthyPrior(_one(name), 0.0, sigma)
        for name, sigma in parameter_tolerances(machine).items()
        if sigma > 0.0
    ]
    latest_s = 0.5 * period_s + _CURRENT_LOOP_S
    spread_s = (0.5 * latest_s + _STAMPED_S) / MATERIAL_TOLERANCES
    found.append(HealthyPrior(_one("delay"), 0.5 * latest_s, spread_s))
    found.append(HealthyPrior(_one("presliding", reach_m=1e-6), 0.5, 0.5))
    slow = _one("stribeck", speed_rad_s=1.5, exponent=1.0)
    found.append(HealthyPrior(slow, 0.0, max(0.05 * coulomb_nm, 1e-9)))
    found.append(
        HealthyPrior(_one("compliance", friction_share=1.0, viscous_share=0.0), 0.0, 2e-10)
    )
    return found


def _one(name: str, **shape: float) -> EntryRegressor:
    effect = get_effect(name)
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
