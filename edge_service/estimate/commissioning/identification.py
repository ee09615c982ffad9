"""Commissioning of a healthy, cold axis: friction, inertia, stretch and their noise by regression.

Both regressions run on phases of steady motion (messages.features.Phase), with the exact balance of
momentum (thesis, eq. 4.3.4) and the series stiffness under inertia force (5.3.1) as models.
"""

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from ...messages.features import FeatureBlock
from ...messages.samples import Floats
from ...models.commissioned import CommissionedConfig, TransmissionConfig
from ...models.machine import Machine, Quantity
from ...models.screw.stroke_profile import preload_share
from ...models.steady_limits import CRUISE_RAD_S2, SLOWEST_RAD_S, SteadyLimits, steady_limits
from ..effect_compensation import EffectCompensation
from .checks import (
    inertia_doubt,
    require_fresh_screw,
    require_identified,
    require_light_guides,
    require_stated_nut,
)
from .phases import SteadyPhases
from .series_compliance import SeriesCompliance, fit_series_compliance
from .shares import nut_share, other_drag_nm, table_mass
from .torque_balance import TorqueBalance, fit_torque_balance


def commissioned(
    recordings: Sequence[Sequence[FeatureBlock]],
    machine: Machine,
    limits: SteadyLimits | None = None,
) -> Machine:
    """Machine file with the parameters identified from blocks of the healthy, cold axis.

    The recordings come in any order; `limits` of steady motion in the blocks are those of the
    nominal machine file unless given.

    Raises:
        CommissioningError: the recordings cannot determine it; the text names the motion.
    """
    limits = limits or steady_limits(machine.model_copy(update={"commissioned": None}))
    known = EffectCompensation.of_machine(machine) if machine.effects else None
    phases = SteadyPhases.of(recordings, known)
    torque = fit_torque_balance(phases, machine, limits)
    # known effects are still in the windows of intervals
    doubt_kg_m2 = 0.0 if machine.effects else inertia_doubt(recordings, torque)
    require_identified(phases, torque, doubt_kg_m2, machine)
    stroke_map = torque.harmonics_nm / (machine.fresh_drag_nm or torque.coulomb_nm)
    stretch = fit_series_compliance(
        phases, machine, partial(_nut_compliance_share, machine, torque, stroke_map)
    )
    mass = table_mass(machine, torque, stretch)
    transmission = _transmission(machine, stretch, mass)
    require_fresh_screw(torque, machine, transmission)
    require_stated_nut(machine, transmission)
    require_light_guides(torque, machine)
    ratio = machine.transmission_ratio_m_per_rad
    reversal_n = math.inf if transmission is None else transmission.reversal_force_n
    other_nm = other_drag_nm(machine, torque)  # without a linear encoder all of it is the guide's
    guide_n = min(reversal_n, other_nm / ratio)
    by_mass = 0.0 if transmission is None else mass[1] / mass[0]
    guide_sigma = max(torque.coulomb_sigma / ratio, max(by_mass, 0.02) * guide_n)
    inertia_sigma = math.hypot(torque.inertia_sigma, doubt_kg_m2)
    model: dict[str, Quantity | None] = {
        "inertia_kg_m2": _measured(torque.inertia_kg_m2, inertia_sigma),
        "viscous_nm_s_per_rad": _measured(torque.viscous_nm_s_per_rad, torque.viscous_sigma),
        "guide_force_n": _measured(guide_n, guide_sigma),
        "bearing_drag_nm": _measured(max(other_nm - ratio * reversal_n, 0.0), torque.coulomb_sigma),
        "table_mass_kg": _measured(*mass),
        # without a preload the level of the whole axis, of which guide and bearing are the parts
        "preload_drag_nm": machine.model.preload_drag_nm if machine.model.preload_n else None,
    }
    periods_s = (
        [block.duration_s / block.sample_count for block in blocks if block.sample_count]
        for blocks in recordings
    )
    slowest_s = max(float(np.median(periods)) for periods in periods_s if periods)
    learned = CommissionedConfig(
        torque_offset_nm=torque.offset_nm,
        viscous_asymmetry_nm_s_per_rad=torque.asymmetry_nm_s_per_rad,
        stribeck_excess_nm=torque.stribeck_nm,
        stribeck_speed_rad_s=torque.stribeck_speed_rad_s,
        stroke_map=tuple((float(c), float(d)) for c, d in stroke_map),
        coulomb_nm=torque.coulomb_nm,
        noise_density_nm2_s=torque.noise.density,
        noise_slow_rad_s=torque.noise.slow_rad_s,
        motion_s=torque.motion_s,
        slowest_rad_s=None if limits.slowest_rad_s == SLOWEST_RAD_S else limits.slowest_rad_s,
        cruise_rad_s2=None if limits.cruise_rad_s2 == CRUISE_RAD_S2 else limits.cruise_rad_s2,
        transmission=transmission,
        sample_period_s=round(slowest_s, 6),
    )
    model_learned = machine.model.model_copy(update=model)
    return machine.model_copy(update={"model": model_learned, "commissioned": learned})


def _nut_compliance_share(
    machine: Machine, torque: TorqueBalance, stroke_map: Floats, table_m: Floats, stretch_s2: float
) -> Floats:
    """Compliance beyond that of the mean preload, over the whole compliance, (n,) (eq. 5.3.11)."""
    if not len(stroke_map) or stretch_s2 <= 0.0:
        return np.zeros_like(table_m)
    mass_kg, sigma_kg = table_mass(machine, torque, None)
    share, _ = nut_share(machine, stretch_s2 / mass_kg, sigma_kg / mass_kg)
    factor = preload_share(stroke_map, table_m / (machine.axis.stroke_m or 1.0))
    return np.asarray(share * (np.maximum(factor, 0.1) ** (-1.0 / 3.0) - 1.0))


def _measured(value: float, sigma: float) -> Quantity:
    tolerance = sigma / abs(value) if value else 0.0
    return Quantity(value=value, tolerance=min(max(tolerance, 1e-4), 10.0))


def _transmission(
    machine: Machine, stretch: SeriesCompliance | None, mass: tuple[float, float]
) -> TransmissionConfig | None:
    if stretch is None or machine.fresh_preload_percent is None:
        return None
    compliance = stretch.per_acceleration_s2 / mass[0]
    share, sigma = nut_share(machine, compliance, mass[1] / mass[0])
    return TransmissionConfig(
        reference_m=stretch.reference_m,
        stretch_per_acceleration_s2=stretch.per_acceleration_s2,
        stretch_slope_s2_per_m=stretch.slope_per_m * stretch.per_acceleration_s2,
        stretch_bow_s2_per_m2=stretch.bow_per_m2 * stretch.per_acceleration_s2,
        stretch_sigma_s2=stretch.sigma_s2,
        nut_share=share,
        nut_share_sigma=sigma,
        reversal_force_n=max(stretch.reversal_m / compliance, 0.0),
        guide_viscous_n_s_per_m=stretch.per_speed_s / compliance,
        clock_skew_s=stretch.skew_s,
        lead_map_m=tuple(float(value) for value in stretch.lead_map_m),
        wind_up_map_m=tuple(float(value) for value in stretch.wind_up_map_m),
        map_sigma_m=tuple(float(value) for value in stretch.map_sigma_m),
        noise_density_m2_s=stretch.noise.density,
        noise_slow_rad_s=stretch.noise.slow_rad_s,
    )
