"""Two-mass feed drive: motor and screw, a spring, the table; dry friction that truly sticks.

In travel coordinates x1 = R_t theta (motor side) and x2 = x (table), with m1 = J1 / R_t^2::

    m1 x1'' = u / R_t - g F - d1 x1' - f1            F = K s + c s',  s = x1 + e - x2
    m2 x2'' = F_ext   +   F - d2 x2' - f2            g = 1 + de / dx1

(the thesis' second model, 5.3.21, with friction). The drag of the screw and of its bearings f1 acts
on the motor side, the friction of the guides f2 on the table. The shift e of the nut along the
screw (lead error, growth) does no work of its own, hence g. With backlash the spring has a play;
nothing but the guides' friction holds the table in it: without any, a closed loop hunts there.
"""

import math
from typing import NamedTuple

from ...messages.samples import Floats
from ..compiled import compiled
from ..screw.nut_law import nut_stiffness
from ..screw.stiffness import screw_compliance
from .dry_friction import Levels, rub
from .tables import NO_TABLES, Tables, find_friction, nut_shift

MOTOR_TRAVEL = 0  # x1, m
MOTOR_SPEED = 1  # x1', m/s
TABLE_POSITION = 2  # x2, m
TABLE_SPEED = 3  # x2', m/s
FILTERED_MOTOR_SPEED = 4  # behind the drive's speed filter, m/s
FILTERED_TABLE_SPEED = 5  # behind the drive's speed filter, m/s
SHAFT_TORQUE = 6  # behind the lag of the torque path, N m
MOTOR_FRICTION = 7  # dry friction against positive motion in the latest step, N
TABLE_FRICTION = 8
STATE_SIZE = 9

LEAST_COMPLIANCE_M_PER_N = 1e-10
_FRICTION_SWEEPS = 30


class Plant(NamedTuple):
    """Constants of one feed drive."""

    ratio_m_per_rad: float
    motor_inertia_kg_m2: float  # J1: rotor, coupling and screw
    table_mass_kg: float
    motor_viscous_nm_s_per_rad: float
    table_viscous_n_s_per_m: float
    screw_rigidity_n: float  # A E
    screw_length_m: float
    far_end_fixed: float  # 1.0 for fixed-fixed, else 0.0
    nut_catalogue_n_per_m: float  # K of (5.3.11)
    bearing_compliance_m_per_n: float  # of one fixed bearing with its support
    further_compliance_m_per_n: float  # wherever the nut is: the coupling through the lead
    damping_n_s_per_m: float  # structural, parallel to the spring
    bearing_drag_nm: float
    guide_force_n: float
    speed_lag_s: float  # time constant of the drive's speed filters
    stretch_zero_m: float = 0.0  # s where x1 = x2, before any shift of the nut
    compliance_slope_per_n: float = 0.0  # beyond that of the screw, per metre of position
    torque_lag_s: float = 0.0  # first-order, between the torque command and the shaft
    backlash_m: float = 0.0  # play of the spring; its forward flank is at s = 0
    bristle_reach_m: float = 0.0  # friction level over presliding stiffness; 0.0 has none
    load_friction: float = 0.0  # screw friction per torque that the spring carries
    tables: Tables = NO_TABLES  # what follows speed, position or angle

    @property
    def motor_mass_kg(self) -> float:
        """Motor-side inertia as the mass that it weighs at the table, kg: J1 / R_t^2."""
        return self.motor_inertia_kg_m2 / self.ratio_m_per_rad**2


class Load(NamedTuple):
    """Loads on the plant, and its stiffness, during one period."""

    torque_nm: float  # commanded, at the motor shaft
    force_n: float  # external, on the table, positive along x
    screw_drag_nm: float  # Coulomb level of the ball screw, without bearings and guides
    compliance_m_per_n: float  # of the spring between motor and table
    added_mass_kg: float = 0.0  # on the table
    motor_dry_nm: float = 0.0  # further dry friction on either side, at the motor
    table_dry_nm: float = 0.0
    motor_viscous_nm_s_per_rad: float = 0.0  # further viscous friction of the motor side
    resisting_nm: float = 0.0  # smooth torque against positive motion, at the motor
    strain: float = 0.0  # of the screw, m of shift per m of travel


class Loads(NamedTuple):
    """Loads that follow time or temperature, (n,) each; see Load."""

    force_n: Floats
    motor_dry_nm: Floats
    table_dry_nm: Floats
    motor_viscous_nm_s_per_rad: Floats
    resisting_nm: Floats
    strain: Floats


@compiled
def load_at(
    loads: Loads, k: int, torque_nm: float, screw_drag_nm: float, compliance: float, mass_kg: float
) -> Load:
    """Load of period `k`; `mass_kg` is added to the table."""
    return Load(
        torque_nm,
        loads.force_n[k],
        screw_drag_nm,
        compliance,
        mass_kg,
        loads.motor_dry_nm[k],
        loads.table_dry_nm[k],
        loads.motor_viscous_nm_s_per_rad[k],
        loads.resisting_nm[k],
        loads.strain[k],
    )


@compiled
def axial_compliance(plant: Plant, position_m: float, preload_percent: float) -> float:
    """Compliance of all springs in series, m/N (5.3.2)."""
    length_m, fixed = plant.screw_length_m, plant.far_end_fixed
    bearing = plant.bearing_compliance_m_per_n
    screw = screw_compliance(position_m, plant.screw_rigidity_n, length_m, fixed, bearing)
    nut = 1.0 / nut_stiffness(plant.nut_catalogue_n_per_m, preload_percent)
    further = plant.further_compliance_m_per_n + plant.compliance_slope_per_n * position_m
    return max(further + screw + nut, LEAST_COMPLIANCE_M_PER_N)


@compiled
def resistance(
    plant: Plant, load: Load, travel_m: float, speed_m_s: float, spring_n: float
) -> tuple[Levels, float, Levels, float]:
    """Friction of the motor side and of the table: dry levels, and smooth force, N each.

    Dry friction is the sum of its parts over speed, position, angle and time; where parts take away
    more than there is, nothing is left.
    """
    ratio, reach = plant.ratio_m_per_rad, plant.bristle_reach_m
    found = find_friction(plant.tables, travel_m, travel_m / ratio, speed_m_s / ratio)
    drag_nm = load.screw_drag_nm + plant.bearing_drag_nm + load.motor_dry_nm
    drag_nm += plant.load_friction * abs(spring_n) * ratio
    guide_nm = plant.guide_force_n * ratio + load.table_dry_nm
    forward = max(drag_nm + found.motor_forward_nm, 0.0) / ratio
    backward = max(drag_nm + found.motor_backward_nm, 0.0) / ratio
    drag = Levels(forward, backward, reach)
    forward = max(guide_nm + found.table_forward_nm, 0.0) / ratio
    backward = max(guide_nm + found.table_backward_nm, 0.0) / ratio
    guide = Levels(forward, backward, reach)
    smooth_n = (load.resisting_nm + found.motor_smooth_nm) / ratio
    return drag, smooth_n, guide, found.table_smooth_nm / ratio


@compiled
def _spring(plant: Plant, state: Floats, strain: float) -> tuple[float, float, float]:
    """Stretch of the spring, m, slope of x1 + e over x1, and 1.0 where the flanks touch."""
    travel = state[MOTOR_TRAVEL]
    shift, slope = nut_shift(plant.tables, travel, plant.ratio_m_per_rad)
    stretch = plant.stretch_zero_m + (1.0 + strain) * travel + shift - state[TABLE_POSITION]
    gear = 1.0 + strain + slope
    if plant.backlash_m <= 0.0 or stretch > 0.0:
        return stretch, gear, 1.0
    stretch += plant.backlash_m
    return stretch, gear, 1.0 if stretch < 0.0 else 0.0


@compiled
def _step(plant: Plant, state: Floats, load: Load, h: float) -> None:
    """Advance all but the speed filters by one step of `h` seconds."""
    ratio = plant.ratio_m_per_rad
    m1 = plant.motor_inertia_kg_m2 / (ratio * ratio)
    m2 = plant.table_mass_kg + load.added_mass_kg
    viscous = plant.motor_viscous_nm_s_per_rad + load.motor_viscous_nm_s_per_rad
    d1 = max(viscous, 0.0) / (ratio * ratio)
    d2 = plant.table_viscous_n_s_per_m
    v1, v2 = state[MOTOR_SPEED], state[TABLE_SPEED]
    stretch, gear, touching = _spring(plant, state, load.strain)
    stiffness = touching / load.compliance_m_per_n
    damper = touching * plant.damping_n_s_per_m + 0.5 * h * stiffness
    a11 = m1 + 0.5 * h * (damper * gear * gear + d1)
    a22 = m2 + 0.5 * h * (damper + d2)
    a12 = 0.5 * h * damper * gear
    spring = stiffness * stretch
    drag, smooth1, guide, smooth2 = resistance(plant, load, state[MOTOR_TRAVEL], v1, spring)
    carried = spring + 0.5 * damper * (gear * v1 - v2)
    motor_n = state[SHAFT_TORQUE] / ratio - gear * carried - 0.5 * d1 * v1 - smooth1
    impulse1 = m1 * v1 + h * motor_n
    impulse2 = m2 * v2 + h * (load.force_n + carried - 0.5 * d2 * v2 - smooth2)
    held1, held2 = state[MOTOR_FRICTION], state[TABLE_FRICTION]
    w1, w2 = v1, v2
    for _sweep in range(_FRICTION_SWEEPS):
        u1, state[MOTOR_FRICTION] = rub(drag, impulse1 + a12 * w2, a11, h, held1, v1)
        u2, state[TABLE_FRICTION] = rub(guide, impulse2 + a12 * u1, a22, h, held2, v2)
        settled = u1 == w1 and u2 == w2
        w1, w2 = u1, u2
        if settled:
            break
    state[MOTOR_TRAVEL] += 0.5 * h * (v1 + w1)
    state[TABLE_POSITION] += 0.5 * h * (v2 + w2)
    state[MOTOR_SPEED], state[TABLE_SPEED] = w1, w2


@compiled
def advance_plant(plant: Plant, state: Floats, load: Load, period_s: float, substeps: int) -> None:
    """Advance `state` (STATE_SIZE,) in place by one period under a constant load.

    Moreau-Jean time stepping: the midpoint rule for spring, damper and viscous friction (second
    order, exact in energy, stable for any step and stiffness), and dry friction as an impulse
    within its levels that opposes the speed at the end of the step or holds it at exactly zero. The
    two impulses are coupled through spring and damper only; each sweep contracts the error by
    (h^2 K / 4)^2 / (m1 m2), about 1e-6 at 16 kHz, and they end when nothing changes any more. The
    step must resolve the resonance (h w < 1) for the result to be accurate, not to be stable.
    Tables, load friction and the flank of a backlash are those at the beginning of the step.
    """
    h = period_s / substeps
    filter_gain = 1.0 - math.exp(-h / plant.speed_lag_s)
    lag_left = math.exp(-h / plant.torque_lag_s) if plant.torque_lag_s > 0.0 else 0.0
    for _ in range(substeps):
        v1, v2 = state[MOTOR_SPEED], state[TABLE_SPEED]
        lag_nm = state[SHAFT_TORQUE] - load.torque_nm
        state[SHAFT_TORQUE] = load.torque_nm + lag_left * lag_nm
        _step(plant, state, load, h)
        mean1, mean2 = 0.5 * (v1 + state[MOTOR_SPEED]), 0.5 * (v2 + state[TABLE_SPEED])
        state[FILTERED_MOTOR_SPEED] += filter_gain * (mean1 - state[FILTERED_MOTOR_SPEED])
        state[FILTERED_TABLE_SPEED] += filter_gain * (mean2 - state[FILTERED_TABLE_SPEED])
