"""Two-mass feed drive: motor and screw, a spring, the table; dry friction that truly sticks.

In travel coordinates x1 = R_t theta (motor side) and x2 = x (table), with m1 = J1 / R_t^2::

    m1 x1'' = u / R_t - K (x1 - x2) - c (x1' - x2') - d1 x1' - f1
    m2 x2'' = F_ext   + K (x1 - x2) + c (x1' - x2') - d2 x2' - f2

(the seed's second model, 5.3.21, with friction). The drag of the screw and of its bearings f1 acts
on the motor side, the friction of the guides f2 on the table.
"""

import math
from typing import NamedTuple

from ..messages.samples import Floats
from .compiled import compiled
from .stiffness import nut_stiffness, screw_compliance

MOTOR_TRAVEL = 0  # x1, m
MOTOR_SPEED = 1  # x1', m/s
TABLE_POSITION = 2  # x2, m
TABLE_SPEED = 3  # x2', m/s
FILTERED_MOTOR_SPEED = 4  # behind the drive's speed filter, m/s
FILTERED_TABLE_SPEED = 5  # behind the drive's speed filter, m/s
STATE_SIZE = 6

_FRICTION_SWEEPS = 30


class Plant(NamedTuple):
    """Constants of one feed drive.

    Attributes:
        motor_inertia_kg_m2: J1, rotor, coupling and screw.
        screw_rigidity_n: A E of the screw; `far_end_fixed` is 1.0 for fixed-fixed, else 0.0.
        nut_catalogue_n_per_m: K of (5.3.11).
        support_compliance_m_per_n: bearing with its support, and coupling through the lead.
        damping_n_s_per_m: structural damping c parallel to the spring.
        stribeck_excess_nm: breakaway torque above the Coulomb level, at the motor.
        drag_variation: relative amplitude of the screw drag along the stroke, with its period.
        speed_lag_s: time constant of the drive's speed filters.
    """

    ratio_m_per_rad: float
    motor_inertia_kg_m2: float
    table_mass_kg: float
    motor_viscous_nm_s_per_rad: float
    table_viscous_n_s_per_m: float
    screw_rigidity_n: float
    screw_length_m: float
    far_end_fixed: float
    nut_catalogue_n_per_m: float
    support_compliance_m_per_n: float
    damping_n_s_per_m: float
    bearing_drag_nm: float
    guide_force_n: float
    stribeck_excess_nm: float
    stribeck_speed_rad_s: float
    drag_variation: float
    drag_variation_period_m: float
    speed_lag_s: float

    @property
    def motor_mass_kg(self) -> float:
        """Motor-side inertia as the mass that it weighs at the table, kg: J1 / R_t^2."""
        return self.motor_inertia_kg_m2 / self.ratio_m_per_rad**2


class Load(NamedTuple):
    """What acts on the plant, and how stiff it is, during one period.

    Attributes:
        torque_nm: at the motor shaft.
        force_n: external force on the table, positive along x.
        screw_drag_nm: Coulomb level of the ball screw, without bearings and guides.
        compliance_m_per_n: of the spring between motor and table.
    """

    torque_nm: float
    force_n: float
    screw_drag_nm: float
    compliance_m_per_n: float


@compiled
def axial_compliance(plant: Plant, position_m: float, preload_percent: float) -> float:
    """Compliance of all springs in series, m/N (5.3.1)."""
    return (
        plant.support_compliance_m_per_n
        + screw_compliance(
            position_m, plant.screw_rigidity_n, plant.screw_length_m, plant.far_end_fixed
        )
        + 1.0 / nut_stiffness(plant.nut_catalogue_n_per_m, preload_percent)
    )


@compiled
def dry_torque(plant: Plant, screw_drag_nm: float, position_m: float, speed_m_s: float) -> float:
    """Level of the dry friction on the motor side, N m, not negative.

    Coulomb drag of screw and bearings, and the Stribeck excess F_s exp(-(omega / omega_s)^2).
    """
    level_nm = screw_drag_nm + plant.bearing_drag_nm
    if plant.drag_variation != 0.0:
        phase = 2.0 * math.pi * position_m / plant.drag_variation_period_m
        level_nm += screw_drag_nm * plant.drag_variation * math.sin(phase)
    if plant.stribeck_excess_nm != 0.0:
        slowness = speed_m_s / (plant.ratio_m_per_rad * plant.stribeck_speed_rad_s)
        level_nm += plant.stribeck_excess_nm * math.exp(-slowness * slowness)
    return max(level_nm, 0.0)


@compiled
def _shrink(impulse: float, limit: float) -> float:
    """What a friction impulse of at most `limit` leaves of `impulse`; 0.0 is sticking."""
    if impulse > limit:
        return impulse - limit
    if impulse < -limit:
        return impulse + limit
    return 0.0


@compiled
def advance_plant(plant: Plant, state: Floats, load: Load, period_s: float, substeps: int) -> None:
    """Advance `state` (STATE_SIZE,) in place by one period under a constant load.

    Moreau-Jean time stepping: the midpoint rule for spring, damper and viscous friction (second
    order, exact in energy, stable for any step and stiffness), and dry friction as an impulse
    within +-limit that opposes the speed at the end of the step or holds it at exactly zero. The
    two impulses are coupled through spring and damper only; each sweep contracts the error by
    (h^2 K / 4)^2 / (m1 m2), about 1e-6 at 16 kHz, and they end when nothing changes any more. The
    step must resolve the resonance (h w < 1) for the result to be accurate, not to be stable.
    """
    h = period_s / substeps
    ratio = plant.ratio_m_per_rad
    stiffness = 1.0 / load.compliance_m_per_n
    m1 = plant.motor_inertia_kg_m2 / (ratio * ratio)
    m2 = plant.table_mass_kg
    d1 = plant.motor_viscous_nm_s_per_rad / (ratio * ratio)
    d2 = plant.table_viscous_n_s_per_m
    damper = plant.damping_n_s_per_m + 0.5 * h * stiffness
    a11 = m1 + 0.5 * h * (damper + d1)
    a22 = m2 + 0.5 * h * (damper + d2)
    a12 = 0.5 * h * damper
    filter_gain = 1.0 - math.exp(-h / plant.speed_lag_s)
    x1, v1 = state[MOTOR_TRAVEL], state[MOTOR_SPEED]
    x2, v2 = state[TABLE_POSITION], state[TABLE_SPEED]
    y1, y2 = state[FILTERED_MOTOR_SPEED], state[FILTERED_TABLE_SPEED]
    guide_limit = h * plant.guide_force_n
    for _ in range(substeps):
        spring = stiffness * (x1 - x2)
        coupled = 0.5 * damper * (v1 - v2)
        impulse1 = m1 * v1 + h * (load.torque_nm / ratio - spring - coupled - 0.5 * d1 * v1)
        impulse2 = m2 * v2 + h * (load.force_n + spring + coupled - 0.5 * d2 * v2)
        motor_limit = h * dry_torque(plant, load.screw_drag_nm, x2, v1) / ratio
        w1, w2 = v1, v2
        for _sweep in range(_FRICTION_SWEEPS):
            u1 = _shrink(impulse1 + a12 * w2, motor_limit) / a11
            u2 = _shrink(impulse2 + a12 * u1, guide_limit) / a22
            settled = u1 == w1 and u2 == w2
            w1, w2 = u1, u2
            if settled:
                break
        x1 += 0.5 * h * (v1 + w1)
        x2 += 0.5 * h * (v2 + w2)
        y1 += filter_gain * (0.5 * (v1 + w1) - y1)
        y2 += filter_gain * (0.5 * (v2 + w2) - y2)
        v1, v2 = w1, w2
    state[MOTOR_TRAVEL], state[MOTOR_SPEED] = x1, v1
    state[TABLE_POSITION], state[TABLE_SPEED] = x2, v2
    state[FILTERED_MOTOR_SPEED], state[FILTERED_TABLE_SPEED] = y1, y2
