"""The model of a commissioned axis says of torque and travel what the estimator's equations say."""

import numpy as np
import pytest

from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.diagnose.session.session import rigid_baseline
from edge_service.estimate.mixture.model import axis_model, start_of
from edge_service.estimate.mixture.physics import (
    expected_stretch,
    expected_torque,
    stribeck,
    stroke_factor,
)
from edge_service.estimate.mixture.state import ASSUMED, Reading
from edge_service.messages.samples import Floats
from edge_service.models.commissioned import CommissionedConfig, TransmissionConfig
from edge_service.models.effects.baseline import Motion
from edge_service.models.effects.learned import learned_effects, model_effects
from edge_service.models.effects.signature import torque_signature, transmission_signature
from edge_service.models.machine import Machine

NODES = 41
NO_MODEL = {
    *("noise_density_nm2_s", "noise_slow_rad_s", "noise_density_m2_s", "edge_noise_rad2_s2"),
    *("motion_s", "slowest_rad_s", "cruise_rad_s2", "assumed_fresh"),
    *("sample_period_s", "interval_s", "hold_s", "gap"),
    *("stretch_sigma_s2", "map_sigma_m", "nut_share", "nut_share_sigma"),
}
"""Values of certainty, noise and steadiness; the nut's share of a spring known as a whole."""
ON_AVERAGE = {"stretch_bow_s2_per_m2"}  # the spring of a simulation is straight along the stroke
IN_BASELINE = {"coulomb_nm", "reversal_force_n"}
"""Commissioning writes these into `[model]` as well."""
MOVED = {
    "torque_offset_nm": 0.02,
    "viscous_asymmetry_nm_s_per_rad": 4e-4,
    "stribeck_excess_nm": 0.1,
    "stribeck_speed_rad_s": 9.0,
    "stroke_map": ((0.1, -0.05),),
    "reference_m": 0.2,
    "stretch_per_acceleration_s2": 7e-7,
    "stretch_slope_s2_per_m": 5e-7,
    "guide_viscous_n_s_per_m": 80.0,
    "clock_skew_s": 3e-6,
    "lead_map_m": tuple(2e-6 * np.sin(np.linspace(0.0, 2.0, NODES))),
    "wind_up_map_m": (4e-8,) * NODES,
}


def changed(machine: Machine, **change: object) -> Machine:
    """The machine with other numbers in `[commissioned]`, wherever they stand in it."""
    known = machine.commissioned
    assert known is not None and known.transmission is not None
    below = {k: v for k, v in change.items() if k in TransmissionConfig.model_fields}
    here = {k: v for k, v in change.items() if k in CommissionedConfig.model_fields}
    learned = known.transmission.model_copy(update=below)
    known = known.model_copy(update={"transmission": learned, **here})
    return machine.model_copy(update={"commissioned": known})


@pytest.fixture(scope="module")
def axis() -> Machine:
    """Axis whose nut hardly gives, for its spring does not follow the force in proportion."""
    machine = load_machine(DEFAULT_MACHINE.with_name("commissioned.toml"))
    return changed(machine, nut_share=1e-9, noise_slow_rad_s=1.0)


def motion(machine: Machine) -> Motion:
    """Steady pieces of motion in no order: every direction, speed, place and acceleration."""
    rng, count = np.random.default_rng(3), 400
    speed = rng.uniform(1.0, 150.0, count) * rng.choice([-1.0, 1.0], count)
    place_m = rng.uniform(0.05, 0.75, count)
    return Motion.of_samples(
        rigid_baseline(machine),
        np.arange(count) * 1e-3,
        place_m / machine.transmission_ratio_m_per_rad,
        speed,
        rng.uniform(-900.0, 900.0, count),
        position_m=place_m,
    )


def modelled(machine: Machine, moved: Motion) -> tuple[Floats, Floats]:
    """Torque, and x - R theta less its mean, as the diagnosis models them."""
    (learned,), baseline = learned_effects(machine), rigid_baseline(machine)
    torque = moved.model_torque_nm + torque_signature(learned.effect, {}, moved, baseline)
    travel = transmission_signature(learned.effect, {}, moved, baseline)
    return torque, travel - travel.mean()


def expected(machine: Machine, moved: Motion) -> tuple[Floats, Floats]:
    """The same from the estimator's equations."""
    settings = ASSUMED._replace(twist=0.0, torque_scale=0.0)
    model = axis_model(machine)
    x = start_of(machine, model, settings).mean
    slope, found = np.zeros(len(x)), []
    columns = moved.direction, moved.acceleration_rad_s2, moved.speed_rad_s, moved.position_m
    for way, acceleration, speed, place_m in zip(*columns, strict=True):
        r = Reading(0.1, float(way), 0.0, float(acceleration), float(speed), float(place_m), 0.0)
        factor = stroke_factor(model, r.table_m)
        torque = expected_torque(model, x, r, factor, stribeck(model, r), slope)
        found.append((torque, -expected_stretch(model, x, r, 1.0, slope)[0]))
    torque_nm, travel_m = np.array(found).T
    return torque_nm, travel_m - travel_m.mean()


def test_the_numbers_are_all_of_them():
    """A number that commissioning learns next belongs to the model, or is listed here."""
    fields = {*CommissionedConfig.model_fields, *TransmissionConfig.model_fields}
    assert fields - {"transmission", "notch"} == NO_MODEL | ON_AVERAGE | IN_BASELINE | set(MOVED)


@pytest.mark.parametrize("names", [*([name] for name in MOVED), list(MOVED)])
def test_the_diagnosis_has_the_model_of_the_estimator(axis: Machine, names: list[str]):
    machine = changed(axis, **{name: MOVED[name] for name in names})
    moved = motion(machine)
    torque, travel = modelled(machine, moved)
    expected_nm, expected_m = expected(machine, moved)
    # the shift of an uneven screw takes force to follow, which no phase of the estimator has
    assert torque == pytest.approx(expected_nm, abs=2e-4)
    assert travel == pytest.approx(expected_m, abs=2e-9)


def test_without_commissioning_nothing_is_learned():
    machine = load_machine(DEFAULT_MACHINE)
    assert learned_effects(machine) == model_effects(machine) == ()
