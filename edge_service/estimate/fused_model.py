"""From a commissioned machine file to the numbers of the fused estimator."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ..messages.samples import Floats
from ..models.machine import Machine
from .fused_state import (
    ASYMMETRY,
    DRY,
    GAIN,
    GAP,
    GAP_RATE,
    GROWTH,
    GROWTH_RATE,
    GUIDE,
    LUBE,
    MASS,
    NUT,
    OFFSET,
    PLAY,
    PRELOAD,
    QUIET,
    RATE,
    RUB_NODES,
    SETTLING,
    SKEW,
    SLIDE,
    STATES,
    TURN_COS,
    TURN_SIN,
    VISCOUS,
    WEARING,
    WIND_UP_SHARE,
    Drift,
    FusedModel,
)

GROWTH_NODE_M = 0.04
GROWTH_REACH_M = 0.1
"""Places nearer than this grow alike."""
RUB_REACH_M = 0.1
"""Places nearer than this rub alike."""
RUB_SHARE = 0.15
"""Standard deviation of a misalignment's friction, over the whole friction."""
LOSSES = ((0.15, 0.1), (0.6, 0.25), (0.97, 0.05))
"""Sudden losses, small, large and total: mean and standard deviation over the fresh preload."""
WEAR_PERCENT_S = 0.05
"""Mean and standard deviation of a rate of loss, % per second of motion."""
RATE_WALK = 3e-4
"""Of that rate, %/s per sqrt(s) of motion. A wear that could turn within seconds would explain
every drift of the friction."""
STRETCH_DOUBT = 2.0
"""Variance of the stretch over that of the residuals in commissioning. At 1 healthy axes read .05
to .2 points low, as if errors repeated at a place; at 3 a loss of all preload reads too high."""
LUBE_SHARE, LUBE_WALK, LUBE_JUMP = 0.1, 0.5, 0.15
"""Of the nut's friction: error at the start and walk over those of the others,
and standard deviation of a sudden change as a share."""
GAIN_JUMP = 0.06
"""Standard deviation of a sudden change of the torque constant, as a share."""
LOADED_GAIN = 0.003
"""Error of the torque constant as a share, where the payload is unknown: torque alone cannot tell
the two apart."""
PLAY_M = 5e-6
"""Standard deviation of a play that comes up."""
TURN_M = 2e-6
"""Standard deviation of the shift by an encoder that is off its centre, where it is."""
UNCHANGED_SHARE, CHANGED_SHARE, WARM_SHARE = 0.02, 0.1, 0.2
"""Standard deviation of each friction at the start over the commissioned one: on an axis that has
hardly changed since, on one that was lubricated or has run a little, and on a warm one."""
WARM_GROWTH_M, WARM_REACH_M = 3e-6, 0.2
"""Uneven growth of a screw that is warm at the start, and over which way it is alike."""
CLEARANCE_M = 1.5e-6
"""Assumption: clearance of a nut that has lost its preload."""


@dataclass(frozen=True, slots=True)
class FusedSettings:
    """What is thought likely to happen to an axis; shares are of the commissioned value.

    Attributes:
        preload_walk: of a quiet preload, % per sqrt(s) of motion.
        friction_walk: of every friction (warm-up), share per sqrt(s); 0 where all dry friction is
            the screw's (the seed's plant).
        growth_m: of the difference between the encoders, m per sqrt(s).
        uneven_growth_m: the same of a place along the stroke against its neighbours, and
            `uneven_start_m` the error of the map from commissioning.
        growth_rate_m_s: of the speed at which that difference grows, m/s per sqrt(s).
        gain_error, gain_walk: of the torque constant since commissioning, and per sqrt(s); shares.
        unchanged: probability that the axis begins hardly different from commissioning.
        warm: that its screw is warm; else its friction is another.
        rare: that it begins with a play or an encoder off its centre; with another payload; with
            another torque constant; each.
        rub_share: error of the guides' friction along the stroke at the start, as a share.
        loss_hazard, friction_hazard, payload_hazard, wear_hazard, backlash_hazard,
            misalignment_hazard, gain_hazard: per second of motion.
        force_hazard: share of phases in which a process force begins.
        force_stay: probability that it lasts for another phase.
        process_force_n: standard deviation of forces on the table.
    """

    preload_walk: float = 0.003
    friction_walk: float = 0.003
    growth_m: float = 2e-8
    growth_rate_m_s: float = 4e-9
    gain_error: float = 0.01
    gain_walk: float = 3e-4
    uneven_growth_m: float = 2e-8
    uneven_start_m: float = 2e-8
    rub_share: float = 0.01
    backlash_hazard: float = 2e-4
    misalignment_hazard: float = 2e-4
    gain_hazard: float = 1e-4
    unchanged: float = 0.5
    warm: float = 0.05
    rare: float = 0.003
    loss_hazard: float = 5e-4
    friction_hazard: float = 5e-4
    payload_hazard: float = 1e-3
    wear_hazard: float = 1e-3
    force_hazard: float = 0.01
    force_stay: float = 0.9
    process_force_n: float = 600.0


def fused_model(machine: Machine, settings: FusedSettings) -> FusedModel:
    """Constants of the model. The machine must be commissioned and know preload in percent."""
    taught, per_percent = machine.commissioned, machine.drag_per_percent_nm
    fresh = machine.fresh_preload_percent
    assert taught is not None and per_percent is not None and fresh is not None
    mass = machine.model.table_mass_kg
    mass_kg = mass.value if mass is not None else 1.0
    t = taught.transmission
    preload = machine.model.preload_n
    assert preload is not None
    compliance = t.stretch_per_acceleration_s2 / mass_kg if t else 0.0
    d0 = 3.0 * preload.value * t.nut_share * compliance if t else 1.0
    stroke_map = np.array(taught.stroke_map, dtype=np.float64).reshape(-1, 2)
    return FusedModel(
        ratio_m_per_rad=machine.transmission_ratio_m_per_rad,
        inertia_kg_m2=machine.model.inertia_kg_m2.value,
        table_mass_kg=mass_kg,
        drag_per_percent_nm=per_percent,
        fresh_percent=fresh,
        fresh_preload_n=preload.value,
        clearance_share=0.5 * CLEARANCE_M / d0,
        compliance_m_per_n=compliance,
        compliance_slope_per_n=t.stretch_slope_s2_per_m / mass_kg if t else 0.0,
        reference_m=t.reference_m if t else 0.0,
        stribeck_nm=taught.stribeck_excess_nm,
        stribeck_speed_rad_s=taught.stribeck_speed_rad_s,
        stroke_m=machine.axis.stroke_m or 1.0,
        stroke_map=stroke_map,
        lead_map_m=np.array(t.lead_map_m if t else (), dtype=np.float64),
        wind_up_map_m=np.array(t.wind_up_map_m if t else (), dtype=np.float64),
        torque_density=taught.noise_density_nm2_s,
        edge_rad2_s2=taught.edge_noise_rad2_s2,
        torque_slow_rad_s=taught.noise_slow_rad_s,
        stretch_density=STRETCH_DOUBT * t.noise_density_m2_s if t else 1.0,
        stretch_slow_rad_s=t.noise_slow_rad_s if t else 0.0,
        process_force_n=settings.process_force_n,
    )


@dataclass(frozen=True, slots=True)
class Start:
    """Where the hypotheses begin: the commissioned axis with a preload that is not yet known."""

    mean: Floats  # (n,)
    beginnings: tuple[tuple[float, Floats], ...]  # probability and covariance (n, n) of each
    changed: Floats  # (n, n), covariance of an axis whose friction is another


def start_of(machine: Machine, model: FusedModel, settings: FusedSettings) -> Start:
    """State and covariances before the first phase, of a preload to be filled in."""
    taught = machine.commissioned
    assert taught is not None
    t = taught.transmission
    ratio, viscous = model.ratio_m_per_rad, machine.model.viscous_nm_s_per_rad
    fresh_nm = model.drag_per_percent_nm * model.fresh_percent
    guide_n = max(t.reversal_force_n - WIND_UP_SHARE * fresh_nm / ratio, 0.0) if t else 0.0
    dry_nm = taught.coulomb_nm - fresh_nm - ratio * guide_n
    mean = np.zeros(STATES)
    mean[DRY], mean[GUIDE] = dry_nm, guide_n
    mean[VISCOUS] = viscous.value
    mean[ASYMMETRY] = taught.viscous_asymmetry_nm_s_per_rad
    mean[OFFSET] = taught.torque_offset_nm
    mean[SKEW] = t.clock_skew_s if t else 0.0
    mean[SLIDE] = t.guide_viscous_n_s_per_m if t else 0.0
    mean[NUT] = t.nut_share * model.compliance_m_per_n if t else 0.0
    mean = np.concatenate([mean, np.zeros(len(growth_nodes(machine)) + len(rub_nodes(machine)))])
    changed = _spread(machine, model, mean, settings, CHANGED_SHARE)
    return Start(mean, tuple(_beginnings(machine, model, mean, settings)), changed)


def _beginnings(
    machine: Machine, model: FusedModel, mean: Floats, settings: FusedSettings
) -> Iterator[tuple[float, Floats]]:
    """What may have happened since commissioning; see FusedSettings."""
    as_taught = _spread(machine, model, mean, settings, UNCHANGED_SHARE)
    nodes_m, drifts = growth_nodes(machine), settings.friction_walk > 0.0
    two = drifts and len(nodes_m) > 0
    rare, warm = settings.rare * two, settings.warm * two
    if settings.unchanged > 0.0:
        yield settings.unchanged, as_taught
    changed = _spread(machine, model, mean, settings, CHANGED_SHARE)
    yield 1.0 - settings.unchanged - warm - 3.0 * rare, changed
    if two:
        hot = _spread(machine, model, mean, settings, WARM_SHARE)
        grown = slice(STATES, STATES + len(nodes_m))
        hot[grown, grown] += WARM_GROWTH_M**2 * _alike(nodes_m, WARM_REACH_M, own=1e-4)
        yield warm, hot
        yield rare, hot + _diagonal(mean, {PLAY: PLAY_M, TURN_COS: TURN_M, TURN_SIN: TURN_M})
        yield rare, as_taught + _diagonal(mean, {GAIN: GAIN_JUMP})
        loaded = as_taught + _diagonal(mean, {MASS: 0.4 * model.table_mass_kg})
        loaded[GAIN, GAIN] = LOADED_GAIN**2
        yield rare, loaded


def _diagonal(mean: Floats, sigma: dict[int, float]) -> Floats:
    """Covariance (n, n) of independent elements of the state."""
    variance = np.zeros(len(mean))
    for index, value in sigma.items():
        variance[index] = value**2
    return np.diag(variance)


def _spread(
    machine: Machine, model: FusedModel, mean: Floats, settings: FusedSettings, share: float
) -> Floats:
    """Covariance (n, n) at the start; `share` of each friction is its standard deviation."""
    taught, viscous = machine.commissioned, machine.model.viscous_nm_s_per_rad
    assert taught is not None
    t = taught.transmission
    drifts = settings.friction_walk > 0.0
    share = share if drifts else 1e-3 * share
    sigma = np.zeros(len(mean))
    sigma[DRY], sigma[OFFSET] = share * taught.coulomb_nm, share * taught.coulomb_nm * drifts
    sigma[GUIDE] = share * mean[GUIDE]
    sigma[VISCOUS] = max(viscous.sigma, share * viscous.value)
    sigma[GAP], sigma[GROWTH], sigma[SKEW] = 1e-4, 1e-4, 2e-6
    if drifts:
        sigma[ASYMMETRY], sigma[GAIN] = 0.05 * viscous.value, settings.gain_error
    if t is not None:
        sigma[GAP_RATE], sigma[GROWTH_RATE] = 2e-8, 5e-8
        sigma[LUBE] = LUBE_SHARE * share * drifts
        sigma[PLAY], sigma[SLIDE] = 3e-8, max(0.1 * drifts * mean[SLIDE], 1.0)
        sigma[NUT] = t.nut_share_sigma * model.compliance_m_per_n
        sigma[STATES:] = settings.uneven_start_m
        sigma[-RUB_NODES:] = settings.rub_share * mean[GUIDE]
    return np.diag(sigma**2)


def growth_nodes(machine: Machine) -> Floats:
    """Places along the stroke where uneven growth is followed, m; none with one encoder."""
    stroke_m, taught = machine.axis.stroke_m, machine.commissioned
    if stroke_m is None or taught is None or taught.transmission is None:
        return np.zeros(0)
    return np.linspace(0.0, stroke_m, max(round(stroke_m / GROWTH_NODE_M), 1) + 1)


def rub_nodes(machine: Machine) -> Floats:
    """Places along the stroke where the friction of the guides is followed, m; as above."""
    nodes_m = growth_nodes(machine)
    return np.linspace(0.0, nodes_m[-1], RUB_NODES) if len(nodes_m) else nodes_m


def _alike(nodes_m: Floats, reach_m: float, own: float = 0.1) -> Floats:
    """Correlation of what happens at nodes, (k, k); a share is every node's own."""
    apart = (nodes_m[:, None] - nodes_m[None, :]) / reach_m
    return np.asarray((1.0 - own) * np.exp(-0.5 * apart**2) + own * np.eye(len(nodes_m)))


def drift_of(machine: Machine, model: FusedModel, settings: FusedSettings) -> Drift:
    """What may happen to the axis between two phases."""
    taught = machine.commissioned
    assert taught is not None
    share, t = settings.friction_walk, taught.transmission
    guide_n = t.reversal_force_n if t else 0.0
    walk = np.zeros(STATES)
    walk[PRELOAD] = settings.preload_walk
    walk[DRY] = share * taught.coulomb_nm
    walk[GUIDE] = share * guide_n
    walk[VISCOUS] = share * machine.model.viscous_nm_s_per_rad.value
    walk[SLIDE] = share * (t.guide_viscous_n_s_per_m if t else 0.0)
    walk[ASYMMETRY] = 0.1 * walk[VISCOUS]
    walk[GAP], walk[GROWTH] = settings.growth_m, 2.0 * settings.growth_m
    walk[OFFSET] = 0.1 * walk[DRY]
    if t is not None:
        walk[LUBE] = share * LUBE_WALK
        walk[GAP_RATE], walk[GROWTH_RATE] = settings.growth_rate_m_s, 2.5 * settings.growth_rate_m_s
    walk[GAIN] = settings.gain_walk if share else 0.0
    moving = np.zeros(STATES, dtype=np.bool_)
    moving[PRELOAD] = True
    jumps = _jumps(machine, model, settings)
    growth_m, rub_m = growth_nodes(machine), rub_nodes(machine)
    uneven = np.zeros((len(growth_m) + len(rub_m),) * 2)
    alike = settings.uneven_growth_m**2 * _alike(growth_m, GROWTH_REACH_M)
    uneven[: len(growth_m), : len(growth_m)] = alike
    alike = (0.2 * share * guide_n) ** 2 * _alike(rub_m, RUB_REACH_M)
    uneven[len(growth_m) :, len(growth_m) :] = alike
    size = STATES + len(uneven)
    every = np.zeros((len(jumps) + bool(len(rub_m)), size, size))
    every[: len(jumps), :STATES, :STATES] = np.array([jump.covariance for jump in jumps])
    shifts = np.zeros((len(every), size))
    shifts[: len(jumps), :STATES] = np.array([jump.shift for jump in jumps])
    hazards, modes = [jump.hazard for jump in jumps], [jump.mode for jump in jumps]
    if len(rub_m):
        rubbing_n = RUB_SHARE * taught.coulomb_nm / model.ratio_m_per_rad
        first = STATES + len(growth_m)
        every[-1, first:, first:] = rubbing_n**2 * _alike(rub_m, RUB_REACH_M)
        hazards.append(settings.misalignment_hazard)
        modes.append(QUIET)
    return Drift(
        walk=walk,
        uneven=uneven,
        moving=moving,
        rate_walk=RATE_WALK,
        jumps=every,
        shifts=shifts,
        hazards=np.array(hazards),
        modes=np.array(modes, dtype=np.int64),
        force_hazard=settings.force_hazard,
        force_stay=settings.force_stay,
    )


@dataclass(frozen=True, slots=True)
class _Jump:
    """A kind of jump: covariance and mean that it adds, hazard per second, mode afterwards."""

    covariance: Floats
    hazard: float
    mode: int
    shift: Floats = field(default_factory=lambda: np.zeros(STATES))


def _jumps(machine: Machine, model: FusedModel, settings: FusedSettings) -> list[_Jump]:
    """Every kind of jump, in the order of `KINDS` (as far as this axis can show it).

    Preload is lost and never gained. How much of the screw's drag acts behind its spring is hardly
    known, so a loss may take a little from the reversal force as well.
    """
    taught = machine.commissioned
    assert taught is not None
    two, lubricated = taught.transmission is not None, settings.friction_walk > 0.0
    coulomb, fresh = taught.coulomb_nm, model.fresh_percent
    guide_n = taught.transmission.reversal_force_n if taught.transmission else 0.0
    jumps = []
    for typical, spread in LOSSES:
        lost, sigma = typical * fresh, spread * fresh
        covariance = _along({PRELOAD: sigma})
        if two:
            slack = 0.5 * WIND_UP_SHARE * (lost + sigma) * model.drag_per_percent_nm
            covariance = covariance + _along({GUIDE: slack / model.ratio_m_per_rad, DRY: -slack})
        hazard = settings.loss_hazard / len(LOSSES)
        jumps.append(_Jump(covariance, hazard, QUIET, _direction({PRELOAD: -lost})))
    slope = _direction({RATE: -WEAR_PERCENT_S})
    jumps.append(_Jump(_along({RATE: WEAR_PERCENT_S}), settings.wear_hazard, WEARING, slope))
    if lubricated:
        slick = _along({VISCOUS: 0.2 * machine.model.viscous_nm_s_per_rad.value})
        slick = slick + _along({DRY: 0.06 * coulomb})
        if two:
            slick = slick + _along({DRY: 0.15 * coulomb, GUIDE: 0.3 * guide_n})
            slick = slick + _along({GUIDE: 0.1 * guide_n}) + _along({LUBE: LUBE_JUMP})
        else:
            slick = slick + _along({DRY: 0.25 * coulomb})
            slick = slick + _along({MASS: 0.4 * model.table_mass_kg})
        jumps.append(_Jump(slick, settings.friction_hazard, SETTLING))
        jumps.append(_Jump(_along({GAIN: GAIN_JUMP}), settings.gain_hazard, QUIET))
    if two:
        payload = _along({MASS: 0.4 * model.table_mass_kg, GUIDE: 0.1 * guide_n})
        payload = payload + _along({GUIDE: 0.1 * guide_n}) + _along({DRY: 0.03 * coulomb})
        jumps.append(_Jump(payload, settings.payload_hazard, QUIET))
        jumps.append(_Jump(_along({PLAY: PLAY_M}), settings.backlash_hazard, QUIET))
    return jumps


def _direction(entries: dict[int, float]) -> Floats:
    """A vector of the state."""
    vector = np.zeros(STATES)
    for index, value in entries.items():
        vector[index] = value
    return vector


def _along(direction: dict[int, float]) -> Floats:
    """Covariance of a jump of that standard deviation along one direction of the state."""
    vector = _direction(direction)
    return np.outer(vector, vector)
