"""Rigid twin of an axis, and how far its parameters may be off."""

from dataclasses import replace

import numpy as np

from ...models.effects.baseline import Baseline
from ...models.effects.effect import Term
from ...models.effects.registry import error_of
from ...models.machine import DEFAULT_TOLERANCE, Machine
from ...models.plant.two_mass import Plant

_STIFFENING = 300.0


def rigid_baseline(machine: Machine) -> Baseline:
    """Baseline as the machine file means it: nothing winds up."""
    baseline = Baseline.of_machine(machine)
    return replace(baseline, compliance_m_per_n=np.zeros_like(baseline.compliance_m_per_n))


def rigid_plant(plant: Plant) -> Plant:
    """Plant whose springs are too stiff to show."""
    return plant._replace(
        screw_rigidity_n=plant.screw_rigidity_n * _STIFFENING,
        nut_catalogue_n_per_m=plant.nut_catalogue_n_per_m * _STIFFENING,
        bearing_compliance_m_per_n=plant.bearing_compliance_m_per_n / _STIFFENING,
        further_compliance_m_per_n=plant.further_compliance_m_per_n / _STIFFENING,
        damping_n_s_per_m=plant.damping_n_s_per_m * np.sqrt(_STIFFENING),
    )


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
