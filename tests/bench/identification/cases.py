"""Simulated recordings for identification, each with the parameters that stand behind it."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.fingerprint.friction.cruises import friction_points
from edge_service.fingerprint.friction.curve import fit_friction
from edge_service.fingerprint.response.frequency_response import drive_responses_along
from edge_service.fingerprint.response.two_mass_fit import fit_two_mass
from edge_service.fingerprint.transmission.stiffness import backlash, fit_stiffness
from edge_service.messages.samples import TORQUE, SampleFrame
from edge_service.models.effects.registry import parse_effect
from edge_service.models.feed_drive import FeedDrive, FeedDriveSettings
from edge_service.models.machine import Machine, Quantity
from edge_service.models.motions.registry import motion_limits
from edge_service.models.plant.two_mass import axial_compliance
from edge_service.offline.simulate import commanded_motion
from edge_service.regression.interval_estimate import IntervalEstimate
from edge_service.regression.inverse_dynamics import identify_inverse_dynamics
from edge_service.regression.prepared_run import PreparationSettings, PreparedRun, prepare

RATE_HZ = 1000.0
GUIDE_N, BEARING_NM, TABLE_KG = 40.0, 0.05, 20.0
CONSTANT_NM, ASYMMETRY_NM = 0.05, 0.02
EXCESS_NM, STRIBECK_RAD_S = 0.2, 4.0
PLAY_M = 8e-6
PLACES_M = (0.16, 0.4, 0.64)
LOWEST_HZ = 5.0


@dataclass(frozen=True, slots=True)
class Recovered:
    """One parameter of one simulated axis: what was found, and what it is."""

    found: IntervalEstimate
    truth: float


Recoveries = Mapping[str, Recovered]


def recoveries(seed: int) -> dict[str, Recovered]:
    """All parameters of all cases by `case.parameter`, for one seed of noise and motion."""
    machine = machine_file()
    return {
        f"{case}.{name}": recovered
        for case, identify in CASES.items()
        for name, recovered in identify(machine, seed).items()
    }


def machine_file() -> Machine:
    """The thesis' test bench; guides, bearings and table rub and weigh what is stated."""
    machine = load_machine(DEFAULT_MACHINE)
    known = {
        "guide_force_n": Quantity(value=GUIDE_N),
        "bearing_drag_nm": Quantity(value=BEARING_NM),
        "table_mass_kg": Quantity(value=TABLE_KG, tolerance=0.0),
    }
    return machine.model_copy(update={"model": machine.model.model_copy(update=known)})


def _recorded(
    machine: Machine, motion: str, seed: int, *effects: str
) -> tuple[SampleFrame, FeedDriveSettings]:
    settings = FeedDriveSettings.of_machine(machine, RATE_HZ, [parse_effect(e) for e in effects])
    limits, percent = motion_limits(machine), _percent(machine)
    random = np.random.default_rng((seed, 1))
    commanded = commanded_motion(motion, None, limits, RATE_HZ, random)
    drive = FeedDrive(settings, limits.low_m, percent, seed)
    setpoints = commanded.setpoints.take(commanded.count)
    return drive.advance(setpoints, np.full(commanded.count, percent)), settings


def _percent(machine: Machine) -> float:
    return machine.fresh_preload_percent or 0.0


def _preparation(machine: Machine) -> PreparationSettings:
    return PreparationSettings(machine.transmission_ratio_m_per_rad, torque_delay_s=0.5 / RATE_HZ)


def _runs(machine: Machine, frame: SampleFrame, *required: str) -> list[PreparedRun]:
    return list(prepare(frame, _preparation(machine), required))


def _coulomb_nm(machine: Machine, settings: FeedDriveSettings) -> float:
    """Coulomb level at the motor without effects: screw, bearings, guides."""
    screw_nm = float(settings.screw_drag_nm(_percent(machine)))
    return screw_nm + BEARING_NM + GUIDE_N * machine.transmission_ratio_m_per_rad


def _rigid(machine: Machine, seed: int) -> dict[str, Recovered]:
    effect = f"load_offset:constant_nm={CONSTANT_NM},asymmetry_nm={ASYMMETRY_NM}"
    frame, settings = _recorded(machine, "production", seed, effect)
    truths = {
        "inertia": machine.model.inertia_kg_m2.value,
        "viscous": machine.model.viscous_nm_s_per_rad.value,
        "coulomb": _coulomb_nm(machine, settings),
        "offset": CONSTANT_NM + ASYMMETRY_NM,
    }
    fit = identify_inverse_dynamics([frame], _preparation(machine))
    return {name: Recovered(fit.parameters[name], truth) for name, truth in truths.items()}


def _friction(machine: Machine, seed: int) -> dict[str, Recovered]:
    effect = f"stribeck:excess_nm={EXCESS_NM},speed_rad_s={STRIBECK_RAD_S}"
    frame, settings = _recorded(machine, "friction", seed, effect)
    inertia = machine.model.inertia_kg_m2.value
    points = list(friction_points(_runs(machine, frame, TORQUE), inertia_kg_m2=inertia))
    truth = {
        "coulomb_nm": _coulomb_nm(machine, settings),
        "stribeck_excess_nm": EXCESS_NM,
        "stribeck_speed_rad_s": STRIBECK_RAD_S,
        "viscous_nm_s_per_rad": machine.model.viscous_nm_s_per_rad.value,
        "offset_nm": 0.0,
    }
    parameters = fit_friction(points).parameters
    return {name: Recovered(parameters[name], value) for name, value in truth.items()}


def _two_masses(machine: Machine, seed: int) -> dict[str, Recovered]:
    frame, settings = _recorded(machine, "multisine", seed)
    fit = fit_two_mass([x.within(LOWEST_HZ, math.inf) for x in drive_responses_along([frame])])
    plant = settings.plant
    place_m = fit.place_rad * machine.transmission_ratio_m_per_rad
    stiffness = 1.0 / axial_compliance(plant, place_m, _percent(machine))
    motor, table = plant.motor_mass_kg, plant.table_mass_kg
    free = motor * table / (motor + table)
    step_s = 1.0 / RATE_HZ / settings.substeps
    notch_hz = _rings_hz(math.sqrt(stiffness / table), step_s)
    peak_hz = _rings_hz(math.sqrt(stiffness / free), step_s)
    truth = {
        "inertia": machine.model.inertia_kg_m2.value,
        "antiresonance": notch_hz,
        "resonance": peak_hz,
        "antiresonance_damping": 0.5 * plant.damping_n_s_per_m / math.sqrt(table * stiffness),
        "resonance_damping": 0.5 * plant.damping_n_s_per_m / math.sqrt(free * stiffness),
        "table_share": 1.0 - (notch_hz / peak_hz) ** 2,
        "viscous": plant.motor_viscous_nm_s_per_rad,
        "delay": 0.0,
    }
    return {name: Recovered(getattr(fit, name), value) for name, value in truth.items()}


def _rings_hz(natural_rad_s: float, step_s: float) -> float:
    """Frequency at which the plant's midpoint rule lets a mode ring: 2 atan(w h / 2) / h."""
    return 2.0 * math.atan(0.5 * natural_rad_s * step_s) / step_s / (2.0 * math.pi)


def _stiffness(machine: Machine, seed: int, play_m: float) -> dict[str, Recovered]:
    effects = [f"backlash:width_m={play_m}"] if play_m else []
    frame, settings = _recorded(machine, "acceleration", seed, *effects)
    fit = fit_stiffness(_runs(machine, frame), PLACES_M, machine.model.table_mass_kg)
    found = {}
    for point in fit.points:
        compliance = axial_compliance(settings.plant, point.position_m, _percent(machine))
        locked_hz = 1.0 / (2.0 * math.pi * math.sqrt(compliance * TABLE_KG))
        lost_m = 2.0 * GUIDE_N * compliance + play_m
        at = f"at_{round(1e3 * point.position_m)}_mm"
        found[f"stiffness_{at}"] = Recovered(point.stiffness, 1.0 / compliance)
        found[f"locked_resonance_{at}"] = Recovered(point.locked_resonance, locked_hz)
        found[f"lost_motion_{at}"] = Recovered(point.lost_motion, lost_m)
    if play_m:
        found["play"] = Recovered(fit.play, play_m)
        middle = backlash(fit.points[1], machine.model.guide_force_n)
        found["backlash_by_guide_force"] = Recovered(middle, play_m)
    return found


CASES: Mapping[str, Callable[[Machine, int], dict[str, Recovered]]] = {
    "rigid": _rigid,
    "friction": _friction,
    "two_masses": _two_masses,
    "stretch": partial(_stiffness, play_m=0.0),
    "stretch_with_play": partial(_stiffness, play_m=PLAY_M),
}
"""Inverse dynamics on production moves, the friction test, the multisine, the acceleration test."""
