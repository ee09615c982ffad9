"""Inverse simulation: torque and table position along a prescribed motion of the motor.

No controller stands between: gains that nobody knows would decide what a simulated recording looks
like. The motor is given so much inertia that nothing turns it from its way, and what the rest of
the plant takes of its momentum in a period is the force that the real motor must give besides.
"""

from typing import NamedTuple

import numpy as np

from ...messages.samples import Floats
from ..compiled import compiled
from .tables import nut_shift
from .two_mass import (
    MOTOR_SPEED,
    MOTOR_TRAVEL,
    STATE_SIZE,
    TABLE_POSITION,
    TABLE_SPEED,
    Loads,
    Plant,
    advance_plant,
    axial_compliance,
    load_at,
)

_HEAVY_KG = 1e8
TORQUE, STRETCH = 0, 1


class Way(NamedTuple):
    """Motion of the motor, and what acts meanwhile, (n,) each."""

    speed_m_s: Floats
    place_m: Floats  # of the table along the screw, for the stiffness
    loads: Loads


def following_state(
    plant: Plant, travel_m: float, speed_m_s: float, strain: float, came_from: float
) -> Floats:
    """State (STATE_SIZE,) of a table that follows, on the flank of the last approach.

    `strain` is the screw's, m of shift per m of travel, `came_from` the last direction, -1 or 1.
    """
    shift_m, slope = nut_shift(plant.tables, travel_m, plant.ratio_m_per_rad)
    state = np.zeros(STATE_SIZE)
    state[MOTOR_TRAVEL], state[MOTOR_SPEED] = travel_m, speed_m_s
    state[TABLE_POSITION] = (1.0 + strain) * travel_m + shift_m
    state[TABLE_POSITION] += plant.backlash_m if came_from < 0.0 else 0.0
    state[TABLE_SPEED] = (1.0 + strain + slope) * speed_m_s
    return state


def simulate_inverse(
    plant: Plant,
    screw_drag_nm: float,
    preload_percent: float,
    period_s: float,
    substeps: int,
    state: Floats,
    way: Way,
) -> Floats:
    """Move through n periods; at each sample the speed is that of `way`, linear between.

    Args:
        plant: without a lag of its torque path.
        state: (STATE_SIZE,), advanced in place to the last sample.
        way: of n + 1 samples.

    Returns:
        Of each period the mean torque at the shaft, N m, and how far the table is ahead of the
        motor at its beginning, m, (n, 2).
    """
    ratio = plant.ratio_m_per_rad
    heavy = plant._replace(motor_inertia_kg_m2=_HEAVY_KG * ratio**2)
    out = np.empty((len(way.speed_m_s) - 1, 2))
    load = screw_drag_nm, preload_percent
    _simulate_inverse(heavy, plant.motor_mass_kg, load, period_s, substeps, state, way, out)
    return out


@compiled
def _simulate_inverse(
    heavy: Plant,
    own_kg: float,
    screw: tuple[float, float],
    period_s: float,
    substeps: int,
    state: Floats,
    way: Way,
    out: Floats,
) -> None:
    for k in range(out.shape[0]):
        rise_m_s = way.speed_m_s[k + 1] - way.speed_m_s[k]
        state[MOTOR_SPEED] = way.speed_m_s[k]
        out[k, STRETCH] = state[TABLE_POSITION] - state[MOTOR_TRAVEL]
        compliance = axial_compliance(heavy, way.place_m[k], screw[1])
        prescribing_nm = _HEAVY_KG * rise_m_s / period_s * heavy.ratio_m_per_rad
        load = load_at(way.loads, k, prescribing_nm, screw[0], compliance, 0.0)
        advance_plant(heavy, state, load, period_s, substeps)
        taken = _HEAVY_KG * (way.speed_m_s[k + 1] - state[MOTOR_SPEED])
        out[k, TORQUE] = heavy.ratio_m_per_rad * (own_kg * rise_m_s + taken) / period_s
