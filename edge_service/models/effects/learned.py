"""Model of a commissioned axis: what commissioning learned, as one effect beside the baseline.

The estimator has the same in its two equations (`estimate/mixture/physics.py`); there the
stretch is R theta - x, here the transmission is x - R theta.
"""

from collections.abc import Iterator

import numpy as np

from ...messages.samples import Floats
from ..commissioned import CommissionedConfig, TransmissionConfig
from ..machine import Machine
from ..plant.from_machine import screw_drag, table_mass
from ..screw.friction import stribeck_decay
from ..screw.stroke_profile import preload_share
from .contribution import (
    Change,
    Constant,
    Contribution,
    DryFriction,
    Over,
    Place,
    Shift,
    Side,
    SmoothTorque,
    constant,
)
from .effect import ActiveEffect, Effect, Kind
from .registry import machine_effects

NAME = "commissioned"


def model_effects(machine: Machine) -> tuple[ActiveEffect, ...]:
    """All that the model has beside its rigid baseline: what was learned, and `[[effects]]`."""
    return (*learned_effects(machine), *machine_effects(machine))


def learned_effects(machine: Machine) -> tuple[ActiveEffect, ...]:
    """Friction and give that commissioning found beyond the baseline; none without it."""
    if machine.commissioned is None:
        return ()
    found = (*_friction(machine, machine.commissioned), *_give(machine, machine.commissioned))
    effect = Effect(
        name=NAME,
        description="Friction and give of the healthy axis, as commissioning found them.",
        source="thesis (4.3.4), (4.3.6), (5.3.1)",
        kind=Kind.FRICTION,
        parameters=(),
        contributions=lambda _values: found,
    )
    return (ActiveEffect(effect, {}),)


def _friction(machine: Machine, known: CommissionedConfig) -> Iterator[Contribution]:
    offset, asymmetry = known.torque_offset_nm, known.viscous_asymmetry_nm_s_per_rad
    yield SmoothTorque(Over.POSITION, constant(offset), Side.MOTOR)
    yield SmoothTorque(Over.SPEED, lambda speed: asymmetry * np.abs(speed), Side.MOTOR)

    excess_nm, falling_rad_s = known.stribeck_excess_nm, known.stribeck_speed_rad_s
    yield DryFriction(
        Over.SPEED, lambda speed: excess_nm * stribeck_decay(speed, falling_rad_s), Side.MOTOR
    )
    stroke_m = machine.axis.stroke_m
    if known.stroke_map and stroke_m:
        without_nm, per_percent_nm = screw_drag(machine)
        fresh_nm = without_nm + per_percent_nm * (machine.fresh_preload_percent or 0.0)

        def uneven_nm(position_m: Floats) -> Floats:
            return fresh_nm * (preload_share(known.stroke_map, position_m / stroke_m) - 1.0)

        yield DryFriction(Over.POSITION, uneven_nm, Side.MOTOR)


def _give(machine: Machine, known: CommissionedConfig) -> Iterator[Contribution]:
    learned = known.transmission
    if learned is None:
        return
    yield Change(Constant.POSITION_LAG, learned.clock_skew_s)
    yield from _compliance(machine, learned)
    stroke_m = machine.axis.stroke_m
    if learned.lead_map_m and stroke_m:
        from scipy.interpolate import PchipInterpolator  # 45 MB that only a diagnosis needs

        nodes_m = np.linspace(0.0, stroke_m, len(learned.lead_map_m))
        through = PchipInterpolator(nodes_m, -np.array(learned.lead_map_m))

        def travel_m(position_m: Floats) -> Floats:
            return np.asarray(through(np.clip(position_m, 0.0, stroke_m)), dtype=np.float64)

        yield Shift(Place.NUT, Over.POSITION, travel_m)


def _compliance(machine: Machine, learned: TransmissionConfig) -> Iterator[Contribution]:
    """Spring under the table's inertia and dry friction, and, by other shares, its viscous one."""
    mass_kg, viscous = table_mass(machine), machine.model.viscous_nm_s_per_rad.value
    slope = learned.stretch_slope_s2_per_m / mass_kg
    mean_bow_s2 = learned.stretch_bow_s2_per_m2 * (machine.axis.stroke_m or 0.0) ** 2 / 12.0
    level = (learned.stretch_per_acceleration_s2 + mean_bow_s2) / mass_kg
    level -= slope * learned.reference_m
    yield Change(Constant.COMPLIANCE, level)
    yield Change(Constant.COMPLIANCE_SLOPE, slope)
    if viscous > 0.0:
        guide = learned.guide_viscous_n_s_per_m * machine.transmission_ratio_m_per_rad**2
        yield Change(Constant.VISCOUS_LOAD_COMPLIANCE, guide / viscous * level)
        yield Change(Constant.VISCOUS_LOAD_COMPLIANCE_SLOPE, guide / viscous * slope)
    guide_n = machine.model.guide_force_n.value
    if learned.wind_up_map_m and guide_n > 0.0:
        even_m = float(np.mean(learned.wind_up_map_m))
        yield Change(Constant.COULOMB_LOAD_COMPLIANCE, even_m / guide_n)
