"""The plant behind a machine file, completed by the thesis' test bench where the file is silent."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...messages.samples import Floats
from ..machine import Machine
from ..screw.ball_screw import table_inertia
from ..screw.nut_law import catalogue_nut_stiffness
from ..screw.stiffness import STEEL_MODULUS_PA, axial_stiffness_of_torsion, screw_area
from .two_mass import Plant, axial_compliance

TABLE_MASS_KG = 20.0  # m_t + m_wp that Table 4.1's J_t = 2.03e-4 kg m^2 stands for
SCREW_DIAMETER_M = 0.02  # Table A.1
SCREW_LENGTH_M = 0.998  # Table A.1
COUPLING_NM_PER_RAD = 67.2 * 180.0 / math.pi  # Table A.5
NUT_CATALOGUE_N_PER_M = 1.6e8  # assumption: a 20 x 20 nut at a tenth of its load rating
BEARING_N_PER_M = 1.0e8  # assumption: fixed bearing with its support
DAMPING_RATIO = 0.03  # assumption: of the resonance at mid-stroke
SPEED_LAG_S = 5e-4  # the drive's speed filter lags 0.3 to 1 ms
LARGEST_TABLE_SHARE = 0.5  # assumption: of the whole inertia, where the table is not known


def plant_of(machine: Machine) -> Plant:
    """Plant constants from a machine file, without its effects (4.3.2, 4.3.5, 5.3.2, 5.3.9).

    Raises ValueError: the table is heavier than the whole inertia.
    """
    axis, model = machine.axis, machine.model
    ratio = machine.transmission_ratio_m_per_rad
    mass = table_mass(machine)
    motor_inertia = model.inertia_kg_m2.value - table_inertia(mass, axis.lead_m)
    if motor_inertia <= 0.0:
        raise ValueError(
            f"model.inertia_kg_m2: {model.inertia_kg_m2.value:g} leaves nothing for the motor "
            f"beside a table of {mass:g} kg"
        )
    coupling = axial_stiffness_of_torsion(COUPLING_NM_PER_RAD, ratio)
    catalogue, fresh_percent = NUT_CATALOGUE_N_PER_M, machine.fresh_preload_percent
    if model.nut_stiffness_n_per_m is not None and fresh_percent is not None:
        catalogue = catalogue_nut_stiffness(model.nut_stiffness_n_per_m.value, fresh_percent)
    drag, guide_n = model.preload_drag_nm, model.guide_force_n.value
    if drag is not None and model.preload_n is None:  # the whole Coulomb level, put on the guides
        guide_n += drag.value / ratio
    length = max(axis.screw_length_m or SCREW_LENGTH_M, axis.stroke_m or 0.0)
    rigid = Plant(
        ratio_m_per_rad=ratio,
        motor_inertia_kg_m2=motor_inertia,
        table_mass_kg=mass,
        motor_viscous_nm_s_per_rad=model.viscous_nm_s_per_rad.value,
        table_viscous_n_s_per_m=0.0,
        screw_rigidity_n=STEEL_MODULUS_PA * screw_area(axis.screw_diameter_m or SCREW_DIAMETER_M),
        screw_length_m=length,
        far_end_fixed=1.0 if axis.bearing_arrangement == "fixed-fixed" else 0.0,
        nut_catalogue_n_per_m=catalogue,
        bearing_compliance_m_per_n=1.0 / BEARING_N_PER_M,
        further_compliance_m_per_n=1.0 / coupling,
        damping_n_s_per_m=0.0,
        bearing_drag_nm=model.bearing_drag_nm.value,
        guide_force_n=guide_n,
        speed_lag_s=SPEED_LAG_S,
    )
    # damper that gives the free resonance at mid-stroke its damping ratio: 2 z sqrt(K m), with
    # m = m1 m2 / (m1 + m2), as in the denominator of (5.3.19) without D_2
    stiffness = 1.0 / axial_compliance(rigid, 0.5 * length, fresh_percent or 0.0)
    reduced_kg = 1.0 / (1.0 / rigid.motor_mass_kg + 1.0 / rigid.table_mass_kg)
    return rigid._replace(damping_n_s_per_m=2.0 * DAMPING_RATIO * math.sqrt(stiffness * reduced_kg))


def table_mass(machine: Machine) -> float:
    """Mass of table and workpiece, kg: the machine file's, or the test bench's where that fits."""
    if machine.model.table_mass_kg:
        return machine.model.table_mass_kg.value
    whole_kg = machine.model.inertia_kg_m2.value / machine.transmission_ratio_m_per_rad**2
    return min(TABLE_MASS_KG, LARGEST_TABLE_SHARE * whole_kg)


def screw_drag(machine: Machine) -> tuple[float, float]:
    """Drag of the screw without preload, N m, and its rise per point of preload, N m (4.3.6).

    Where the file cannot tell preload in percent, the drag does not follow it.
    """
    per_percent = machine.drag_per_percent_nm
    return (machine.fresh_drag_nm, 0.0) if per_percent is None else (0.0, per_percent)


class StateSpace(NamedTuple):
    """A, B and C of x' = A x + B u, y = C x."""

    a: Floats
    b: Floats
    c: Floats


def chain(
    inertia: Sequence[float], springs: Sequence[tuple[float, float]], viscous: Sequence[float]
) -> StateSpace:
    """Masses in a row: places, then speeds; forces on each in, places out (5.3.6 to 5.3.8).

    One is (5.3.16), where (5.3.18) prints J_m for J. Two are (5.3.21), whose inputs stand in each
    other's row; (5.3.19) prints J_m + J_fd for their product, and D_2 J_m where D_2 on the motor
    gives D_2 J_fd. (5.3.8) prints m_1 s^2 k_1 for m_1 s^2 + k_1. (5.3.17) and (5.3.20) lack the
    lowest coefficients of a sampled model.

    Args:
        inertia: n masses, kg, or inertias, kg m^2.
        springs: n - 1 stiffnesses and dampings, each between a mass and the next.
        viscous: n frictions against the ground.

    >>> chain([2.0], [], [0.5]).a.tolist()
    [[0.0, 1.0], [0.0, -0.25]]
    """
    count = len(inertia)
    stiffness, damping = np.zeros((count, count)), np.diag(viscous)
    pull = np.array([[1.0, -1.0], [-1.0, 1.0]])
    for k, (spring, damper) in enumerate(springs):
        stiffness[k : k + 2, k : k + 2] += spring * pull
        damping[k : k + 2, k : k + 2] += damper * pull
    none, inverse = np.zeros((count, count)), np.diag(1.0 / np.array(inertia))
    a = np.block([[none, np.eye(count)], [0.0 - inverse @ stiffness, 0.0 - inverse @ damping]])
    return StateSpace(a, np.vstack([none, inverse]), np.eye(count, 2 * count))


def component_model(masses: StateSpace, ratio_m_per_rad: float) -> StateSpace:
    """Shaft, lead screw and platform of Figure 5.14, of two masses at the motor, without Coulomb.

    Torque, N m, on the shaft and force, N, on the platform in; angle, rad, its speed, place, m, and
    its speed out.
    """
    unit = np.diag([1.0, ratio_m_per_rad] * 2)
    a = unit @ masses.a @ np.linalg.inv(unit)
    return StateSpace(a, unit @ masses.b @ unit[:2, :2], np.eye(4)[[0, 2, 1, 3]])
