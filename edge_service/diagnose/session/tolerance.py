"""Tolerances of a machine: of the model's parameters, and of the gap that nobody acts on."""

import math
from collections.abc import Mapping

from ...models.effects.effect import Term
from ...models.effects.registry import error_of
from ...models.machine import DEFAULT_TOLERANCE, Machine
from .session import TORQUE_GAP, TRANSMISSION_GAP

TOLERANCE_OF_FLOOR = 1.0
"""Gap beyond its floor that nobody acts on where the machine file states none, over the floor."""
MOST_OF_TORQUE = 0.1
"""Of the torque in motion: a gap beyond that is acted on, however much else is noise."""
TOLERANCE_OF_TORQUE = 1e-3
"""The same over the greatest torque: drives state their torque in such steps."""
INTERPOLATION_M = 5e-8
"""Error of interpolation within a signal period of a good linear encoder (assumption)."""


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
