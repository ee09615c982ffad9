"""State of a hypothesis of the fused estimator, and what its filter is told.

Elements of the state are the indices below; fused_physics has the equations they stand in.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..messages.samples import Floats

PRELOAD, RATE, DRY, GUIDE, VISCOUS, ASYMMETRY, MASS = range(7)
GAP, GROWTH, SKEW, NUT, OFFSET, SLIDE = range(7, 13)
GAIN, GAP_RATE, GROWTH_RATE, PLAY = range(13, 17)
BEGUN, ENDED = range(17, 19)
TURN_COS, TURN_SIN = range(19, 21)
LUBE = 21
"""p %, dp/dt %/s, B N m, G N, D and A N m s/rad, dM kg; g0 m, g1, T s, cn m/N, b N m, V N s/m;
e, dg0/dt m/s, dg1/dt 1/s, l m; w0, w1 rad/s; ec, es m; f.
Behind them h, m, and then r, N, at even nodes of the stroke."""
STATES = 22
RUB_NODES = 9
"""Of r; h has the others."""
WIND_UP_SHARE = 0.3
"""Of the screw's drag, acts behind the axis' spring: R^2 over torsional and whole compliance."""
CAPACITY = 72
"""Most hypotheses that live at the same time."""
CROWD = 24
"""Where as many live, a new one takes the place of the least likely."""

QUIET, WEARING, SETTLING = 0, 1, 2
"""Modes: preload wanders slowly, or runs at a rate, or friction settles after a change."""


class FusedModel(NamedTuple):
    """What is known of the axis; SI units, preload in percent of the dynamic load rating."""

    ratio_m_per_rad: float
    inertia_kg_m2: float
    table_mass_kg: float
    drag_per_percent_nm: float
    fresh_percent: float
    fresh_preload_n: float
    clearance_share: float  # half clearance of a nut without preload, over d0
    compliance_m_per_n: float  # c0, at the reference position, fresh
    compliance_slope_per_n: float  # c1
    reference_m: float  # x0
    stribeck_nm: float
    stribeck_speed_rad_s: float
    stroke_m: float  # period of the stroke map
    stroke_map: Floats  # (k, 2) cosine and sine of the k-th harmonic
    lead_map_m: Floats  # at even nodes from 0 to the stroke
    wind_up_map_m: Floats  # the same, times the direction
    torque_density: float  # (N m)^2 s: variance of a mean over 1 s of fast motion
    edge_rad2_s2: float  # variance of w
    torque_slow_rad_s: float  # motion as slow as this has twice that variance
    stretch_density: float  # m^2 s
    stretch_slow_rad_s: float
    process_force_n: float  # standard deviation


class Drift(NamedTuple):
    """Random walks per square root of a second, and jumps per second of motion."""

    walk: Floats  # (n,), of QUIET
    uneven: Floats  # (n - STATES, n - STATES) per s, of h and r
    moving: npt.NDArray[np.bool_]  # (n,), whether the walk needs motion
    rate_walk: float  # of the rate while WEARING, %/s per sqrt(s)
    jumps: Floats  # (j, n, n): covariance that each kind of jump adds
    shifts: Floats  # (j, n): what it adds to the mean
    hazards: Floats  # (j,) 1/s
    modes: npt.NDArray[np.int64]  # (j,), mode after the jump
    force_hazard: float  # share of phases in which a process force begins
    force_stay: float  # probability that it lasts for another phase


class Reading(NamedTuple):
    """One phase as measured; `stretch_m` is NaN with one encoder."""

    steady_s: float
    direction: float
    torque_nm: float
    acceleration_rad_s2: float
    speed_rad_s: float
    table_m: float
    stretch_m: float
    follows: bool = False  # whether it begins where the phase before has ended


class Mixture(NamedTuple):
    """The hypotheses; `alive[0]` of the CAPACITY rows count."""

    alive: npt.NDArray[np.int64]  # (1,)
    log_weight: Floats  # (CAPACITY,)
    mode: npt.NDArray[np.int64]  # (CAPACITY,)
    kind: npt.NDArray[np.int64]  # (CAPACITY,), the last jump; -1 if there was none
    age_s: Floats  # (CAPACITY,), motion since then
    force: Floats  # (CAPACITY,), probability that a process force acts
    since_force_s: Floats  # (1,), motion since a large one
    mean: Floats  # (CAPACITY, n)
    covariance: Floats  # (CAPACITY, n, n)


class Innovation(NamedTuple):
    """Of torque and stretch; with one encoder the second means nothing."""

    slopes: Floats  # (2, n) H
    gains: Floats  # (2, n) P H'
    error: Floats  # (2,)
    covariance: Floats  # (2, 2), but for process forces
