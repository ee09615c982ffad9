"""What a healthy, cold axis teaches: friction, inertia, stretch and their noise, by regression.

Both regressions run on phases of steady motion (messages.features.Phase), with the exact balance of
momentum (4.3.4) and the series stiffness under inertia force (5.3.1) as models; they are weighted
robustly (Huber) and leave what the recording does not determine to stated priors.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import partial

import numpy as np
import numpy.typing as npt

from ..messages.features import FeatureBlock, Phase
from ..messages.samples import Floats
from ..models.commissioned import CommissionedConfig, TransmissionConfig
from ..models.machine import Machine, Quantity
from ..models.stiffness import STEEL_MODULUS_PA, screw_area, screw_torsional_rigidity
from .known_effects import KnownEffects

HUBER = 2.0
SLOW_RAD_S = (0.0, 1.0, 2.0, 4.0, 7.0, 12.0, 20.0, 35.0, 60.0)
STRIBECK_SPEEDS_RAD_S = (0.5, 1.0, 2.0, 3.0, 5.0, 8.0)
STROKE_HARMONICS = 3
LEAD_NODE_M = 0.02
LEAD_SIGMA_M = 5e-6
WIND_UP_SIGMA_M = 2e-7
CORE_SHARE = 0.85
"""Assumption: core of a screw over its nominal diameter."""
NUT_SHARE, NUT_SHARE_SIGMA = 0.35, 0.15
"""Of the series compliance where the machine file does not tell: an assumption with its spread."""


class CommissioningError(ValueError):
    """The recording cannot determine what the estimator needs; the text names the motion."""


@dataclass(frozen=True, slots=True)
class SteadyPhases:
    """Phases of several recordings as columns, (n,) each; `run` numbers the recording."""

    run: Floats
    time_s: Floats
    steady_s: Floats
    direction: Floats
    torque_nm: Floats
    acceleration_rad_s2: Floats
    speed_rad_s: Floats
    angle_rad: Floats
    table_m: Floats

    @classmethod
    def of(
        cls, recordings: Sequence[Sequence[FeatureBlock]], known: KnownEffects | None = None
    ) -> "SteadyPhases":
        """All steady phases of usable blocks, without the effects that are known."""

        def freed(phase: Phase, block: FeatureBlock) -> Phase:
            if known is None:
                return phase
            return known.freed(phase, block.steady_direction, block.time_s)

        rows = [
            (
                run,
                block.time_s,
                phase.steady_s,
                block.steady_direction,
                *_numbers(freed(phase, block)),
            )
            for run, blocks in enumerate(recordings)
            for block in blocks
            if block.usable
            for phase in block.phases
        ]
        table = np.array(rows, dtype=np.float64).reshape(-1, 9)
        return cls(*table.T)

    def where(self, chosen: npt.NDArray[np.bool_]) -> "SteadyPhases":
        """Those rows, chosen (n,) bool."""
        return SteadyPhases(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def __len__(self) -> int:
        return len(self.time_s)


def _numbers(phase: Phase) -> tuple[float, ...]:
    return (
        phase.torque_nm,
        phase.acceleration_rad_s2,
        phase.speed_rad_s,
        phase.angle_rad,
        phase.table_m,
    )


@dataclass(frozen=True, slots=True)
class Noise:
    """What a mean over a phase errs by: variance density (1 + (slow / |v|)^2) / steady time.

    Friction that changes along the way (cogging, Stribeck) averages out the worse the slower the
    axis moves.
    """

    density: float
    slow_rad_s: float

    def variance(self, steady_s: Floats, speed_rad_s: Floats) -> Floats:
        """Of means over `steady_s` at `speed_rad_s`, (n,)."""
        return self.density * slowness(self.slow_rad_s, speed_rad_s) / steady_s


def slowness(slow_rad_s: float, speed_rad_s: Floats) -> Floats:
    """1 + (slow / |v|)^2, (n,)."""
    return np.asarray(1.0 + (slow_rad_s / np.maximum(np.abs(speed_rad_s), 1e-3)) ** 2)


@dataclass(frozen=True, slots=True)
class RobustFit:
    """Weighted least squares with priors.

    Attributes:
        value, sigma: of the parameters, (p,).
        residual: of the rows, (n,).
        noise: learned from the residual.
    """

    value: Floats
    sigma: Floats
    residual: Floats
    noise: Noise


def robust_fit(
    columns: Floats, wanted: Floats, phases: SteadyPhases, prior_sigma: Floats
) -> RobustFit:
    """Regression of means over phases, with zero-mean priors on the parameters.

    Args:
        columns: (n, p).
        wanted: (n,).
        phases: what the rows are.
        prior_sigma: (p,), inf for none.
    """
    steady_s, speed = phases.steady_s, phases.speed_rad_s
    noise, trust = Noise(1.0, 0.0), np.ones_like(wanted)
    for _ in range(12):
        root = np.sqrt(trust / noise.variance(steady_s, speed))
        scaled = columns * root[:, None]
        covariance = np.linalg.pinv(scaled.T @ scaled + np.diag(prior_sigma**-2.0), hermitian=True)
        value = covariance @ (scaled.T @ (root * wanted))
        residual = wanted - columns @ value
        noise = _noise_of(residual, phases)
        z = np.abs(residual) / np.sqrt(noise.variance(steady_s, speed))
        trust = np.minimum(1.0, HUBER / np.maximum(z, 1e-12))
    return RobustFit(value, np.sqrt(np.diag(covariance)), residual, noise)


def _noise_of(residual: Floats, phases: SteadyPhases) -> Noise:
    """Most likely noise: how much worse it is at slow motion, then its level."""
    energy = residual**2 * phases.steady_s
    energy = np.minimum(energy, 25.0 * max(float(np.median(energy)) / 0.455, 1e-40))
    best: tuple[float, Noise] | None = None
    for slow in SLOW_RAD_S:
        shape = slowness(slow, phases.speed_rad_s)
        white = max(float(np.mean(energy / shape)), 1e-40)
        cost = float(np.sum(np.log(white * shape)))
        if best is None or cost < best[0]:
            best = cost, Noise(white, slow)
    assert best is not None
    noise = best[1]
    return Noise(max(noise.density, _lasting(residual, phases, noise.slow_rad_s)), noise.slow_rad_s)


def _lasting(residual: Floats, phases: SteadyPhases, slow_rad_s: float) -> float:
    """Density from weighted sums over about a second: errors of friction outlast a phase."""
    weight = phases.steady_s / slowness(slow_rad_s, phases.speed_rad_s)
    z = residual * np.sqrt(weight)
    bound = 4.0 * 1.4826 * float(np.median(np.abs(z)))
    clipped = np.clip(z, -bound, bound) * np.sqrt(weight)
    _, index = np.unique(np.floor(phases.time_s) + 1e7 * phases.run, return_inverse=True)
    sums, lengths = np.bincount(index, clipped), np.bincount(index, weight)
    return float(np.sum(sums**2) / np.sum(lengths))


@dataclass(frozen=True, slots=True)
class TorqueTaught:
    """Parameters of the torque balance; see fused_physics for the equation."""

    inertia_kg_m2: float
    inertia_sigma: float
    viscous_nm_s_per_rad: float
    viscous_sigma: float
    asymmetry_nm_s_per_rad: float
    coulomb_nm: float
    coulomb_sigma: float
    offset_nm: float
    stribeck_nm: float
    stribeck_speed_rad_s: float
    harmonics_nm: Floats  # (k, 2)
    noise: Noise
    motion_s: float


def teach_torque(phases: SteadyPhases, machine: Machine) -> TorqueTaught:
    """Fit the torque balance.

    Raises:
        CommissioningError: motion is missing.
    """
    _require_motion(phases)
    stroke = machine.axis.stroke_m
    mapped = stroke is not None and not np.isnan(phases.table_m).any()
    spread = float(np.ptp(phases.table_m)) if mapped else 0.0
    harmonics = STROKE_HARMONICS if stroke and spread > 0.6 * stroke else 0
    level = float(np.median(np.abs(phases.torque_nm)))
    best: tuple[float, float, RobustFit] | None = None
    for speed in STRIBECK_SPEEDS_RAD_S:
        columns, sigma = _torque_columns(phases, speed, harmonics, stroke or 1.0, level)
        fit = robust_fit(columns, phases.torque_nm, phases, sigma)
        variance = fit.noise.variance(phases.steady_s, phases.speed_rad_s)
        cost = float(np.sum(np.log(variance) + np.minimum(fit.residual**2 / variance, 9.0)))
        if best is None or cost < best[0]:
            best = (cost, speed, fit)
    assert best is not None
    _, speed, fit = best
    v, s = fit.value, fit.sigma
    if v[0] <= 0.0 or v[3] <= 0.0:
        raise CommissioningError(
            "torque and motion contradict each other "
            f"(inertia {v[0]:.3g} kg m2, friction {v[3]:.3g} N m): check signs and units"
        )
    significant = v[5] > 2.0 * s[5]
    return TorqueTaught(
        inertia_kg_m2=float(v[0]),
        inertia_sigma=float(s[0]),
        viscous_nm_s_per_rad=max(float(v[1]), 0.0),
        viscous_sigma=float(s[1]),
        asymmetry_nm_s_per_rad=float(v[2]),
        coulomb_nm=float(v[3]),
        coulomb_sigma=float(s[3]),
        offset_nm=float(v[4]),
        stribeck_nm=float(v[5]) if significant else 0.0,
        stribeck_speed_rad_s=speed,
        harmonics_nm=v[6:].reshape(-1, 2),
        noise=fit.noise,
        motion_s=float(phases.steady_s.sum()),
    )


def _require_motion(phases: SteadyPhases) -> None:
    motion_s = float(phases.steady_s.sum()) if len(phases) else 0.0
    if motion_s < 3.0:
        raise CommissioningError(
            f"only {motion_s:.1f} s of steady motion: needs moves in both directions, "
            "such as `edge-service motion production`"
        )
    for name, sign in (("positive", 1.0), ("negative", -1.0)):
        if phases.steady_s[phases.direction == sign].sum() < 1.0:
            raise CommissioningError(f"no motion in {name} direction: needs moves both ways")
    speeds = np.abs(phases.speed_rad_s)
    if np.quantile(speeds, 0.95) < 2.0 * np.quantile(speeds, 0.05):
        raise CommissioningError(
            "one speed only: friction cannot be told from viscous friction; needs moves at "
            "several speeds, such as `edge-service motion friction`"
        )
    driven = np.abs(phases.acceleration_rad_s2) > 30.0
    if phases.steady_s[driven].sum() < 0.3:
        raise CommissioningError(
            "no accelerations: inertia and stiffness cannot be told; needs "
            "`edge-service motion acceleration` or production moves"
        )


def _torque_columns(
    phases: SteadyPhases, stribeck_speed: float, harmonics: int, stroke_m: float, level: float
) -> tuple[Floats, Floats]:
    s, v = phases.direction, phases.speed_rad_s
    columns = [
        phases.acceleration_rad_s2,
        v,
        np.abs(v),
        s,
        np.ones_like(v),
        s * np.exp(-np.abs(v) / stribeck_speed),
    ]
    fastest = max(float(np.abs(v).max()), 1.0)
    sigma = [np.inf, np.inf, 0.2 * level / fastest, np.inf, np.inf, 0.5 * level]
    for k in range(1, harmonics + 1):
        phase = 2.0 * np.pi * k * phases.table_m / stroke_m
        columns += [s * np.cos(phase), s * np.sin(phase)]
        sigma += [0.1 * level, 0.1 * level]
    return np.column_stack(columns), np.array(sigma)


@dataclass(frozen=True, slots=True)
class StretchTaught:
    """Parameters of the stretch, in metres per acceleration of the table where forces matter."""

    reference_m: float
    per_acceleration_s2: float
    slope_per_m: float
    sigma_s2: float
    slope_sigma: float
    reversal_m: float
    per_speed_s: float
    skew_s: float
    lead_map_m: Floats
    wind_up_map_m: Floats
    noise: Noise


def teach_stretch(
    phases: SteadyPhases, machine: Machine, nut_softness: Callable[[Floats, float], Floats]
) -> StretchTaught | None:
    """Fit the stretch; None with one encoder, or where nothing stretches."""
    missing = np.isnan(phases.table_m + phases.angle_rad)
    if missing.mean() > 0.5:
        return None
    phases = phases.where(~missing)
    ratio = machine.transmission_ratio_m_per_rad
    x, s = phases.table_m, phases.direction
    a = ratio * phases.acceleration_rad_s2
    time_s, run = phases.time_s, phases.run
    stretch = ratio * phases.angle_rad - x
    stroke = machine.axis.stroke_m or float(x.max())
    reference = 0.5 * stroke if x.min() < 0.5 * stroke < x.max() else float(np.median(x))
    speed = ratio * phases.speed_rad_s
    drift, drift_sigma = _drift_columns(run, time_s, x - reference)
    nodes = np.linspace(0.0, stroke, max(round(stroke / LEAD_NODE_M), 1) + 1)
    level = float(np.std(stretch)) or 1e-9
    lead = _hats(x, nodes)
    beside = np.column_stack([speed, drift, lead, s[:, None] * lead])
    beside_sigma = np.concatenate(
        [
            [1e-3],
            drift_sigma * level,
            np.full(len(nodes), min(level, LEAD_SIGMA_M)),
            np.full(len(nodes), min(level, WIND_UP_SIGMA_M)),
        ]
    )
    loads = np.column_stack([a, s, speed])
    sloped = bool(np.ptp(x) > 0.2 * stroke)
    slope, fit = _series_fit(
        loads,
        x - reference,
        lambda per_acceleration: nut_softness(x, per_acceleration),
        beside,
        beside_sigma,
        stretch,
        phases,
        sloped,
    )
    if fit.value[0] < 3.0 * fit.sigma[0]:
        return None
    first = 3 + 1 + 1 + drift.shape[1]
    return StretchTaught(
        reference_m=reference,
        per_acceleration_s2=float(fit.value[0]),
        slope_per_m=slope,
        sigma_s2=float(fit.sigma[0]),
        slope_sigma=float(fit.sigma[3]),
        reversal_m=float(fit.value[1]),
        per_speed_s=float(fit.value[2]) if sloped else 0.0,
        skew_s=float(fit.value[4]) + (0.0 if sloped else float(fit.value[2])),
        lead_map_m=fit.value[first : first + len(nodes)],
        wind_up_map_m=fit.value[first + len(nodes) :],
        noise=fit.noise,
    )


def _series_fit(
    loads: Floats,
    away_m: Floats,
    nut_softness: Callable[[float], Floats],
    beside: Floats,
    beside_sigma: Floats,
    stretch: Floats,
    phases: SteadyPhases,
    sloped: bool,
) -> tuple[float, RobustFit]:
    """All forces through one compliance that changes along the screw (5.3.1, 5.3.9).

        stretch = (1 + slope away + nut softness) loads @ value + beside @ rest,

    by Gauss-Newton on the slope; the softness is that of the nut where its preload differs from
    the mean.

    Returns:
        slope, 1/m, and the fit on [loads, change of the slope, beside].
    """
    slope, value = 0.0, np.zeros(loads.shape[1])
    for _ in range(8):
        through = loads * (1.0 + slope * away_m + nut_softness(float(value[0])))[:, None]
        bend = (loads @ value * away_m)[:, None] if value.any() else away_m[:, None] * loads[:, :1]
        sigma = np.concatenate([np.full(loads.shape[1], np.inf), [np.inf if sloped else 1e-12]])
        if not sloped:
            sigma[2] = 1e-12
        fit = robust_fit(
            np.column_stack([through, bend, beside]),
            stretch,
            phases,
            np.concatenate([sigma, beside_sigma]),
        )
        change = float(fit.value[3])
        slope += change if value.any() else change / float(fit.value[0])
        value = fit.value[:3]
    return slope, fit


def _drift_columns(run: Floats, time_s: Floats, away_m: Floats) -> tuple[Floats, Floats]:
    """Offset and growth of the screw, each a broken line in time with a node a minute."""
    parts, sigmas = [], []
    for number in np.unique(run):
        mine = run == number
        begin, end = float(time_s[mine].min()), float(time_s[mine].max())
        nodes = np.linspace(begin, end, max(round((end - begin) / 60.0), 1) + 1)
        hats = _hats(np.where(mine, time_s, begin), nodes) * mine[:, None]
        parts += [hats, hats * away_m[:, None]]
        sigmas += [np.full(len(nodes), 1e3), np.full(len(nodes), 1e3)]
    return np.column_stack(parts), np.concatenate(sigmas)


def _hats(place: Floats, nodes: Floats) -> Floats:
    """Weights of linear interpolation between nodes, (n, k)."""
    identity = np.eye(len(nodes))
    return np.column_stack([np.interp(place, nodes, row) for row in identity])


def table_mass(
    machine: Machine, torque: TorqueTaught, stretch: StretchTaught | None
) -> tuple[float, float]:
    """Mass of the table and its standard deviation, kg.

    Stated in the machine file, or from how the stretch grows along the screw, whose compliance per
    metre (5.3.9 and its twist) is known to about 30 % (fixed-free only), or a guess within the
    whole inertia.
    """
    stated = machine.model.table_mass_kg
    if stated is not None:
        return stated.value, stated.sigma
    whole_kg = torque.inertia_kg_m2 / machine.transmission_ratio_m_per_rad**2
    guess, guess_sigma = 0.3 * whole_kg, 0.15 * whole_kg
    diameter = machine.axis.screw_diameter_m
    if stretch is None or diameter is None or machine.axis.bearing_arrangement != "fixed-free":
        return guess, guess_sigma
    core = CORE_SHARE * diameter
    ratio = machine.transmission_ratio_m_per_rad
    per_metre = 1.0 / (STEEL_MODULUS_PA * screw_area(core))
    per_metre += ratio**2 / screw_torsional_rigidity(core)
    seen = stretch.slope_per_m * stretch.per_acceleration_s2 / per_metre
    seen_sigma = seen * float(np.hypot(stretch.slope_sigma / max(stretch.slope_per_m, 1e-9), 0.3))
    if seen <= 0.0:
        return guess, guess_sigma
    weight, guess_weight = seen_sigma**-2.0, guess_sigma**-2.0
    value = (seen * weight + guess * guess_weight) / (weight + guess_weight)
    return min(max(value, 0.05 * whole_kg), 0.95 * whole_kg), (weight + guess_weight) ** -0.5


def commissioned(recordings: Sequence[Sequence[FeatureBlock]], machine: Machine) -> Machine:
    """The machine file's content with all that the recordings teach.

    Args:
        recordings: blocks of features of each recording of the healthy, cold axis, in any order.
        machine: nominal; `preload_drag_nm` is the fresh screw's own drag.

    Raises:
        CommissioningError: the recordings cannot determine it; the text names the motion.
    """
    phases = SteadyPhases.of(recordings, KnownEffects.of_machine(machine))
    torque = teach_torque(phases, machine)
    stroke_map = torque.harmonics_nm / _screw_drag_nm(machine, torque)
    stretch = teach_stretch(phases, machine, partial(_nut_softness, machine, torque, stroke_map))
    mass, mass_sigma = table_mass(machine, torque, stretch)
    transmission = _transmission(machine, stretch, mass)
    screw = machine.model.preload_drag_nm
    fresh_nm = screw.value if screw is not None and machine.model.preload_n is not None else 0.0
    if fresh_nm > 1.1 * torque.coulomb_nm:
        raise CommissioningError(
            f"the axis shows {torque.coulomb_nm:.3g} N m of Coulomb friction, less than the fresh "
            f"screw's own {fresh_nm:.3g} N m (model.preload_drag_nm): not healthy, or wrong units"
        )
    ratio = machine.transmission_ratio_m_per_rad
    other_nm = max(torque.coulomb_nm - fresh_nm, 0.0)
    guide_n = other_nm / ratio if transmission is None else transmission.reversal_force_n
    guide_n = min(guide_n, other_nm / ratio)
    model = machine.model.model_copy(
        update={
            "inertia_kg_m2": _taught(torque.inertia_kg_m2, torque.inertia_sigma),
            "viscous_nm_s_per_rad": _taught(torque.viscous_nm_s_per_rad, torque.viscous_sigma),
            "guide_force_n": _taught(guide_n, max(torque.coulomb_sigma / ratio, 0.02 * guide_n)),
            "bearing_drag_nm": _taught(other_nm - ratio * guide_n, torque.coulomb_sigma),
            "table_mass_kg": _taught(mass, mass_sigma),
        }
    )
    taught = CommissionedConfig(
        torque_offset_nm=torque.offset_nm,
        viscous_asymmetry_nm_s_per_rad=torque.asymmetry_nm_s_per_rad,
        stribeck_excess_nm=torque.stribeck_nm,
        stribeck_speed_rad_s=torque.stribeck_speed_rad_s,
        stroke_map=tuple((float(c), float(d)) for c, d in stroke_map),
        coulomb_nm=torque.coulomb_nm,
        noise_density_nm2_s=torque.noise.density,
        noise_slow_rad_s=torque.noise.slow_rad_s,
        motion_s=torque.motion_s,
        transmission=transmission,
    )
    return machine.model_copy(update={"model": model, "commissioned": taught})


def _screw_drag_nm(machine: Machine, torque: TorqueTaught) -> float:
    """The fresh screw's own drag; without it the whole friction."""
    screw = machine.model.preload_drag_nm
    stated = screw is not None and machine.model.preload_n is not None
    return screw.value if screw is not None and stated and screw.value else torque.coulomb_nm


def _nut_softness(
    machine: Machine, torque: TorqueTaught, stroke_map: Floats, table_m: Floats, stretch_s2: float
) -> Floats:
    """Compliance beyond that of the mean preload, over the whole compliance, (n,) (5.3.11)."""
    if not len(stroke_map) or stretch_s2 <= 0.0:
        return np.zeros_like(table_m)
    mass_kg, _ = table_mass(machine, torque, None)
    share, _ = nut_share(machine, stretch_s2 / mass_kg)
    factor = np.ones_like(table_m)
    for k, (cosine, sine) in enumerate(stroke_map, start=1):
        phase = 2.0 * np.pi * k * table_m / (machine.axis.stroke_m or 1.0)
        factor += cosine * np.cos(phase) + sine * np.sin(phase)
    return np.asarray(share * (np.maximum(factor, 0.1) ** (-1.0 / 3.0) - 1.0))


def nut_share(machine: Machine, compliance_m_per_n: float) -> tuple[float, float]:
    """The nut's share of the series compliance and its standard deviation."""
    nut = machine.model.nut_stiffness_n_per_m
    if nut is None:
        return NUT_SHARE, NUT_SHARE_SIGMA
    share = min(1.0 / (nut.value * compliance_m_per_n), 0.95)
    return share, share * max(nut.tolerance, 0.02)


def _taught(value: float, sigma: float) -> Quantity:
    tolerance = sigma / abs(value) if value else 0.0
    return Quantity(value=value, tolerance=min(max(tolerance, 1e-4), 10.0))


def _transmission(
    machine: Machine, stretch: StretchTaught | None, mass_kg: float
) -> TransmissionConfig | None:
    if stretch is None or machine.fresh_preload_percent is None:
        return None
    compliance = stretch.per_acceleration_s2 / mass_kg
    share, sigma = nut_share(machine, compliance)
    return TransmissionConfig(
        reference_m=stretch.reference_m,
        stretch_per_acceleration_s2=stretch.per_acceleration_s2,
        stretch_slope_s2_per_m=stretch.slope_per_m * stretch.per_acceleration_s2,
        stretch_sigma_s2=stretch.sigma_s2,
        nut_share=share,
        nut_share_sigma=sigma,
        reversal_force_n=max(stretch.reversal_m / compliance, 0.0),
        guide_viscous_n_s_per_m=stretch.per_speed_s / compliance,
        clock_skew_s=stretch.skew_s,
        lead_map_m=tuple(float(value) for value in stretch.lead_map_m),
        wind_up_map_m=tuple(float(value) for value in stretch.wind_up_map_m),
        noise_density_m2_s=stretch.noise.density,
        noise_slow_rad_s=stretch.noise.slow_rad_s,
    )
