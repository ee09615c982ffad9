"""The plant behind a machine file, completed by the thesis' test bench where the file is silent."""

import math

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
