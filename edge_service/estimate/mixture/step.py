"""One phase of motion: every hypothesis drifts, is weighed with and without a process force, and
is corrected by what no force has spoiled.

The functions run compiled; their plain Python (`.py_func`) gives the same numbers.
"""

import math
from typing import NamedTuple

import numpy as np

from ...messages.samples import Floats
from ...models.compiled import compiled, inlined
from .hypotheses import follow_hypotheses, normalise
from .physics import expected_stretch, expected_torque, stribeck, stroke_factor
from .state import (
    ENCODER_OFFSET,
    ENCODER_SLOPE,
    FASTEST_RAD_S,
    FORCED_S,
    GUIDE_VISCOUS,
    INERTIA_ERROR,
    INERTIA_TORQUE,
    LOOSENESS,
    NUT_COMPLIANCE,
    NUT_FRICTION,
    OFFSET_RATE,
    PRELOAD,
    SLOPE_RATE,
    SPEED_ERROR_END,
    SPEED_ERROR_START,
    STRETCH_WANDER,
    SURPRISE,
    TORQUE_OFFSET,
    TORQUE_STATES,
    TORQUE_WANDER,
    WIND_UP,
    AxisModel,
    Bank,
    Process,
    Reading,
)

FORCED = 0.2
"""Probability of a process force above which a phase teaches nothing."""
_OUTLIER = 20.0
_STRAIGHT = 0.05
_FARTHEST = 1.5
_LEAST_PERCENT, _MOST_SHARE = 0.02, 1.3
_LEAST_FRICTION, _MOST_FRICTION = -0.7, 3.0
_LEAST_LOOSENESS = -0.01
_STRIBECK_ERROR = 0.3
_RAPID = 0.4
_INERTIA_S = 30.0


class Innovation(NamedTuple):
    """Of torque and stretch, in arrays to be filled again.

    `slopes` are H and `gains` P H', (2, n); `error` (2,) and `covariance` S (2, 2).
    """

    slopes: Floats
    gains: Floats
    error: Floats
    covariance: Floats
    at: Floats  # (n,), state around which the stretch is linear


class Noise(NamedTuple):
    """What a phase errs by, whatever the hypothesis says."""

    factor: float  # m(x)
    slow_nm: float  # St(v)
    torque_var: float
    stretch_var: float


@compiled
def take(
    bank: Bank, model: AxisModel, process: Process, reading: Reading, elapsed_s: float
) -> float:
    """Take one phase.

    Args:
        bank: changed in place.
        elapsed_s: since the phase before.

    Returns:
        Normalised innovation squared per quantity of the leading hypothesis; about 1 is expected.
        NaN if it takes the phase for one under a process force, which teaches nothing.
    """
    size = bank.mean.shape[1]
    two = size > TORQUE_STATES and not math.isnan(reading.stretch_m)
    room = Innovation(
        np.zeros((2, size)), np.zeros((2, size)), np.zeros(2), np.eye(2), np.zeros(size)
    )
    noise = _noise_of(model, reading)
    forced_before = _force_prior(bank, process, reading)
    leading, leader_nis, leader_force, leader_error = -math.inf, 0.0, 0.0, 0.0
    for k in range(bank.mean.shape[0]):
        if bank.alive[k] == 0:
            continue
        _drift(bank, k, model, process, reading, elapsed_s)
        compliance = _innovate(bank, k, model, process, reading, noise, two, room)
        error_nm = room.error[0]
        nis, forced = _learn(bank, k, model, process, forced_before, compliance, two, room)
        if bank.log_weight[k] > leading:
            leading, leader_nis, leader_force = bank.log_weight[k], nis, forced
            leader_error = error_nm
    normalise(bank, process.floor)
    _watch_inertia(bank, model, reading, leader_error)
    bank.force[0] = leader_force
    bank.moments[SURPRISE] = leader_nis
    follow_hypotheses(bank, process, reading, elapsed_s, leader_force <= FORCED)
    if leader_force > FORCED:
        bank.moments[FORCED_S] += reading.steady_s
        return math.nan
    bank.moments[FORCED_S] = 0.0
    return leader_nis / 2.0 if two else leader_nis


@inlined
def _watch_inertia(bank: Bank, model: AxisModel, r: Reading, error_nm: float) -> None:
    """Remember how far torque is from what acceleration takes, forces or not."""
    keep = math.exp(-r.steady_s / _INERTIA_S)
    inertia_nm = model.inertia_kg_m2 * r.acceleration_rad_s2
    bank.moments[INERTIA_ERROR] *= keep
    bank.moments[INERTIA_TORQUE] *= keep
    bank.moments[INERTIA_ERROR] += error_nm * inertia_nm * r.steady_s
    bank.moments[INERTIA_TORQUE] += inertia_nm * inertia_nm * r.steady_s


@inlined
def _noise_of(model: AxisModel, r: Reading) -> Noise:
    speed = max(abs(r.speed_rad_s), 1e-3)
    slow_nm = stribeck(model, r)
    torque = model.torque_density * (1.0 + (model.torque_slow_rad_s / speed) ** 2) / r.steady_s
    stretch = model.stretch_density * (1.0 + (model.stretch_slow_rad_s / speed) ** 2) / r.steady_s
    return Noise(
        stroke_factor(model, r.table_m),
        slow_nm,
        torque + (_STRIBECK_ERROR * slow_nm) ** 2,
        stretch,
    )


@inlined
def _force_prior(bank: Bank, process: Process, r: Reading) -> float:
    """Probability that a process force acts: it lasts, and hardly begins in a rapid."""
    speed = abs(r.speed_rad_s)
    fastest = max(bank.moments[FASTEST_RAD_S], speed)
    bank.moments[FASTEST_RAD_S] = fastest
    begins = process.rapid_share if speed > _RAPID * fastest else process.force_share
    return float(process.force_stay * bank.force[0] + (1.0 - bank.force[0]) * begins)


@inlined
def _drift(
    bank: Bank, k: int, model: AxisModel, process: Process, r: Reading, elapsed_s: float
) -> None:
    """Let a hypothesis drift over the time since the phase before."""
    x, p = bank.mean[k], bank.covariance[k]
    keep = math.exp(-elapsed_s / process.friction_keep_s)
    for i in range(NUT_FRICTION, GUIDE_VISCOUS + 1):
        _fade(x, p, i, keep)
    spread = process.together * (1.0 - keep * keep) / 2.0 * process.friction_keep_s
    for i in range(NUT_FRICTION, GUIDE_VISCOUS + 1):
        for j in range(NUT_FRICTION, GUIDE_VISCOUS + 1):
            p[i, j] += spread
    keep = math.exp(-r.steady_s / process.torque_wander_s)
    _fade(x, p, TORQUE_WANDER, keep)
    p[TORQUE_WANDER, TORQUE_WANDER] += process.torque_wander_nm**2 * (1.0 - keep * keep)
    if model.edge_rad2_s2 > 0.0:
        _pass_on(x, p, model.edge_rad2_s2, r.follows)
    if x.shape[0] > TORQUE_STATES:
        way_m = abs(r.speed_rad_s) * model.ratio_m_per_rad * r.steady_s
        keep = math.exp(-way_m / process.stretch_wander_way_m)
        _fade(x, p, STRETCH_WANDER, keep)
        p[STRETCH_WANDER, STRETCH_WANDER] += process.stretch_wander_m**2 * (1.0 - keep * keep)
        keep = math.exp(-elapsed_s / process.growth_s)
        grown_s = process.growth_s * (1.0 - keep)
        _grow(x, p, ENCODER_OFFSET, OFFSET_RATE, grown_s)
        _grow(x, p, ENCODER_SLOPE, SLOPE_RATE, grown_s)
        _fade(x, p, OFFSET_RATE, keep)
        _fade(x, p, SLOPE_RATE, keep)
    back_s = _settled_s(process.friction_keep_s, elapsed_s)
    for i in range(NUT_FRICTION, GUIDE_VISCOUS + 1):
        p[i, i] += process.walk[i] * back_s
    p[TORQUE_OFFSET, TORQUE_OFFSET] += process.walk[TORQUE_OFFSET] * back_s
    if x.shape[0] > TORQUE_STATES:
        warm_s = _settled_s(process.growth_s, elapsed_s)
        for i in range(TORQUE_STATES, x.shape[0]):
            p[i, i] += process.walk[i] * (r.steady_s if i == LOOSENESS else warm_s)
    p[PRELOAD, PRELOAD] += process.moving_walk[k] * r.steady_s


@inlined
def _settled_s(keep_s: float, elapsed_s: float) -> float:
    """Time whose noise a state holds that returns with a time constant, s: elapsed_s if short."""
    return 0.5 * keep_s * (1.0 - math.exp(-2.0 * elapsed_s / keep_s))


@inlined
def _fade(x: Floats, p: Floats, i: int, keep: float) -> None:
    """Let an element of the state return to zero by a factor."""
    x[i] *= keep
    for j in range(x.shape[0]):
        p[i, j] *= keep
    for j in range(x.shape[0]):
        p[j, i] *= keep


@inlined
def _grow(x: Floats, p: Floats, i: int, rate: int, time_s: float) -> None:
    """Let an element of the state run at its rate."""
    x[i] += time_s * x[rate]
    for j in range(x.shape[0]):
        p[i, j] += time_s * p[rate, j]
    for j in range(x.shape[0]):
        p[j, i] += time_s * p[j, rate]


@inlined
def _pass_on(x: Floats, p: Floats, edge_rad2_s2: float, follows: bool) -> None:
    """Begin a phase with the speed's error at the end of the one before, or with a new one."""
    first, last = SPEED_ERROR_START, SPEED_ERROR_END
    x[first] = x[last] if follows else 0.0
    x[last] = 0.0
    for j in range(x.shape[0]):
        p[first, j] = p[last, j] if follows else 0.0
    for j in range(x.shape[0]):
        p[j, first] = p[j, last] if follows else 0.0
    p[first, first] = p[last, last] if follows else edge_rad2_s2
    for j in range(x.shape[0]):
        p[last, j] = 0.0
        p[j, last] = 0.0
    p[last, last] = edge_rad2_s2


@inlined
def _innovate(
    bank: Bank,
    k: int,
    model: AxisModel,
    process: Process,
    r: Reading,
    noise: Noise,
    two: bool,
    room: Innovation,
) -> float:
    """Fill `room`; the compliance at the phase, m/N.

    The stretch is linear around where the correction leads, if the preload is too uncertain for
    one step. Axial friction that differs from phase to phase acts on torque and stretch alike.
    """
    x, p, at = bank.mean[k], bank.covariance[k], room.at
    size = x.shape[0]
    ratio = model.ratio_m_per_rad
    e, s = room.error, room.covariance
    axial = process.axial_n * process.axial_n
    compliance = 0.0
    for i in range(size):
        at[i] = x[i]
    straight = not two or p[PRELOAD, PRELOAD] < _STRAIGHT * _STRAIGHT
    for turn in range(1 if straight else 3):
        e[0] = r.torque_nm - expected_torque(
            model, at, r, noise.factor, noise.slow_nm, room.slopes[0]
        )
        s[0, 0] = noise.torque_var + axial * ratio * ratio
        s[1, 1], s[0, 1], e[1] = 1.0, 0.0, 0.0
        if two:
            stretch, compliance = expected_stretch(model, at, r, noise.factor, room.slopes[1])
            e[1] = r.stretch_m - stretch
            loose = process.loose_m * math.exp(-math.exp(at[PRELOAD]) / 0.3)
            s[1, 1] = noise.stretch_var + axial * compliance * compliance + loose * loose
            s[0, 1] = axial * ratio * compliance
        for i in range(size):
            away = x[i] - at[i]
            e[0] -= room.slopes[0, i] * away
            if two:
                e[1] -= room.slopes[1, i] * away
        _project(p, room.slopes[0], room.gains[0])
        s[0, 0] += _along(room.slopes[0], room.gains[0])
        if two:
            _project(p, room.slopes[1], room.gains[1])
            s[1, 1] += _along(room.slopes[1], room.gains[1])
            s[0, 1] += _along(room.slopes[1], room.gains[0])
        s[1, 0] = s[0, 1]
        if straight or turn == 2:
            break
        det = s[0, 0] * s[1, 1] - s[0, 1] * s[0, 1]
        a = (s[1, 1] * e[0] - s[0, 1] * e[1]) / det
        b = (s[0, 0] * e[1] - s[0, 1] * e[0]) / det
        for i in range(size):
            at[i] = x[i] + room.gains[0, i] * a + room.gains[1, i] * b
        at[PRELOAD] = min(max(at[PRELOAD], x[PRELOAD] - _FARTHEST), x[PRELOAD] + _FARTHEST)
    return compliance


@inlined
def _project(p: Floats, slope: Floats, gain: Floats) -> None:
    """P H' of one quantity, from the rows on which it depends."""
    for j in range(gain.shape[0]):
        gain[j] = 0.0
    for i in range(gain.shape[0]):
        weight = slope[i]
        if weight != 0.0:
            for j in range(gain.shape[0]):
                gain[j] += weight * p[i, j]


@inlined
def _along(slope: Floats, gain: Floats) -> float:
    total = 0.0
    for i in range(slope.shape[0]):
        total += slope[i] * gain[i]
    return total


@inlined
def _log_likelihood(e: Floats, uu: float, ss: float, us: float) -> tuple[float, float]:
    """Log-likelihood with tails that an outlier does not outrun, and the innovation squared."""
    det = uu * ss - us * us
    nis = (ss * e[0] * e[0] - 2.0 * us * e[0] * e[1] + uu * e[1] * e[1]) / det
    if nis > _OUTLIER:
        return -0.5 * (_OUTLIER * (1.0 + math.log(nis / _OUTLIER)) + math.log(det)), nis
    return -0.5 * (nis + math.log(det)), nis


@inlined
def _learn(
    bank: Bank,
    k: int,
    model: AxisModel,
    process: Process,
    forced_before: float,
    compliance: float,
    two: bool,
    room: Innovation,
) -> tuple[float, float]:
    """Weigh a hypothesis with and without a process force, and correct it unless one acts.

    A force F on the table shows as R F in the torque and as F times the compliance in the stretch.

    Returns:
        Innovation squared without a force, and the probability of one.
    """
    e, s = room.error, room.covariance
    ratio, force_var = model.ratio_m_per_rad, process.force_n * process.force_n
    uu, ss, us = s[0, 0], s[1, 1], s[0, 1]
    calm, nis = _log_likelihood(e, uu, ss, us)
    seen_n = e[0] / ratio
    if two:
        a, b = ss * ratio - us * compliance, uu * compliance - us * ratio
        seen_n = (a * e[0] + b * e[1]) / (a * ratio + b * compliance)
    doubt_m = process.force_error * seen_n * compliance
    extra_uu, extra_us = force_var * ratio * ratio, force_var * ratio * compliance
    extra_ss = force_var * compliance * compliance + doubt_m * doubt_m
    pushed, forced_nis = _log_likelihood(e, uu + extra_uu, ss + extra_ss, us + extra_us)
    calm += math.log(1.0 - forced_before)
    pushed += math.log(forced_before)
    top = max(calm, pushed)
    both = top + math.log(math.exp(calm - top) + math.exp(pushed - top))
    forced = math.exp(pushed - both)
    bank.log_weight[k] += process.evidence * both
    if forced <= FORCED:
        scale = (1.0 - forced) * max(1.0, nis / _OUTLIER)
        scale += forced * max(1.0, forced_nis / _OUTLIER)
        _correct(
            bank,
            k,
            model,
            scale * (uu + forced * extra_uu),
            scale * (ss + forced * extra_ss),
            scale * (us + forced * extra_us),
            two,
            room,
        )
    return nis, forced


@inlined
def _correct(
    bank: Bank,
    k: int,
    model: AxisModel,
    uu: float,
    ss: float,
    us: float,
    two: bool,
    room: Innovation,
) -> None:
    """Kalman correction with the innovation's covariance; what is considered stays as it was."""
    x, p = bank.mean[k], bank.covariance[k]
    size = x.shape[0]
    first, second, e = room.gains[0], room.gains[1], room.error
    left = math.sqrt(uu)
    step = e[0] / left
    below = us / left
    right = math.sqrt(ss - below * below)
    other = (e[1] - below * step) / right
    both = size > TORQUE_STATES
    kept = (x[NUT_COMPLIANCE], p[NUT_COMPLIANCE, NUT_COMPLIANCE]) if both else (0.0, 0.0)
    wound = (x[WIND_UP], p[WIND_UP, WIND_UP]) if both else (0.0, 0.0)
    shared = p[NUT_COMPLIANCE, WIND_UP] if both else 0.0
    for i in range(size):
        first[i] /= left
        x[i] += first[i] * step
    if two:
        for i in range(size):
            second[i] = (second[i] - below * first[i]) / right
            x[i] += second[i] * other
    for i in range(size):
        a, b = first[i], second[i] if two else 0.0
        if a == 0.0 and b == 0.0:
            continue
        if two:
            for j in range(size):
                p[i, j] -= a * first[j] + b * second[j]
        else:
            for j in range(size):
                p[i, j] -= a * first[j]
    if both:
        x[NUT_COMPLIANCE], p[NUT_COMPLIANCE, NUT_COMPLIANCE] = kept
        x[WIND_UP], p[WIND_UP, WIND_UP] = wound
        p[NUT_COMPLIANCE, WIND_UP] = shared
        p[WIND_UP, NUT_COMPLIANCE] = shared
        x[LOOSENESS] = max(x[LOOSENESS], _LEAST_LOOSENESS * model.compliance_m_per_n)
    most = math.log(_MOST_SHARE * model.fresh_percent)
    x[PRELOAD] = min(max(x[PRELOAD], math.log(_LEAST_PERCENT)), most)
    for i in range(NUT_FRICTION, GUIDE_VISCOUS + 1):
        x[i] = min(max(x[i], _LEAST_FRICTION), _MOST_FRICTION)
