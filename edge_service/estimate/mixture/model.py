"""Model and process of the mixture from a commissioned machine file."""

import math
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ...models.machine import GRAVITY_M_S2, Machine
from ...models.screw.ball_screw import screw_inertia
from ...models.screw.nut_law import nut_deflection
from . import state
from .state import AxisModel, MixtureSettings, Process

FRICTIONS = tuple(range(state.NUT_FRICTION, state.GUIDE_VISCOUS + 1))
CLEARANCE_M = 1.5e-6
"""Assumption: clearance of a nut that has lost its preload."""
SHORT_PHASE_S = 0.1
HANGS = 0.1
"""Share of the table's weight from which on a standing force is gravity."""
WOUND = ((1.0, 1 / 2), (1 / 2, 1 / 3))
"""The nut's drag winds up the screw: any share of a reversal may go with the preload."""
UPRIGHT, UPRIGHT_SIGMA = 0.8, 0.5
"""Share of another load's weight that acts along such an axis, an assumption with its spread."""


def axis_model(machine: Machine) -> AxisModel:
    """Constants of the model. The machine must be commissioned and know preload in percent."""
    commissioned, per_percent = machine.commissioned, machine.drag_per_percent_nm
    fresh, preload = machine.fresh_preload_percent, machine.model.preload_n
    assert commissioned is not None and per_percent is not None and fresh is not None
    assert preload is not None
    mass = machine.model.table_mass_kg
    mass_kg = mass.value if mass is not None else 1.0
    t, axis, ratio = commissioned.transmission, machine.axis, machine.transmission_ratio_m_per_rad
    compliance = t.stretch_per_acceleration_s2 / mass_kg if t else 0.0
    fresh_nm = per_percent * fresh
    guide_n = min(t.reversal_force_n, (commissioned.coulomb_nm - fresh_nm) / ratio) if t else 0.0
    deflection_m = 3.0 * preload.value * t.nut_share * compliance if t else 1.0
    clearance = 0.5 * CLEARANCE_M / deflection_m
    hanging_n = commissioned.torque_offset_nm / ratio
    hanging = nut_deflection(hanging_n, fresh, fresh, preload.value, clearance)[0]
    return AxisModel(
        ratio_m_per_rad=ratio,
        inertia_kg_m2=machine.model.inertia_kg_m2.value,
        table_mass_kg=mass_kg,
        drag_per_percent_nm=per_percent,
        fresh_percent=fresh,
        fresh_preload_n=preload.value,
        clearance_share=clearance,
        hanging_n=hanging_n,
        hanging_deflection=hanging,
        bearing_nm=commissioned.coulomb_nm - fresh_nm - ratio * guide_n,
        guide_n=guide_n,
        viscous_nm_s=machine.model.viscous_nm_s_per_rad.value,
        guide_viscous_n_s=t.guide_viscous_n_s_per_m if t else 0.0,
        screw_kg_m2=screw_inertia(axis.screw_diameter_m or 0.0, axis.screw_length_m or 0.0),
        asymmetry_nm_s=commissioned.viscous_asymmetry_nm_s_per_rad,
        compliance_m_per_n=compliance,
        compliance_slope_per_n=t.stretch_slope_s2_per_m / mass_kg if t else 0.0,
        compliance_bow_per_n_m=t.stretch_bow_s2_per_m2 / mass_kg if t else 0.0,
        reference_m=t.reference_m if t else 0.0,
        stribeck_nm=commissioned.stribeck_excess_nm,
        stribeck_speed_rad_s=commissioned.stribeck_speed_rad_s,
        stroke_m=machine.axis.stroke_m or 1.0,
        stroke_map=np.array(commissioned.stroke_map, dtype=np.float64).reshape(-1, 2),
        map_sigma_m=np.array(t.map_sigma_m if t else (), dtype=np.float64),
        lead_map_m=np.array(t.lead_map_m if t else (), dtype=np.float64),
        wind_up_map_m=np.array(t.wind_up_map_m if t else (), dtype=np.float64),
        torque_density=commissioned.noise_density_nm2_s,
        torque_slow_rad_s=commissioned.noise_slow_rad_s,
        edge_rad2_s2=commissioned.edge_noise_rad2_s2,
        stretch_density=t.noise_density_m2_s if t else 1.0,
        stretch_slow_rad_s=t.noise_slow_rad_s if t else 0.0,
    )


@dataclass(frozen=True, slots=True)
class Start:
    """Initial state of the hypotheses: the commissioned axis."""

    mean: Floats  # (n,) of a fresh preload
    covariance: Floats  # (n, n) before the first phase, the preload's being that of a fresh screw
    load: Floats  # (n, n), added by another load
    other_load: Floats  # (n, n), added by another load since the last session
    softer: Floats  # (n,), standard deviation of joints that have loosened unseen


def start_of(machine: Machine, model: AxisModel, settings: MixtureSettings) -> Start:
    """State and covariance before the first phase."""
    commissioned = machine.commissioned
    assert commissioned is not None
    t, drifts = commissioned.transmission, settings.together > 0.0
    size = state.STRETCH_STATES if t else state.TORQUE_STATES
    mean, sigma, softer = np.zeros((3, size))
    mean[state.PRELOAD], sigma[state.PRELOAD] = math.log(model.fresh_percent), settings.used_sigma
    mean[state.TORQUE_OFFSET] = commissioned.torque_offset_nm
    sigma[state.WEAR_RATE] = settings.steady_rate
    sigma[state.TORQUE_OFFSET] = 0.03 * commissioned.coulomb_nm * drifts
    mean[state.TORQUE_SCALE] = sigma[state.TORQUE_SCALE] = settings.torque_scale * drifts
    sigma[state.TORQUE_WANDER] = settings.wander * commissioned.coulomb_nm
    sigma[state.PAYLOAD] = settings.payload * model.table_mass_kg * drifts
    if t:
        mean[state.CLOCK_SKEW] = t.clock_skew_s
        mean[state.NUT_COMPLIANCE] = t.nut_share * model.compliance_m_per_n
        sigma[state.ENCODER_OFFSET], sigma[state.ENCODER_SLOPE] = 1e-4, 1e-4
        sigma[state.OFFSET_RATE], sigma[state.SLOPE_RATE] = 2e-8, 5e-8
        sigma[state.CLOCK_SKEW] = 2e-6
        sigma[state.NUT_COMPLIANCE] = t.nut_share_sigma * model.compliance_m_per_n
        sigma[state.LOOSENESS] = settings.looseness * model.compliance_m_per_n
        sigma[state.COUPLING] = sigma[state.LOOSENESS]
        softer[[state.LOOSENESS, state.COUPLING]] = settings.loosened * model.compliance_m_per_n
        mean[state.TABLE_MASS] = settings.twist
        mass = machine.model.table_mass_kg
        known = mass.sigma / mass.value if mass is not None else 0.0
        sigma[state.TABLE_MASS] = math.hypot(known, settings.twist)
        sigma[state.REVERSAL] = settings.reversal
        noise_m = 0.5 * math.sqrt(model.stretch_density / SHORT_PHASE_S)
        guide_m = model.compliance_m_per_n * settings.wander * model.guide_n
        sigma[state.STRETCH_WANDER] = math.hypot(noise_m, guide_m)
        sigma[state.MAP :] = settings.uneven_m / np.arange(1, state.MAP_STATES + 1)
    covariance = np.diag(sigma**2)
    covariance += settings.start_share**2 * _frictions(size, settings.together, settings.apart)
    load, hung = np.zeros((2, size))
    load[state.GUIDE_FRICTION], load[state.TORQUE_OFFSET] = 0.1, 0.1 * commissioned.coulomb_nm
    weight_n = GRAVITY_M_S2 * model.table_mass_kg
    if t and abs(model.hanging_n) > HANGS * weight_n:
        hung_n = math.copysign(settings.load * weight_n, model.hanging_n)
        hung[state.TORQUE_OFFSET] = model.ratio_m_per_rad * hung_n
        hung[state.ENCODER_OFFSET] = model.compliance_m_per_n * hung_n
    along = UPRIGHT * hung
    along[state.PAYLOAD] = settings.load * model.table_mass_kg
    apart = np.diag(load**2) + UPRIGHT_SIGMA**2 * np.outer(hung, hung)
    load, zero_nm = apart + np.outer(along, along), settings.zero * commissioned.coulomb_nm
    other_load = load.copy()
    other_load[state.TORQUE_OFFSET, state.TORQUE_OFFSET] += zero_nm**2
    return Start(mean, covariance, load, other_load, softer)


def _frictions(size: int, together: float, apart: float) -> Floats:
    """Covariance (n, n) of the frictions that move alike and apart."""
    covariance = np.zeros((size, size))
    block = slice(FRICTIONS[0], FRICTIONS[-1] + 1)
    covariance[block, block] = together**2 + apart**2 * np.eye(len(FRICTIONS))
    return covariance


def process_of(
    machine: Machine, model: AxisModel, start: Start, settings: MixtureSettings
) -> Process:
    """Process model: changes that the axis may undergo between two phases."""
    commissioned, rating = machine.commissioned, machine.axis.dynamic_load_rating_n
    assert commissioned is not None and rating is not None
    size, coulomb = len(start.mean), commissioned.coulomb_nm
    two, sigma = size > state.TORQUE_STATES, np.sqrt(np.diag(start.covariance))
    return Process(
        assumed=settings,
        walk=_walk(size, coulomb, settings),
        together=2.0 * settings.together**2 / settings.friction_s,
        torque_wander_nm=settings.wander * coulomb,
        stretch_wander_m=float(sigma[state.STRETCH_WANDER]) if two else 0.0,
        axial_n=settings.axial * coulomb / model.ratio_m_per_rad,
        loose_m=2e-6 if two else 0.0,
        mass_sigma=float(sigma[state.TABLE_MASS]) if two else 1.0,
        jumps=_jumps(size, start, model, settings),
        priors=_priors(state.CHALLENGERS, settings.hazard, settings.loosens, two),
        stop_priors=_priors(state.STOP_CHALLENGERS, settings.stop_hazard, 1.0, two),
        fresh_log_percent=math.log(model.fresh_percent),
        loosened_m_per_n=0.5 * _loosened(model, settings),
        force_n=settings.force * rating,
    )


def _walk(size: int, coulomb_nm: float, settings: MixtureSettings) -> Floats:
    """Variance per second that each element of the state gains, (n,)."""
    walk = np.zeros(size)
    walk[list(FRICTIONS)] = 2.0 * settings.apart**2 / settings.friction_s
    if settings.together > 0.0:
        walk[state.TORQUE_SCALE] = settings.torque_scale**2 / settings.motor_s
        walk[state.TORQUE_OFFSET] = (5e-4 * coulomb_nm) ** 2
    if size > state.TORQUE_STATES:
        walk[state.ENCODER_OFFSET], walk[state.ENCODER_SLOPE] = 3e-8**2, 6e-8**2
        walk[state.OFFSET_RATE], walk[state.SLOPE_RATE] = 1e-8**2, 2.5e-8**2
        walk[state.MAP :] = 3e-8**2
        walk[state.CLOCK_SKEW] = 2e-7**2
        walk[state.REVERSAL] = 2.0 * settings.reversal**2 / settings.friction_s
    return walk


def _jumps(size: int, start: Start, model: AxisModel, settings: MixtureSettings) -> Floats:
    """Covariance that a step of each hypothesis adds, (HYPOTHESES, n, n).

    What hangs, and friction where the encoders were zeroed, has stretched a loose joint before it
    is sought: the offset may hold that already.
    """
    jumps = np.zeros((state.HYPOTHESES, size, size))
    jumps[state.LOSS, state.PRELOAD, state.PRELOAD] = settings.loss**2
    jumps[state.LUBRICATION] = _frictions(size, settings.lubricated, settings.lubricated_apart)
    jumps[state.LUBRICATION, state.TORQUE_SCALE, state.TORQUE_SCALE] = settings.scale**2
    jumps[state.LOAD] = start.load
    if size > state.TORQUE_STATES:
        of = [state.PRELOAD, state.REVERSAL]
        jumps[state.LOSS][np.ix_(of, of)] = settings.loss**2 * np.array(WOUND)
        at = [state.LOOSENESS, state.COUPLING, state.ENCODER_OFFSET]
        held_n = math.hypot(model.hanging_n, model.guide_n)
        jumps[:, at, at] += np.outer(_loosened(model, settings), (1.0, 1.0, held_n)) ** 2
    return jumps


def _loosened(model: AxisModel, settings: MixtureSettings) -> Floats:
    """Standard deviation of what each hypothesis loosens each joint by, (HYPOTHESES,), m/N."""
    loosened = np.zeros(state.HYPOTHESES)
    loosened[state.LOOSENING] = settings.loosened * model.compliance_m_per_n
    loosened[state.LARGE_LOOSENING] = settings.loosened_large * model.compliance_m_per_n
    return loosened


def _priors(slots: tuple[int, ...], hazard: float, loosens: float, two: bool) -> Floats:
    """Log-probability per second of the steps that the axis can undergo, (HYPOTHESES,)."""
    priors = np.full(state.HYPOTHESES, -np.inf)
    for slot in slots:
        if two or slot not in (state.LOAD, state.LOOSENING, state.LARGE_LOOSENING):
            priors[slot] = math.log(hazard * (loosens if slot >= state.LOOSENING else 1.0))
    return priors
