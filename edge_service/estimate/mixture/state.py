"""State of the axis, slots of the hypotheses, and the arrays that hold both.

A hypothesis estimates the quantities below, torque's first: an axis with one encoder has
TORQUE_STATES of them. Changes of frictions are shares of what was commissioned. NUT_COMPLIANCE is
considered (Friedland's two stages): its variance widens the answer, but the data do not move it,
for no recording of a healthy axis can tell it, and a filter that learns it lets a wrong model look
right.
"""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ...messages.samples import Floats
from ...messages.stored import decoded, encoded

PRELOAD, WEAR_RATE = range(2)  # ln of percent of the load rating; its growth per s of motion
NUT_FRICTION, BEARING_FRICTION, GUIDE_FRICTION, VISCOUS, GUIDE_VISCOUS = range(2, 7)
PAYLOAD, TORQUE_OFFSET, TORQUE_WANDER, SPEED_ERROR_START, SPEED_ERROR_END = range(7, 12)
TORQUE_SCALE = 12
"""Mass beyond commissioning, kg; gravity with the amplifier's offset, and friction that wanders
along the way, N m; error of the speed at both ends of the phase, rad/s; torque that is read beyond
what acts, a share: the torque constant falls as the motor warms."""
TORQUE_STATES = 13
ENCODER_OFFSET, ENCODER_SLOPE, OFFSET_RATE, SLOPE_RATE, CLOCK_SKEW = range(13, 18)
"""Travel by the motor less that of the table at the reference, m, and along the stroke; rates of
both with the screw's temperature, per s; delay of the linear encoder, s."""
NUT_COMPLIANCE, TABLE_MASS, LOOSENESS, COUPLING, REVERSAL, STRETCH_WANDER = range(18, 24)
"""Of the fresh nut, m/N; error of the mass behind the commissioned compliance, a share; compliance
beyond commissioning of bearing or belt, and of the coupling, which twists under the drag too, m/N;
change of the stretch at a reversal, a share of what the guide made it; difference of the encoders
that wanders along the way, m."""
MAP = 24  # the first coefficient of cos(j pi x / stroke), j = 2, 3, ...: uneven growth, m
MAP_STATES = 4
STRETCH_STATES = MAP + MAP_STATES

MOST_SHARE = 1.05
"""Bound on the preload over the fresh one: it is lost, never gained, except by heat."""

STEADY, WEARING, LOSS, TOTAL_LOSS, LUBRICATION, LOAD, LOOSENING, LARGE_LOOSENING, BEFORE = range(9)
"""The preload stays, or falls steadily; steps of the preload, of it to almost nothing, of all
friction, of the load, of the compliance by little and by much; the belief before the last step."""
HYPOTHESES = 9
CHALLENGERS = (LOSS, TOTAL_LOSS, LUBRICATION, LOAD, LOOSENING, LARGE_LOOSENING)
STOP_CHALLENGERS = (LUBRICATION, LOAD)
"""Steps that are likelier after a stop."""

SINCE_SPAWN_S, STOPPED_S, LEARNING, SURPRISE, FASTEST_RAD_S, FORCED_S = range(6)
"""Motion since challengers were spawned; a stop that is still to be challenged; 1 until the
likeliest initial hypothesis is accepted; innovation squared of the leader; fastest phase so far;
motion for which a process force has lasted."""
INERTIA_ERROR, INERTIA_TORQUE = range(6, 8)
"""Sums of half a minute: J a times the torque beyond J a and friction; (J a)^2, (N m)^2 s."""
RAPID_S, RAPID_FORCED_S = range(8, 10)
"""Rapid motion lately, and how much of it was taken for one under a process force."""
BELIEVED_FORCED_S, PAST_FORCED_S = range(10, 12)
"""Motion for which a force has acted, and under forces that have ended, by what is accepted."""
MOMENTS = 12


class AxisModel(NamedTuple):
    """Known parameters of the axis; SI units, preload in percent of the dynamic load rating."""

    ratio_m_per_rad: float
    inertia_kg_m2: float
    table_mass_kg: float
    drag_per_percent_nm: float
    fresh_percent: float
    fresh_preload_n: float
    clearance_share: float  # half clearance of a nut without preload, over its fresh deflection
    hanging_n: float  # gravity of the table less its counterweight, which the screw holds
    hanging_deflection: float  # of the fresh nut under it, over its preload deflection
    bearing_nm: float
    guide_n: float
    viscous_nm_s: float
    guide_viscous_n_s: float
    screw_kg_m2: float  # beyond the coupling, which twists under it
    asymmetry_nm_s: float
    compliance_m_per_n: float  # at the reference position, fresh
    compliance_slope_per_n: float
    compliance_bow_per_n_m: float
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


class MixtureSettings(NamedTuple):
    """Assumed changes of an axis; shares are of the commissioned value, steps standard deviations.

    None of it is tied to one machine: forces and torques follow from the friction that
    commissioning found, lengths from its noise and compliance.
    """

    together: float = 0.10  # of all frictions alike, by lubrication and temperature
    apart: float = 0.07  # of each on its own
    warmth: float = 0.35  # most friction that warmth takes, with one encoder; any share as likely
    torque_scale: float = 0.01  # more is read, give or take as much: magnets lose .1 % per kelvin
    motor_s: float = 1800.0  # in which a motor warms
    payload: float = 0.003  # of the table's mass, where the load is the commissioned one
    friction_s: float = 600.0  # time in which friction returns to what was commissioned
    start_share: float = 1.25  # factor on it at the start of a session, another day's
    wander: float = 0.02  # friction that wanders along the way, over the Coulomb friction
    wander_s: float = 1.0  # for how long it is alike
    wander_m: float = 0.03  # over which way the stretch is
    axial: float = 0.022  # axial friction from phase to phase, over the Coulomb friction
    wear_walk: float = 0.06  # of ln(preload) per sqrt(s) of motion, wearing fast
    wear_rate: float = 1.5e-3  # of ln(preload) per s of motion
    steady_rate: float = 6e-4  # the same, where nothing was lost: a warm-up has a trend, too
    rate_walk: float = 1e-4  # its change per sqrt(s)
    wearing: float = 0.1  # probability of wearing fast at the start
    start: float = 0.08  # of ln(preload) at the start, of a fresh screw
    used: float = 0.4  # probability that an unknown share is lost then
    used_sigma: float = 0.3  # of ln(preload) in that case
    half: float = 0.2  # that half of it is
    none: float = 0.1  # that all is
    loaded: float = 0.3  # that the load is another
    loss: float = 0.5  # sizes of the steps
    lubricated: float = 0.15
    lubricated_apart: float = 0.08
    scale: float = 0.3
    load: float = 0.4
    zero: float = 0.3  # of the torque since the last session, over the Coulomb friction
    loosened: float = 0.15  # of each joint, over the compliance of the axis
    loosened_large: float = 0.5  # a broken element of a coupling, a slack belt
    loosening_s: float = 400.0  # in which a joint that loosens goes on by as much, as a belt does
    lost_sigma: float = 0.7  # of ln(preload) after a total loss
    hazard: float = 3e-5  # of each step per second of motion
    loosens: float = 10.0  # times as likely a looser joint: a vague preload would follow it first
    stop_hazard: float = 1e-3  # of lubrication and load per second of a stop
    reversal: float = 0.1  # of the stretch at a reversal, as the frictions change
    looseness: float = 0.001  # of the compliance beside the nut, at the start
    softer: float = 0.03  # probability that joints are looser then than at commissioning
    twist: float = 0.07  # of the mass behind the compliance, give or take as much: a screw twists
    uneven_m: float = 3e-6  # growth of a screw that is warm at the start; finer waves are smaller
    uneven_share: float = 0.01  # finer unevenness over the growth along the stroke
    growth_s: float = 300.0  # time constant of a warming screw
    evidence: float = 0.35  # share of a log-likelihood that counts: errors outlast a phase
    most_nats: float = 10.0  # most that one phase says against a hypothesis: it may be spoiled
    force: float = 0.2  # large process forces over the dynamic load rating
    force_small: float = 0.1  # small ones over large ones; each is as likely
    force_error: float = 0.1  # of their compliance
    force_share: float = 0.03  # of phases in which one begins
    rapid_share: float = 0.005  # the same of rapids
    force_stay: float = 0.88  # probability that it lasts for another phase
    floor: float = -14.0  # least log-weight of a hypothesis: none dies
    spawn_s: float = 3.0  # motion after which challengers begin anew
    learn_s: float = 10.0  # motion until the likeliest initial hypothesis is accepted
    doubt_s: float = 20.0  # motion under a force after which it is doubted again
    confirm_s: float = 8.0  # motion for which a challenger must have been seen
    margin: float = 2.0  # by which it must lead


ASSUMED = MixtureSettings()


class Process(NamedTuple):
    """Process noise of one axis, and events that may change it; variances unless said otherwise."""

    assumed: MixtureSettings
    walk: Floats  # (n,), per second of time
    together: float  # of the five frictions alike, per second
    torque_wander_nm: float  # standard deviation
    stretch_wander_m: float  # standard deviation
    axial_n: float  # standard deviation of axial friction from phase to phase
    loose_m: float  # clearance of a nut without preload
    mass_sigma: float  # standard deviation of TABLE_MASS as commissioned
    jumps: Floats  # (HYPOTHESES, n, n), covariance that a step adds
    priors: Floats  # (HYPOTHESES,), log-probability of a step per second of motion
    stop_priors: Floats  # (HYPOTHESES,), the same per second of a stop
    fresh_log_percent: float  # ln of the fresh preload, in percent
    loosened_m_per_n: Floats  # (HYPOTHESES,), mean of a loosening, of each joint
    force_n: float  # standard deviation of large process forces


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
    cost: Floats  # (HYPOTHESES,), log-weight that improbable frictions have cost
    moments: Floats  # (MOMENTS,)


def empty_bank(size: int) -> Bank:
    """Bank of states (size,) in which no hypothesis lives."""
    mean, covariance = np.zeros((HYPOTHESES, size)), np.zeros((HYPOTHESES, size, size))
    alive, directions = np.zeros((2, HYPOTHESES), dtype=np.int64)
    age_s, force, force_n, cost = np.zeros((4, HYPOTHESES))
    weight, moments = np.full(HYPOTHESES, -np.inf), np.zeros(MOMENTS)
    return Bank(mean, covariance, weight, alive, age_s, directions, force, force_n, cost, moments)


_LAYOUT = {name: at for name, at in globals().items() if name.isupper() and isinstance(at, int)}
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
    whole = (bank.force, bank.force_n, bank.cost, bank.moments)
    if not all(np.isfinite(array).all() for array in (*numbers, *whole)):
        raise ValueError("a damaged snapshot: it contains values that are not finite")
    if not np.isin(bank.directions, (0, 1, 2, 3)).all():
        raise ValueError("a damaged snapshot: a hypothesis without directions")
