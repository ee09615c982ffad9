"""Axes with one encoder, drawn; tested by shaking, healthy and worn."""

from dataclasses import replace

import numpy as np

from edge_service.estimate.commissioning.shares import learned_notch
from edge_service.fingerprint.response.notch import notch_of
from edge_service.models.commissioned import CommissionedConfig, Notch
from edge_service.models.machine import AxisConfig, Machine, ModelConfig, Quantity

from ..fingerprint.shaken_axis import FEED_M_S, START_M, SWEEP_S, Axis, shaken

DRIFT = 0.01
"""Standard deviation of the rest's compliance from day to day."""
FRESH_PERCENT = 7.0


def drawn(random: np.random.Generator) -> tuple[Axis, float]:
    """An axis, and the rate of its recordings, Hz."""
    rate_hz = float(random.choice((500.0, 1000.0, 2000.0)))
    lead_m, inertia = float(random.choice((0.005, 0.01, 0.02))), 1.5e-3
    table_kg = inertia * random.uniform(0.1, 0.9) / (lead_m / 2.0 / np.pi) ** 2
    preload_n = float(random.uniform(1000.0, 3000.0))
    return Axis(
        inertia_kg_m2=inertia,
        table_kg=table_kg,
        lead_m=lead_m,
        antiresonance_hz=float(random.uniform(40.0, min(200.0, 0.3 * rate_hz))),
        share=float(random.uniform(0.1, 0.5)),
        contact=float(random.choice((1.2, 1.3, 1.4, 1.5, 1.5, 1.5))),
        preload_n=preload_n,
        hanging_n=float(random.choice((0.0, 0.0, random.uniform(0.0, 1.0) * preload_n))),
        nut_nm=float(random.uniform(0.1, 0.3)),
        guide_n=0.1 * float(random.uniform(0.2, 1.0)) / (lead_m / 2.0 / np.pi),
        guide_m=float(random.uniform(4e-6, 15e-6)),
        damping=float(random.uniform(0.01, 0.05)),
        delay_s=float(random.uniform(0.0, 2e-3)),
        feedforward=bool(random.uniform() < 0.8),
    ), rate_hz


def on_a_day(axis: Axis, random: np.random.Generator) -> Axis:
    """The axis with another rest, and other grease."""
    return replace(
        axis,
        softer=axis.softer * (1.0 + DRIFT * random.standard_normal()),
        friction=axis.friction * (1.0 + 0.1 * random.standard_normal()),
    )


def notch_of_day(axis: Axis, seed: int, rate_hz: float) -> Notch | None:
    return notch_of(shaken(axis, seed, rate_hz))


def as_it_is(axis: Axis) -> Notch:
    """Notch of a test without noise."""
    table_kg = axis.table_kg + axis.payload_kg
    notch_hz = float(np.sqrt(axis.stiffness() / table_kg) / 2.0 / np.pi)
    ratio = table_kg * axis.radius_m**2 / axis.inertia_kg_m2
    guide_nm = axis.guide_n * axis.radius_m
    return Notch(
        antiresonance_hz=notch_hz,
        antiresonance_sigma_hz=0.005 * notch_hz,
        damping_ratio=axis.damping,
        inertia_ratio=ratio,
        inertia_ratio_sigma=0.05 * ratio,
        place_rad=(START_M + 0.5 * FEED_M_S * SWEEP_S) / axis.radius_m,
        feed_rad_s=FEED_M_S / axis.radius_m,
        friction_nm=axis.friction * (axis.nut_nm * axis.preload + guide_nm),
    )


def machine_of(axis: Axis, tests: list[Notch], stated: float = 1.0) -> Machine:
    """Commissioned machine file; `stated` is the nut's stiffness over the true one."""
    nut = axis.fresh_n_per_m / axis.share * stated
    coulomb_nm = axis.nut_nm + axis.guide_n * axis.radius_m
    machine = Machine(
        axis=AxisConfig(
            lead_m=axis.lead_m,
            stroke_m=0.8,
            dynamic_load_rating_n=100.0 * axis.preload_n / FRESH_PERCENT,
        ),
        model=ModelConfig(
            inertia_kg_m2=Quantity(value=axis.inertia_kg_m2 + axis.table_kg * axis.radius_m**2),
            preload_drag_nm=Quantity(value=axis.nut_nm, tolerance=0.1),
            preload_n=Quantity(value=axis.preload_n, tolerance=0.05),
            table_mass_kg=Quantity(value=axis.table_kg, tolerance=0.02),
            nut_stiffness_n_per_m=Quantity(value=nut, tolerance=0.15),
        ),
    )
    learned = CommissionedConfig(
        torque_offset_nm=axis.hanging_n * axis.radius_m,
        coulomb_nm=coulomb_nm,
        noise_density_nm2_s=1e-6,
        motion_s=60.0,
    )
    learned = learned.model_copy(update={"notch": learned_notch(tests, machine, machine)})
    return machine.model_copy(update={"commissioned": learned})
