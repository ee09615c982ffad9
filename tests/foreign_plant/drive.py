"""The constants of one axis, and the slow quantities beside them."""

from typing import NamedTuple

import numpy as np


class Drive(NamedTuple):
    """Constants of one axis; SI, rotations in rad, the table in m."""

    lead_rad: float = 0.02 / (2 * np.pi)
    j_motor: float = 1.14e-3
    j_screw: float = 1.22e-4
    bearing_c: float = 0.05
    guide_c: float = 60.0
    bearing_excess: float = 0.0  # static above kinetic level, share
    nut_excess: float = 0.0
    guide_excess: float = 0.0
    bearing_vs: float = 2.0
    nut_vs: float = 2.0
    guide_vs: float = 0.006
    bearing_reach: float = 2.0e-4
    nut_reach: float = 2.5e-4
    guide_reach: float = 8.0e-7
    bearing_visc: float = 2.0e-3
    nut_visc: float = 1.5e-3
    guide_visc: float = 148.0
    asymmetry: float = 0.0  # share of the Coulomb level, + in positive direction
    load_mu: float = 0.0  # N m per N of nut force
    churn: float = 0.0  # N m at 100 rad/s
    churn_power: float = 1.8
    accel_drag: float = 0.0  # N m s2/m, only while speeding up
    coupling_k: float = 3850.0
    shaft_gj: float = 656.0
    bearing_k: float = 2.0e8
    shaft_ae: float = 4.7e7
    shaft_start: float = 0.05  # m of shaft between bearing and home
    nut_hertz: float = 1.02e10  # N/m^1.5
    clearance: float = 1.5e-6
    play: float = -1.0  # m, free play that ignores the preload, if not negative
    torsion_d: float = 0.02
    axial_d: float = 1.0e3
    tilt_n: float = 0.0
    torque_offset: float = 0.0
    gain: float = 1.0
    applied_limit: float = 1.0e3
    fatigue: float = 0.0  # loss of torque per (N m)^2 remembered
    fatigue_tau: float = 8.0
    lag: float = 2.0e-4
    queue: float = 0.0  # ticks
    stroke: float = 0.8
    map_1: float = 0.0
    map_1_phase: float = 0.0
    map_2: float = 0.0
    map_2_phase: float = 0.0
    seal_n: float = 0.0  # N per decade of standstill
    seal_reach: float = 3.0e-3
    chain_n: float = 0.0
    chain_reach: float = 0.03
    loose_kg: float = 0.0
    loose_gap: float = 5.0e-5
    loose_k: float = 4.0e6
    load_cogging: float = 0.0  # share of the torque
    load_cogging_order: float = 7.0
    kv: float = 60.0
    kp: float = 0.55
    ti: float = 0.015
    ff_j: float = 1.5e-3
    torque_max: float = 20.0
    integral_max: float = 4.0
    speed_filter: float = 2.0e-4


SLOW = ("preload_n", "table_kg", "bearing", "nut", "guide", "viscous", "nut_drag_per_n")
