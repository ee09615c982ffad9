"""Shares that no healthy recording determines, and whether the screw behind it is fresh.

The table's inertia and the nut's compliance are stated or assumed. Preload is read as a share of
the fresh screw's, so a worn screw that is learned as fresh is never seen again.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...models.commissioned import Notch, NotchConfig, TransmissionConfig
from ...models.machine import Machine, Quantity
from ...models.screw.stiffness import STEEL_MODULUS_PA, screw_area, screw_torsional_rigidity
from .series_compliance import SeriesCompliance
from .torque_balance import TorqueBalance

CORE_SHARE = 0.85
"""Assumption: core of a screw over its nominal diameter."""
NUT_SHARE, NUT_SHARE_SIGMA = 0.27, 0.12
"""Share of the series compliance where the machine file gives none: an assumption, with its spread.

Catalogue stiffness of preloaded nuts beside that of a fixed bearing, half the screw (5.3.9, with
its twist) and the coupling gives .18 to .38 for screws of 16 to 40 mm."""
WANTED_TESTS, TEST_SCATTER, LEAST_SCATTER = 3, 0.03, 0.003
"""Tests of the healthy axis from which on their scatter counts; what is assumed of fewer, and the
least: of the compliance from day to day, a share."""
SIGMAS = 3.0
UNEXPLAINED_SHARE = 0.1
"""Of the fresh screw's drag: friction of nobody, which a loss of as much could hide behind."""
SEEN_LOSS = 0.5
"""Of the fresh screw's drag: a file that knows the other frictions less well tells nothing."""


def table_mass(
    machine: Machine, torque: TorqueBalance, stretch: SeriesCompliance | None
) -> tuple[float, float]:
    """Mass of the table and its standard deviation, kg.

    Stated in the machine file, or from how the stretch grows along the screw, whose compliance per
    metre (eq. 5.3.9 and its twist) is known to about 30 % (fixed-free only), or a guess within the
    whole inertia and the friction: the guides' force at reversals is a measured stretch over the
    compliance, so it grows with the mass.
    """
    stated = machine.model.table_mass_kg
    if stated is not None:
        return stated.value, stated.sigma
    whole_kg = torque.inertia_kg_m2 / machine.transmission_ratio_m_per_rad**2
    guess = 0.3 * whole_kg
    if stretch is not None and stretch.reversal_m > 0.0:  # no more than the friction leaves
        other_n = other_drag_nm(machine, torque) / machine.transmission_ratio_m_per_rad
        guess = min(guess, other_n * stretch.per_acceleration_s2 / stretch.reversal_m or math.inf)
    guess_sigma = 0.5 * guess
    seen = None if stretch is None else _mass_by_slope(machine, stretch)
    if seen is None:
        return guess, guess_sigma
    weight, guess_weight = seen[1] ** -2.0, guess_sigma**-2.0
    value = (seen[0] * weight + guess * guess_weight) / (weight + guess_weight)
    return min(max(value, 0.05 * whole_kg), 0.95 * whole_kg), (weight + guess_weight) ** -0.5


def other_drag_nm(machine: Machine, torque: TorqueBalance) -> float:
    """Coulomb friction of guides, seals and bearings beyond the fresh screw's own, N m."""
    return max(torque.coulomb_nm - machine.fresh_drag_nm, 0.0)


def _mass_by_slope(machine: Machine, stretch: SeriesCompliance) -> tuple[float, float] | None:
    """Mass that stretches a metre of screw by as much, and its standard deviation, kg."""
    diameter = machine.axis.screw_diameter_m
    if diameter is None or machine.axis.bearing_arrangement != "fixed-free":
        return None
    core, ratio = CORE_SHARE * diameter, machine.transmission_ratio_m_per_rad
    per_metre = 1.0 / (STEEL_MODULUS_PA * screw_area(core))
    per_metre += ratio**2 / screw_torsional_rigidity(core)
    seen = stretch.slope_per_m * stretch.per_acceleration_s2 / per_metre
    if seen <= 0.0:
        return None
    return seen, seen * math.hypot(stretch.slope_sigma / max(stretch.slope_per_m, 1e-9), 0.3)


def nut_share(machine: Machine, compliance_m_per_n: float, tolerance: float) -> tuple[float, float]:
    """Share of the series compliance that is the nut's, and its standard deviation.

    The compliance is a measured stretch over the table's mass, so the share of a stated nut is no
    better known than the mass (`tolerance`): the worse of both counts. Where that is worse than
    the assumption, both are weighed.
    """
    nut = machine.model.nut_stiffness_n_per_m
    if nut is None:
        return NUT_SHARE, NUT_SHARE_SIGMA
    share = min(1.0 / (nut.value * compliance_m_per_n), 0.95)
    relative = max(nut.tolerance, 0.02, tolerance)
    sigma = relative * NUT_SHARE  # of any share as likely: one that reads low is no better known
    if sigma < NUT_SHARE_SIGMA:
        return share, relative * share
    weight, assumed = sigma**-2.0, NUT_SHARE_SIGMA**-2.0
    return (share * weight + NUT_SHARE * assumed) / (weight + assumed), (weight + assumed) ** -0.5


def learned_notch(tests: Sequence[Notch], machine: Machine, learned: Machine) -> NotchConfig:
    """Mean of the tests of a healthy axis; the scatter of its compliance is that of the repeats.

    `machine` has the data sheet's figures. A mass that it does not state follows from the inertia.
    """
    count, ratio = len(tests), machine.transmission_ratio_m_per_rad
    names = Notch.model_fields.keys() - {"friction_nm"}
    mean = {name: float(np.mean([getattr(test, name) for test in tests])) for name in names}
    levels = [test.friction_nm for test in tests if test.friction_nm is not None]
    level_nm = float(np.mean(levels)) if levels else None
    scatter = TEST_SCATTER
    if count >= WANTED_TESTS:
        spread = np.std([2.0 * math.log(test.antiresonance_hz) for test in tests], ddof=1)
        scatter = max(float(spread) * math.sqrt(1.0 + 1.0 / count), LEAST_SCATTER)
    mass = machine.model.table_mass_kg
    if mass is None:
        table = mean["inertia_ratio"]
        whole_kg = learned.model.inertia_kg_m2.value / ratio**2
        error = mean["inertia_ratio_sigma"] / table / (1.0 + table)
        mass = Quantity(value=whole_kg * table / (1.0 + table), tolerance=error)
    stiffness = mass.value * (2.0 * math.pi * mean["antiresonance_hz"]) ** 2
    share, sigma = nut_share(machine, 1.0 / stiffness, mass.tolerance)
    more = {"compliance_scatter": scatter, "nut_share": share, "nut_share_sigma": sigma}
    return NotchConfig(**mean, **more, friction_nm=level_nm, repeats=count)


@dataclass(frozen=True, slots=True)
class Doubt:
    """Reason why recordings do not show a fresh screw."""

    words: str
    contradicts: bool  # the data sheet's figures speak against it; else they leave it open


def doubt_of_fresh_screw(nominal: Machine, learned: Machine) -> Doubt | None:
    """Reason why the learned recordings do not show a fresh screw; None where they do.

    The whole friction is what the machine file states of screw, guides and bearings. Or two
    encoders see the guides' friction, and what they leave is more than the fresh screw's own, for
    it holds the bearings' too; some of the screw's may act on the table's side and pass for the
    guides'. With one encoder the guides could be what a worn screw has lost. The stiffness cannot
    tell: a nut that lost half its preload is a fifth softer by the cube root law, and the axis, of
    which it is a quarter, by a twentieth. A file that knows all frictions, such as one that was
    commissioned before, leaves it open again where some of them is missing. `nominal` has the data
    sheet's figures.
    """
    screw, taught = nominal.model.preload_drag_nm, learned.commissioned
    if screw is None or taught is None or not nominal.fresh_drag_nm:
        return None
    stated_nm = taught.coulomb_nm - nominal.other_drag_nm.value
    sigma = math.hypot(learned.model.bearing_drag_nm.sigma, nominal.other_drag_nm.sigma)
    reach_nm = SIGMAS * math.hypot(sigma, screw.sigma)
    is_known = reach_nm <= SEEN_LOSS * screw.value
    missing_nm = screw.value - stated_nm
    assumed = None
    if nominal.commissioned is not None and nominal.commissioned.assumed_fresh:
        words = "the machine file was made on that assumption (commissioned.assumed_fresh)"
        assumed = Doubt(words, False)
    if is_known and -reach_nm - UNEXPLAINED_SHARE * screw.value <= missing_nm <= reach_nm:
        return assumed
    guide = guide_drag(nominal, taught.transmission)
    left_nm = stated_nm if guide is None else taught.coulomb_nm - guide.value
    said = (
        f"{left_nm:.3g} N m of friction is left for screw and bearings, and the data sheet's "
        f"fresh screw alone has {screw.value:.3g} (model.preload_drag_nm)"
    )
    if left_nm < screw.value:
        return Doubt(f"{said}: worn, warm, or part of its drag acts behind its spring", True)
    if guide is not None and not (is_known and missing_nm > reach_nm):
        return assumed
    if guide is not None:
        words = (
            f"friction is {missing_nm:.3g} N m less than the machine file states for a fresh "
            "screw, guides and bearings together: worn, warm or newly lubricated"
        )
        return Doubt(words, False)
    words = (
        f"{said}: the rest may be guides and bearings, or hide a preload that is lost; state "
        f"{'more closely ' * bool(nominal.other_drag_nm.value)}model.guide_force_n and "
        "model.bearing_drag_nm, or record a linear encoder and state model.table_mass_kg"
    )
    return Doubt(words, False)


def guide_drag(machine: Machine, transmission: TransmissionConfig | None) -> Quantity | None:
    """Friction that the stretch shows at reversals, N m; None where no mass gives its size."""
    mass = machine.model.table_mass_kg
    if transmission is None or mass is None:
        return None
    stretch_sigma = transmission.stretch_sigma_s2 / transmission.stretch_per_acceleration_s2
    value = transmission.reversal_force_n * machine.transmission_ratio_m_per_rad
    return Quantity(value=value, tolerance=math.hypot(mass.tolerance, stretch_sigma))
