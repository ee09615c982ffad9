"""A commissioned axis in round numbers, and what it measures: from the equations, in plain numpy.

Nothing here is shared with the estimator but the names of its numbers.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from scipy.optimize import brentq

from edge_service.estimate.mixture.model import Start, axis_model, process_of, start_of
from edge_service.estimate.mixture.state import ASSUMED, AxisModel, Process, Reading
from edge_service.messages.samples import Floats
from edge_service.models.commissioned import CommissionedConfig, TransmissionConfig
from edge_service.models.machine import AxisConfig, Machine, ModelConfig, Quantity

SETTINGS = ASSUMED
FRESH, FRESH_N, RATING_N, LEAD_M = 7.0, 700.0, 10_000.0, 0.02
RATIO = LEAD_M / (2.0 * math.pi)
PER_PERCENT_NM = 0.03
BEARING_NM, GUIDE_N, HANGING_NM = 0.05, 60.0, 0.01
COULOMB_NM = FRESH * PER_PERCENT_NM + BEARING_NM + RATIO * GUIDE_N
TABLE_KG, COMPLIANCE, NUT_SHARE = 20.0, 3e-8, 0.3
STROKE_M, REFERENCE_M, SCREW_KGM2 = 0.8, 0.4, 8050.0 * math.pi * 0.02**4 / 32.0
TORQUE_NOISE_NM, STRETCH_NOISE_M = math.sqrt(5e-7 / 0.1), math.sqrt(3e-18 / 0.1)
"""Of a mean over 0.1 s, as commissioning found it."""


@cache
def machine(one_encoder: bool = False, edge_rad2_s2: float = 0.0) -> Machine:
    transmission = TransmissionConfig(
        reference_m=REFERENCE_M,
        stretch_per_acceleration_s2=TABLE_KG * COMPLIANCE,
        stretch_slope_s2_per_m=TABLE_KG * 1.5e-8,
        nut_share=NUT_SHARE,
        nut_share_sigma=0.1 * NUT_SHARE,
        reversal_force_n=GUIDE_N,
        guide_viscous_n_s_per_m=20.0,
        clock_skew_s=1e-6,
        lead_map_m=(0.0, 2e-6, 1e-6),
        wind_up_map_m=(0.0, 3e-8),
        map_sigma_m=(2e-7, 0.0, 1e-7),
        noise_density_m2_s=3e-18,
    )
    axis = AxisConfig(lead_m=LEAD_M, stroke_m=STROKE_M, dynamic_load_rating_n=RATING_N)
    return Machine(
        axis=axis.model_copy(update={"screw_diameter_m": 0.02, "screw_length_m": 1.0}),
        model=ModelConfig(
            inertia_kg_m2=Quantity(value=1.5e-3),
            viscous_nm_s_per_rad=Quantity(value=5e-3),
            preload_drag_nm=Quantity(value=FRESH * PER_PERCENT_NM, tolerance=0.01),
            preload_n=Quantity(value=FRESH_N),
            table_mass_kg=Quantity(value=TABLE_KG, tolerance=0.02),
        ),
        commissioned=CommissionedConfig(
            torque_offset_nm=HANGING_NM,
            viscous_asymmetry_nm_s_per_rad=1e-4,
            stribeck_excess_nm=0.05,
            stribeck_speed_rad_s=2.0,
            stroke_map=((0.05, 0.02),),
            coulomb_nm=COULOMB_NM,
            noise_density_nm2_s=5e-7,
            noise_slow_rad_s=5.0,
            edge_noise_rad2_s2=edge_rad2_s2,
            motion_s=100.0,
            transmission=None if one_encoder else transmission,
        ),
    )


@cache
def parts(one_encoder: bool = False) -> tuple[AxisModel, Start, Process]:
    model = axis_model(machine(one_encoder))
    start = start_of(machine(one_encoder), model, SETTINGS)
    return model, start, process_of(machine(one_encoder), model, start, SETTINGS)


@dataclass
class Truth:
    """Truth about the axis; frictions as changes of the commissioned ones."""

    percent: float = FRESH
    nut: float = 0.0
    bearing: float = 0.0
    guide: float = 0.0
    viscous: float = 0.0
    guide_viscous: float = 0.0
    payload_kg: float = 0.0
    offset_nm: float = HANGING_NM
    loose_m_per_n: float = 0.0
    coupling_m_per_n: float = 0.0
    encoder_m: float = 0.0
    encoder_slope: float = 0.0
    skew_s: float = 1e-6
    nut_compliance: float = NUT_SHARE * COMPLIANCE
    reversal: float = 0.0
    mass_error: float = 0.0
    wind_up: float = 0.0  # that the model does not know; commissioning has seen the fresh screw's
    map_m: Floats = field(default_factory=lambda: np.zeros(4))

    def torque(self, r: Reading) -> float:
        """Torque of a phase, N m."""
        turn = 2.0 * math.pi * r.table_m / STROKE_M
        local = 1.0 if math.isnan(turn) else 1.0 + 0.05 * math.cos(turn) + 0.02 * math.sin(turn)
        dry = PER_PERCENT_NM * (self.percent * (1.0 + self.nut) + FRESH * (local - 1.0))
        dry += BEARING_NM * (1.0 + self.bearing) + RATIO * GUIDE_N * (1.0 + self.guide)
        dry += 0.05 * math.exp(-abs(r.speed_rad_s) / 2.0)
        inertia = 1.5e-3 + RATIO**2 * self.payload_kg
        viscous = 5e-3 * (1.0 + self.viscous) * r.speed_rad_s + 1e-4 * abs(r.speed_rad_s)
        return inertia * r.acceleration_rad_s2 + r.direction * dry + viscous + self.offset_nm

    def stretch(self, r: Reading) -> float:
        """Way of the motor less that of the table, m."""
        turn, away = 2.0 * math.pi * r.table_m / STROKE_M, r.table_m - REFERENCE_M
        percent = self.percent * (1.0 + 0.05 * math.cos(turn) + 0.02 * math.sin(turn))
        series = COMPLIANCE + 1.5e-8 * away
        load = TABLE_KG + self.payload_kg * (1.0 - self.mass_error)
        load *= RATIO * r.acceleration_rad_s2
        load += r.direction * GUIDE_N * (1.0 + self.guide)
        load += 20.0 * (1.0 + self.guide_viscous) * RATIO * r.speed_rad_s
        held = load + HANGING_NM / RATIO
        nut_nm = PER_PERCENT_NM * self.percent * (1.0 + self.nut)
        twisting = r.direction * (nut_nm + BEARING_NM * (1.0 + self.bearing))
        twisting += 5e-3 * (1.0 + self.viscous) * r.speed_rad_s + SCREW_KGM2 * r.acceleration_rad_s2
        spring = (series - self.nut_compliance) * load + self.loose_m_per_n * held
        spring += self.coupling_m_per_n * (held + twisting / RATIO)
        seat = deflection(held, percent) - deflection(HANGING_NM / RATIO, FRESH)
        spring += 3.0 * FRESH_N * self.nut_compliance * seat
        drag_n = (nut_nm - PER_PERCENT_NM * FRESH) / RATIO
        wound = r.direction * series * (self.wind_up * drag_n + self.reversal * GUIDE_N)
        lead = np.interp(r.table_m, (0.0, 0.5 * STROKE_M, STROKE_M), (0.0, 2e-6, 1e-6))
        odd = r.direction * np.interp(r.table_m, (0.0, STROKE_M), (0.0, 3e-8))
        growth = self.encoder_m + self.encoder_slope * away + lead + odd
        growth += sum(
            c * math.cos(j * math.pi * r.table_m / STROKE_M)
            for j, c in enumerate(self.map_m, start=2)
        )
        return float(spring + wound + growth + self.skew_s * RATIO * r.speed_rad_s)


CLEARANCE = 0.75e-6 / (3.0 * FRESH_N * NUT_SHARE * COMPLIANCE)
"""Half of 1.5 um, over the deflection of the fresh pair under its preload."""


def deflection(load_n: float, percent: float) -> float:
    """Root y of F / F0 = (q + y)^1.5 - (q - y)^1.5, each contact only while it is pressed."""
    q = (percent / FRESH) ** (2.0 / 3.0) - CLEARANCE * math.exp(-percent / 0.15)
    force = abs(load_n) / FRESH_N

    def missing(y: float) -> float:
        return float(max(q + y, 0.0) ** 1.5 - max(q - y, 0.0) ** 1.5 - force)

    far = abs(q) + (force + 1.0)
    y = brentq(missing, max(-q, 0.0), far, xtol=1e-15, rtol=1e-14) if force > 0.0 else 0.0
    return math.copysign(y, load_n)


def idle(
    rng: np.random.Generator, one_encoder: bool = False, direction: float | None = None
) -> Reading:
    """A phase of ordinary production, without its measurements."""
    s = float(rng.choice([-1.0, 1.0])) if direction is None else direction
    pull = float(rng.choice([-1.0, 0.0, 1.0]))
    return Reading(
        steady_s=0.1,
        direction=s,
        torque_nm=math.nan,
        acceleration_rad_s2=s * pull * float(rng.uniform(300.0, 1000.0)),
        speed_rad_s=s * float(rng.uniform(10.0, 120.0)),
        table_m=math.nan if one_encoder else float(rng.uniform(0.05, 0.75)),
        stretch_m=math.nan,
    )


def measured(rng: np.random.Generator, truth: Truth, r: Reading, force_n: float = 0.0) -> Reading:
    """A phase with torque and stretch, their noise, and a force on the table (stretch by C F)."""
    torque = truth.torque(r) + RATIO * force_n + TORQUE_NOISE_NM * rng.standard_normal()
    if math.isnan(r.table_m):
        return r._replace(torque_nm=torque)
    stretch = truth.stretch(r) + COMPLIANCE * force_n + STRETCH_NOISE_M * rng.standard_normal()
    return r._replace(torque_nm=torque, stretch_m=stretch)


def production(
    seed: int, seconds: float, truth: Truth, one_encoder: bool = False
) -> Iterator[Reading]:
    """Phases of 0.1 s, a second in one direction and a second back."""
    rng = np.random.default_rng(seed)
    for k in range(round(10.0 * seconds)):
        yield measured(rng, truth, idle(rng, one_encoder, 1.0 if k % 20 < 10 else -1.0))
