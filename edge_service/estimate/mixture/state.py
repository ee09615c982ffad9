"""State of the axis, slots of the hypotheses, and the arrays that hold both.

A hypothesis estimates these quantities of the axis, torque's first; an axis with one encoder has
TORQUE_STATES of them:

| state | meaning | unit |
|---|---|---|
| PRELOAD | natural logarithm of the preload in percent of the dynamic load rating | - |
| WEAR_RATE | growth of PRELOAD per second of motion | 1/s |
| NUT_FRICTION | change of the nut's Coulomb friction since commissioning, as a share of it | - |
| BEARING_FRICTION | the same of the bearings | - |
| GUIDE_FRICTION | the same of guides and seals | - |
| VISCOUS | change of the viscous friction at the motor, as a share of it | - |
| GUIDE_VISCOUS | the same of the guides | - |
| PAYLOAD | mass on the table beyond commissioning | kg |
| TORQUE_OFFSET | gravity, offset of the amplifier | N m |
| TORQUE_WANDER | friction that wanders along the way, against the motion | N m |
| SPEED_ERROR_START | error of the speed at the start of the phase | rad/s |
| SPEED_ERROR_END | the same at its end | rad/s |
| ENCODER_OFFSET | travel by the motor less that of the table, at the reference position | m |
| ENCODER_SLOPE | growth of that difference along the stroke | - |
| OFFSET_RATE | rate of ENCODER_OFFSET with the screw's temperature | m/s |
| SLOPE_RATE | rate of ENCODER_SLOPE, the same | 1/s |
| CLOCK_SKEW | delay of the linear encoder against the rotary one | s |
| NUT_COMPLIANCE | compliance of the fresh nut; considered | m/N |
| TABLE_MASS | error of the mass behind the commissioned compliance, as a share; considered | - |
| LOOSENESS | compliance of coupling, bearings and screw beyond commissioning | m/N |
| REVERSAL | change of the stretch at a reversal, as a share of what the guide made it | - |
| STRETCH_WANDER | difference of the encoders that wanders along the way | m |
| MAP, MAP + 1, ... | coefficients of cos(j pi x / stroke), j = 2, 3, ...: uneven growth | m |

A considered quantity has a variance that widens the answer (Schmidt's filter), but the data do not
change it: no recording of a healthy axis can tell it, and a filter that tries to learn it lets a
wrong model look right.

The slots of the bank are the hypotheses:

| slot | hypothesis |
|---|---|
| STEADY | the preload stays as it is |
| WEARING | the preload falls steadily |
| LOSS | step of the preload |
| TOTAL_LOSS | step of the preload to almost nothing |
| LUBRICATION | step of all friction |
| LOAD | another load on the table |
| LOOSENING | step of the compliance beside the nut |
| BEFORE | belief before the last such step was accepted |

Beside its hypotheses the bank carries moments:

| moment | meaning | unit |
|---|---|---|
| SINCE_SPAWN_S | motion since challengers were spawned | s |
| STOPPED_S | length of a stop after which load and lubricant are still to be challenged | s |
| LEARNING | 1 until the likeliest initial hypothesis is accepted | - |
| SURPRISE | normalised innovation squared of the leading hypothesis | - |
| FASTEST_RAD_S | fastest phase so far | rad/s |
| FORCED_S | motion for which a process force has lasted | s |
| INERTIA_ERROR | sum over half a minute of J a times the error of the torque | (N m)^2 s |
| INERTIA_TORQUE | the same of (J a)^2 | (N m)^2 s |
"""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ...messages.samples import Floats
from ...messages.stored import decoded, encoded

PRELOAD, WEAR_RATE = range(2)
NUT_FRICTION, BEARING_FRICTION, GUIDE_FRICTION, VISCOUS, GUIDE_VISCOUS = range(2, 7)
PAYLOAD, TORQUE_OFFSET, TORQUE_WANDER, SPEED_ERROR_START, SPEED_ERROR_END = range(7, 12)
TORQUE_STATES = 12
ENCODER_OFFSET, ENCODER_SLOPE, OFFSET_RATE, SLOPE_RATE, CLOCK_SKEW = range(12, 17)
NUT_COMPLIANCE, TABLE_MASS, LOOSENESS, REVERSAL, STRETCH_WANDER = range(17, 22)
MAP = 22
MAP_STATES = 4
STRETCH_STATES = MAP + MAP_STATES

MOST_SHARE = 1.05
"""Bound on the preload over the fresh one: it is lost, never gained, except by heat."""

STEADY, WEARING, LOSS, TOTAL_LOSS, LUBRICATION, LOAD, LOOSENING, BEFORE = range(8)
HYPOTHESES = 8
CHALLENGERS = (LOSS, TOTAL_LOSS, LUBRICATION, LOAD, LOOSENING)
STOP_CHALLENGERS = (LUBRICATION, LOAD)
"""Steps that are likelier after a stop."""

SINCE_SPAWN_S, STOPPED_S, LEARNING, SURPRISE, FASTEST_RAD_S, FORCED_S = range(6)
INERTIA_ERROR, INERTIA_TORQUE = range(6, 8)
MOMENTS = 8


class AxisModel(NamedTuple):
    """Known parameters of the axis; SI units, preload in percent of the dynamic load rating."""

    ratio_m_per_rad: float
    inertia_kg_m2: float
    table_mass_kg: float
    drag_per_percent_nm: float
    fresh_percent: float
    fresh_preload_n: float
    clearance_share: float  # half clearance of a nut without preload, over its fresh deflection
    bearing_nm: float
    guide_n: float
    viscous_nm_s: float
    guide_viscous_n_s: float
    asymmetry_nm_s: float
    compliance_m_per_n: float  # at the reference position, fresh
    compliance_slope_per_n: float
    reference_m: float
    stribeck_nm: float
    stribeck_speed_rad_s: float
    stroke_m: float  # period of the stroke map
    stroke_map: Floats  # (k, 2) cosine and sine of the k-th harmonic of the preload
    map_sigma_m: Floats  # standard deviation of both maps below, the same
    lead_map_m: Floats  # at even nodes from 0 to the stroke
    wind_up_map_m: Floats  # the same, times the direction
    torque_density: float  # (N m)^2 s: variance of a mean over 1 s of fast motion
    torque_slow_rad_s: float  # motion as slow as this has twice that variance
    edge_rad2_s2: float  # variance of the speed's error at the border of two phases
    stretch_density: float  # m^2 s
    stretch_slow_rad_s: float


class Process(NamedTuple):
    """Process noise of the state, and events that may change it; see MixtureSettings.

    Variances per second unless said otherwise.
    """

    walk: Floats  # (n,), per second of time
    moving_walk: Floats  # (HYPOTHESES,), of PRELOAD per second of motion
    rate_walk: float  # of WEAR_RATE per second of motion
    wear_rate_per_s: float  # standard deviation with which wear begins
    together: float  # of the five frictions alike
    friction_keep_s: float  # time constant with which friction returns to what was commissioned
    torque_wander_nm: float  # standard deviation
    torque_wander_s: float
    stretch_wander_m: float
    stretch_wander_way_m: float
    uneven_share: float  # of the screw's growth since commissioning that wanders with it
    axial_n: float  # standard deviation of axial friction from phase to phase
    loose_m: float  # clearance of a nut without preload
    growth_s: float  # time constant of a warming screw
    jumps: Floats  # (HYPOTHESES, n, n), covariance that a step adds
    priors: Floats  # (HYPOTHESES,), log-probability of a step per second of motion
    stop_priors: Floats  # (HYPOTHESES,), the same per second of a stop
    lost_log_percent: float  # ln of the preload of a total loss, in percent
    lost_sigma: float
    loosened_m_per_n: float  # mean of a loosening
    wearing_log_weight: float
    evidence: float  # share of a phase's log-likelihood that counts
    most_nats: float  # most that one phase says against a hypothesis
    force_n: float  # standard deviation of process forces
    force_error: float  # error of their compliance, as a share
    force_share: float  # of phases in which a force begins
    rapid_share: float  # the same above half of the fastest motion
    force_stay: float  # probability that it lasts for another phase
    floor: float  # least log-weight of a hypothesis: none dies
    spawn_s: float
    learn_s: float
    confirm_s: float
    margin: float


class Reading(NamedTuple):
    """One phase as measured; `stretch_m` is NaN without a linear encoder that is believed."""

    steady_s: float
    direction: float
    torque_nm: float
    acceleration_rad_s2: float
    speed_rad_s: float
    table_m: float
    stretch_m: float
    follows: bool = False  # begins where the phase before has ended


class Bank(NamedTuple):
    """The hypotheses of one axis, changed in place."""

    mean: Floats  # (HYPOTHESES, n)
    covariance: Floats  # (HYPOTHESES, n, n)
    log_weight: Floats  # (HYPOTHESES,)
    alive: npt.NDArray[np.int64]  # (HYPOTHESES,)
    age_s: Floats  # (HYPOTHESES,), motion since its step
    directions: npt.NDArray[np.int64]  # (HYPOTHESES,), 1 forward, 2 backward, 3 both seen since
    force: Floats  # (HYPOTHESES,), probability that a process force acts
    force_n: Floats  # (HYPOTHESES,), the force it would be, N
    moments: Floats  # (MOMENTS,)


def empty_bank(size: int) -> Bank:
    """Bank of states (size,) in which no hypothesis lives."""
    return Bank(
        np.zeros((HYPOTHESES, size)),
        np.zeros((HYPOTHESES, size, size)),
        np.full(HYPOTHESES, -np.inf),
        np.zeros(HYPOTHESES, dtype=np.int64),
        np.zeros(HYPOTHESES),
        np.zeros(HYPOTHESES, dtype=np.int64),
        np.zeros(HYPOTHESES),
        np.zeros(HYPOTHESES),
        np.zeros(MOMENTS),
    )


_LAYOUT = {
    name: value for name, value in globals().items() if name.isupper() and isinstance(value, int)
}
"""Meaning of each index of the state: another layout is another state."""


def bank_snapshot(bank: Bank) -> dict[str, Any]:
    """Every array as text."""
    arrays = {name: encoded(array) for name, array in bank._asdict().items()}
    return {"layout": dict(_LAYOUT), "size": bank.mean.shape[1], "arrays": arrays}


def restored_bank(snapshot: dict[str, Any], like: Bank) -> Bank:
    """The bank of a snapshot.

    Raises:
        ValueError: of another axis or version, or damaged.
    """
    size = like.mean.shape[1]
    if snapshot.get("layout") != _LAYOUT or snapshot.get("size") != size:
        found = snapshot.get("size")
        raise ValueError(f"the snapshot is of another axis or version: {found} states, not {size}")
    arrays = snapshot["arrays"]
    kept = {}
    for name, array in like._asdict().items():
        values = decoded(arrays[name], array.dtype)
        if values.size != array.size:
            raise ValueError(f"a damaged snapshot: {values.size} values of {name}")
        kept[name] = values.reshape(array.shape).copy()
    bank = Bank(**kept)
    _check(bank)
    return bank


def _check(bank: Bank) -> None:
    alive = bank.alive
    if not np.isin(alive, (0, 1)).all() or not alive.any():
        raise ValueError("a damaged snapshot: no hypothesis is left")
    rows = alive > 0
    numbers = (bank.log_weight[rows], bank.mean[rows], bank.covariance[rows], bank.age_s[rows])
    whole = (bank.force, bank.force_n, bank.moments)
    if not all(np.isfinite(array).all() for array in (*numbers, *whole)):
        raise ValueError("a damaged snapshot: it contains values that are not finite")
    if not np.isin(bank.directions, (0, 1, 2, 3)).all():
        raise ValueError("a damaged snapshot: a hypothesis without directions")
