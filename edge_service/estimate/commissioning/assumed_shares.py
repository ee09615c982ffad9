"""Shares that no healthy recording determines: the table's inertia, the nut's compliance."""

import math

import numpy as np

from ...models.machine import Machine
from ...models.screw.stiffness import STEEL_MODULUS_PA, screw_area, screw_torsional_rigidity
from .series_compliance import SeriesCompliance
from .torque_balance import TorqueBalance

CORE_SHARE = 0.85
"""Assumption: core of a screw over its nominal diameter."""
NUT_SHARE, NUT_SHARE_SIGMA = 0.27, 0.12
"""Share of the series compliance where the machine file gives none: an assumption, with its spread.

Catalogue stiffness of preloaded nuts beside that of a fixed bearing, half the screw (5.3.9, with
its twist) and the coupling gives .18 to .38 for screws of 16 to 40 mm."""


def table_mass(
    machine: Machine, torque: TorqueBalance, stretch: SeriesCompliance | None
) -> tuple[float, float]:
    """Mass of the table and its standard deviation, kg.

    Stated in the machine file, or from how the stretch grows along the screw, whose compliance per
    metre (eq. 5.3.9 and its twist) is known to about 30 % (fixed-free only), or a guess within the
    whole inertia and the friction.
    """
    stated = machine.model.table_mass_kg
    if stated is not None:
        return stated.value, stated.sigma
    whole_kg = torque.inertia_kg_m2 / machine.transmission_ratio_m_per_rad**2
    guess = min(0.3 * whole_kg, _most_mass(machine, torque, stretch))
    guess_sigma = 0.5 * guess
    seen = None if stretch is None else _mass_by_slope(machine, stretch)
    if seen is None:
        return guess, guess_sigma
    weight, guess_weight = seen[1] ** -2.0, guess_sigma**-2.0
    value = (seen[0] * weight + guess * guess_weight) / (weight + guess_weight)
    return min(max(value, 0.05 * whole_kg), 0.95 * whole_kg), (weight + guess_weight) ** -0.5


def other_drag_nm(machine: Machine, torque: TorqueBalance) -> float:
    """Coulomb friction of guides, seals and bearings beyond the fresh screw's own, N m."""
    screw = machine.model.preload_drag_nm
    fresh_nm = screw.value if screw is not None and machine.model.preload_n is not None else 0.0
    return max(torque.coulomb_nm - fresh_nm, 0.0)


def _most_mass(machine: Machine, torque: TorqueBalance, stretch: SeriesCompliance | None) -> float:
    """Mass beyond which the guides' force at reversals were more than the friction, kg.

    That force is a measured stretch over the compliance, so it grows with the mass.
    """
    if stretch is None or stretch.reversal_m <= 0.0:
        return math.inf
    other_n = other_drag_nm(machine, torque) / machine.transmission_ratio_m_per_rad
    return other_n * stretch.per_acceleration_s2 / stretch.reversal_m or math.inf


def _mass_by_slope(machine: Machine, stretch: SeriesCompliance) -> tuple[float, float] | None:
    """Mass that stretches a metre of screw by as much, and its standard deviation, kg."""
    diameter = machine.axis.screw_diameter_m
    if diameter is None or machine.axis.bearing_arrangement != "fixed-free":
        return None
    core = CORE_SHARE * diameter
    ratio = machine.transmission_ratio_m_per_rad
    per_metre = 1.0 / (STEEL_MODULUS_PA * screw_area(core))
    per_metre += ratio**2 / screw_torsional_rigidity(core)
    seen = stretch.slope_per_m * stretch.per_acceleration_s2 / per_metre
    if seen <= 0.0:
        return None
    share = float(np.hypot(stretch.slope_sigma / max(stretch.slope_per_m, 1e-9), 0.3))
    return seen, seen * share


def nut_share(
    machine: Machine, compliance_m_per_n: float, mass_tolerance: float
) -> tuple[float, float]:
    """Share of the series compliance that is the nut's, and its standard deviation.

    The compliance is a measured stretch over the table's mass, so the share of a stated nut is no
    better known than the mass: the worse known of the two counts. Where that is worse than the
    assumption, both are weighed.
    """
    nut = machine.model.nut_stiffness_n_per_m
    if nut is None:
        return NUT_SHARE, NUT_SHARE_SIGMA
    share = min(1.0 / (nut.value * compliance_m_per_n), 0.95)
    relative = max(nut.tolerance, 0.02, mass_tolerance)
    sigma = relative * NUT_SHARE  # of any share as likely: one that reads low is no better known
    if sigma < NUT_SHARE_SIGMA:
        return share, relative * share
    weight, assumed = sigma**-2.0, NUT_SHARE_SIGMA**-2.0
    return (share * weight + NUT_SHARE * assumed) / (weight + assumed), (weight + assumed) ** -0.5
