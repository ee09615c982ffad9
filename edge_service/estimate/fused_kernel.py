"""One step of the fused estimator: a Gaussian mixture over what may have happened to an axis.

The state of every hypothesis is Gaussian; its elements are the indices below. A phase of steady
motion (messages.features.Phase) measures two quantities, with s the direction, x the table
position, a and v acceleration and speed of the motor::

    torque    (1 + e) u = (J + R^2 dM) a + D v + A |v|
                          + s (k m(x) p + R G + R r(x) + B + St(v)) + b
    stretch   R theta - x = g0 + g1 (x - x0) + map(x) + h(x) + s odd(x) + T R v
                            + (c0 + c1 (x - x0) - cn) F + 3 F0 cn y(F, m(x) p)
                            + s chi (c0 + c1 (x - x0)) k p / R - l [F < 0]
              F = (M + dM) R a + s (G + r(x)) + V R v

The first is the balance of momentum (4.3.4) with the screw's drag proportional to its preload
(4.3.6); the second is the series stiffness under a known inertia force, of which only the nut's
share y depends on the preload (5.3.1, 5.3.11; see nut_deflection). The functions run compiled;
their plain Python (`.py_func`) gives the same numbers.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..messages.samples import Floats
from ..models.compiled import compiled

PRELOAD, RATE, DRY, GUIDE, VISCOUS, ASYMMETRY, MASS = range(7)
GAP, GROWTH, SKEW, NUT, OFFSET, SLIDE = range(7, 13)
GAIN, GAP_RATE, GROWTH_RATE, PLAY = range(13, 17)
"""p %, dp/dt %/s, B N m, G N, D and A N m s/rad, dM kg; g0 m, g1, T s, cn m/N, b N m, V N s/m;
e, dg0/dt m/s, dg1/dt 1/s, l m. Behind them h, m, and then r, N, at even nodes of the stroke."""
STATES = 17
RUB_NODES = 9
"""Of r; h has the others."""
WIND_UP_SHARE = 0.3
"""Of the screw's drag, acts behind the axis' spring: R^2 over torsional and whole compliance."""
CAPACITY = 24
"""Most hypotheses that live at the same time."""

QUIET, WEARING, SETTLING = 0, 1, 2
"""Modes: preload wanders slowly, or runs at a rate, or friction settles after a change."""

_LEAST_LOG_WEIGHT = -13.0
_LEAST_BEGUN_LOG_WEIGHT = -25.0
_SURPRISE = 9.0
_OUTLIER = 20.0
_LEAST_PERCENT = 0.02
_LOOSE_PERCENT = 0.15
_SETTLING_S = 15.0
_WARMING_S = 300.0
_SETTLING_HASTE = 8.0
_SETTLED_S = 4.0
_FORCE_ERROR = 0.05
FLOATING_N = 15.0
_DRIVEN_RAD_S2 = 100.0
_AFTER_FORCE_S = 0.3
_LARGE_FORCE_N = 100.0
_MERGE_DISTANCE = 0.25
_STRAIGHT = 0.05
_RELINEARISATIONS = 2


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


@compiled
def nut_deflection(load_n: float, percent: float, model: FusedModel) -> tuple[float, float, float]:
    """How far a preloaded pair of nuts yields, over the fresh pair's own preload deflection d0.

    Two opposed Hertz contacts, F = c ((q + y)^1.5 - (q - y)^1.5), with y = d / d0 and
    q = (p / p0)^(2/3); for small loads the stiffness is 3 F0 q^0.5 / d0, the cube root law of
    (5.3.11). Without preload the pair has a clearance, q < 0.

    Returns:
        y, dy/dF 1/N and dy/dp 1/%.
    """
    lost = model.clearance_share * math.exp(-max(percent, 0.0) / _LOOSE_PERCENT)
    share = max(percent, _LEAST_PERCENT) / model.fresh_percent
    q = math.pow(share, 2.0 / 3.0) - lost
    q_slope = 2.0 / 3.0 * math.pow(share, -1.0 / 3.0) / model.fresh_percent + lost / _LOOSE_PERCENT
    force = abs(load_n) / model.fresh_preload_n
    y = max(force / (3.0 * math.sqrt(max(q, 0.01))), 0.0)
    if q <= 0.0 or y > q:
        y = math.pow(force, 2.0 / 3.0) - q
    up, down = 0.0, 0.0
    for _ in range(4):
        up, down = math.sqrt(max(q + y, 1e-12)), math.sqrt(max(q - y, 0.0))
        y -= (up**3 - down**3 - force) / (1.5 * (up + down))
        y = max(y, -q, 0.0)
    up, down = math.sqrt(max(q + y, 1e-6)), math.sqrt(max(q - y, 0.0))
    sign = 1.0 if load_n >= 0.0 else -1.0
    by_force = 1.0 / (1.5 * (up + down) * model.fresh_preload_n)
    return sign * y, by_force, -sign * (up - down) / (up + down) * q_slope


@compiled
def stroke_factor(model: FusedModel, table_m: float) -> float:
    """m(x): preload at a place over its mean over the stroke."""
    factor = 1.0
    if math.isnan(table_m):
        return factor
    for k in range(model.stroke_map.shape[0]):
        phase = 2.0 * math.pi * (k + 1) * table_m / model.stroke_m
        factor += model.stroke_map[k, 0] * math.cos(phase)
        factor += model.stroke_map[k, 1] * math.sin(phase)
    return factor


@compiled
def mapped(nodes_m: Floats, stroke_m: float, table_m: float) -> float:
    """Value at a place of a broken line with even nodes from 0 to the stroke, m."""
    left, share = _between(nodes_m.shape[0], stroke_m, table_m)
    if left < 0:
        return 0.0
    return float((1.0 - share) * nodes_m[left] + share * nodes_m[left + 1])


@compiled
def _between(count: int, stroke_m: float, table_m: float) -> tuple[int, float]:
    """The node before a place and the share of the one behind; -1 without nodes or place."""
    if count < 2 or math.isnan(table_m):
        return -1, 0.0
    place = min(max(table_m / stroke_m, 0.0), 1.0) * (count - 1)
    left = min(int(place), count - 2)
    return left, place - left


@compiled
def predict_torque(model: FusedModel, x: Floats, r: Reading, slope: Floats) -> float:
    """Torque of a phase, N m, and its derivatives by the state into `slope` (n,)."""
    ratio = model.ratio_m_per_rad
    per_percent = model.drag_per_percent_nm * stroke_factor(model, r.table_m)
    slope[:] = 0.0
    slope[PRELOAD] = r.direction * per_percent
    slope[DRY] = r.direction
    slope[GUIDE] = r.direction * ratio
    slope[VISCOUS] = r.speed_rad_s
    slope[ASYMMETRY] = abs(r.speed_rad_s)
    slope[MASS] = ratio * ratio * r.acceleration_rad_s2
    slope[OFFSET] = 1.0
    slope[GAIN] = -r.torque_nm
    near = near_nodes(x, model, r)
    if near.rub >= 0:
        slope[near.rub] = r.direction * ratio * (1.0 - near.rub_share)
        slope[near.rub + 1] = r.direction * ratio * near.rub_share
    known = model.inertia_kg_m2 * r.acceleration_rad_s2 + r.direction * stribeck(model, r)
    return known + float(np.dot(slope, x))


@compiled
def stribeck(model: FusedModel, r: Reading) -> float:
    """St(v): excess of the friction at slow motion, N m."""
    if model.stribeck_nm == 0.0:
        return 0.0
    return model.stribeck_nm * math.exp(-abs(r.speed_rad_s) / model.stribeck_speed_rad_s)


@compiled
def predict_stretch(model: FusedModel, x: Floats, r: Reading, slope: Floats) -> tuple[float, float]:
    """Stretch of a phase, m, and the compliance there, m/N; derivatives into `slope`."""
    away = r.table_m - model.reference_m
    local = stroke_factor(model, r.table_m)
    gear = model.ratio_m_per_rad * r.acceleration_rad_s2
    speed = model.ratio_m_per_rad * r.speed_rad_s
    load = table_load(model, x, r)
    wound_n = r.direction * WIND_UP_SHARE * model.drag_per_percent_nm / model.ratio_m_per_rad
    y, by_force, by_percent = nut_deflection(load, x[PRELOAD] * local, model)
    nut_m = 3.0 * model.fresh_preload_n
    rest = model.compliance_m_per_n + model.compliance_slope_per_n * away - x[NUT]
    rest = max(rest, 1e-12)
    compliance = rest + nut_m * x[NUT] * by_force
    slope[:] = 0.0
    slope[GAP] = 1.0
    slope[GROWTH] = away
    slope[SKEW] = speed
    slope[SLIDE] = compliance * speed
    slope[GUIDE] = compliance * r.direction
    slope[MASS] = compliance * gear
    slope[NUT] = nut_m * y - load
    series = model.compliance_m_per_n + model.compliance_slope_per_n * away
    slope[PRELOAD] = nut_m * x[NUT] * by_percent * local + series * wound_n
    value = series * wound_n * x[PRELOAD]
    value += x[GAP] + x[GROWTH] * away + x[SKEW] * speed + rest * load + nut_m * x[NUT] * y
    value += mapped(model.lead_map_m, model.stroke_m, r.table_m)
    value += r.direction * mapped(model.wind_up_map_m, model.stroke_m, r.table_m)
    slope[PLAY] = -carried_back(load)
    value += slope[PLAY] * x[PLAY]
    near = near_nodes(x, model, r)
    if near.growth >= 0:
        i, share = near.growth, near.growth_share
        slope[i], slope[i + 1] = 1.0 - share, share
        value += (1.0 - share) * x[i] + share * x[i + 1]
        slope[near.rub] = slope[GUIDE] * (1.0 - near.rub_share)
        slope[near.rub + 1] = slope[GUIDE] * near.rub_share
    return value, compliance


@compiled
def table_load(model: FusedModel, x: Floats, r: Reading) -> float:
    """F, N."""
    near = near_nodes(x, model, r)
    rubbing = x[GUIDE]
    if near.rub >= 0:
        rubbing += (1.0 - near.rub_share) * x[near.rub] + near.rub_share * x[near.rub + 1]
    gear = model.ratio_m_per_rad * r.acceleration_rad_s2
    speed = model.ratio_m_per_rad * r.speed_rad_s
    return float((model.table_mass_kg + x[MASS]) * gear + r.direction * rubbing + x[SLIDE] * speed)


@compiled
def carried_back(load_n: float) -> float:
    """[F < 0]; a half where hardly any force says which flank carries."""
    if abs(load_n) < FLOATING_N:
        return 0.5
    return 1.0 if load_n < 0.0 else 0.0


class NearNodes(NamedTuple):
    """Indices of the nodes before a place, -1 without any, and shares of those behind."""

    growth: int
    growth_share: float
    rub: int
    rub_share: float


@compiled
def near_nodes(x: Floats, model: FusedModel, r: Reading) -> NearNodes:
    """Where in the state a phase's nodes are."""
    count = x.shape[0] - STATES - RUB_NODES
    left, share = _between(count, model.stroke_m, r.table_m)
    if left < 0:
        return NearNodes(-1, 0.0, -1, 0.0)
    rub, rub_share = _between(RUB_NODES, model.stroke_m, r.table_m)
    return NearNodes(STATES + left, share, STATES + count + rub, rub_share)


@compiled
def predict_state(mixture: Mixture, k: int, drift: Drift, elapsed_s: float, moved_s: float) -> None:
    """Let a hypothesis drift over `elapsed_s`, of which the axis moved for `moved_s`."""
    x, p = mixture.mean[k], mixture.covariance[k]
    mixture.age_s[k] += moved_s
    if mixture.mode[k] == SETTLING and mixture.age_s[k] > _SETTLING_S:
        mixture.mode[k] = QUIET
    haste = 1.0
    if mixture.mode[k] == SETTLING:
        haste += _SETTLING_HASTE * math.exp(-mixture.age_s[k] / _SETTLED_S)
    p[STATES:, STATES:] += elapsed_s * drift.uneven
    for i in range(STATES):
        time_s = moved_s if drift.moving[i] else elapsed_s
        walk = drift.walk[i]
        if i in (DRY, GUIDE, VISCOUS, SLIDE):
            walk *= haste
        p[i, i] += walk * walk * time_s
    lasting = math.exp(-elapsed_s / _WARMING_S)
    _run(x, p, GAP, GAP_RATE, _WARMING_S * (1.0 - lasting), lasting)
    _run(x, p, GROWTH, GROWTH_RATE, _WARMING_S * (1.0 - lasting), lasting)
    if mixture.mode[k] == WEARING:
        _run(x, p, PRELOAD, RATE, moved_s, 1.0)
        p[RATE, RATE] += drift.rate_walk**2 * moved_s


@compiled
def _run(x: Floats, p: Floats, i: int, rate: int, time_s: float, lasting: float) -> None:
    """Let x[i] run at x[rate] for a time, after which a share of the rate is left."""
    x[i] += x[rate] * time_s
    for j in range(x.shape[0]):
        p[i, j] += time_s * p[rate, j]
    for j in range(x.shape[0]):
        p[j, i] += time_s * p[j, rate]
    if lasting != 1.0:
        x[rate] *= lasting
        for j in range(x.shape[0]):
            p[rate, j] *= lasting
        for j in range(x.shape[0]):
            p[j, rate] *= lasting


@compiled
def _innovate(
    model: FusedModel, x: Floats, at: Floats, p: Floats, r: Reading, told: Innovation
) -> float:
    """Fill `told`; `at` is the state around which the stretch is linear.

    Returns the compliance, m/N.
    """
    slopes, gains, e, s = told.slopes, told.gains, told.error, told.covariance
    e[0] = r.torque_nm - predict_torque(model, x, r, slopes[0])
    compliance = 0.0
    e[1] = 0.0
    slopes[1, :] = 0.0
    floating_m = 0.0
    if not math.isnan(r.stretch_m):
        predicted, compliance = predict_stretch(model, at, r, slopes[1])
        e[1] = r.stretch_m - predicted
        if slopes[1, PLAY] == -0.5:
            floating_m = 0.5 * at[PLAY]
    near = near_nodes(x, model, r)
    gains[:] = 0.0
    _weigh(0, STATES, x, at, p, told)
    if near.growth >= 0:
        _weigh(near.growth, near.growth + 2, x, at, p, told)
        _weigh(near.rub, near.rub + 2, x, at, p, told)
    for i in range(2):
        for j in range(2):
            s[i, j] = np.dot(slopes[i], gains[j])
    speed = max(abs(r.speed_rad_s), 1e-3)
    s[0, 0] += (
        model.torque_density * (1.0 + (model.torque_slow_rad_s / speed) ** 2) / r.steady_s
        + (0.3 * stribeck(model, r)) ** 2
    )
    s[1, 1] += model.stretch_density * (1.0 + (model.stretch_slow_rad_s / speed) ** 2) / r.steady_s
    s[1, 1] += floating_m * floating_m
    return compliance


@compiled
def _weigh(first: int, end: int, x: Floats, at: Floats, p: Floats, told: Innovation) -> None:
    """Add those states' part of P H' and of the way from where the stretch is linear."""
    for m in range(first, end):
        told.error[1] -= told.slopes[1, m] * (x[m] - at[m])
        for i in range(2):
            if told.slopes[i, m] != 0.0:
                for j in range(x.shape[0]):
                    told.gains[i, j] += told.slopes[i, m] * p[m, j]


@compiled
def _innovate_well(model: FusedModel, x: Floats, p: Floats, r: Reading, told: Innovation) -> float:
    """The same around where the correction leads, if the preload is too uncertain for one step."""
    at = x.copy()
    c = _innovate(model, x, at, p, r, told)
    if math.isnan(r.stretch_m) or p[PRELOAD, PRELOAD] < (_STRAIGHT * max(x[PRELOAD], 1.0)) ** 2:
        return c
    e, s = told.error, told.covariance
    for _ in range(_RELINEARISATIONS):
        det = max(s[0, 0] * s[1, 1] - s[0, 1] * s[0, 1], 1e-300)
        a = (s[1, 1] * e[0] - s[0, 1] * e[1]) / det
        b = (s[0, 0] * e[1] - s[0, 1] * e[0]) / det
        for i in range(x.shape[0]):
            at[i] = x[i] + told.gains[0, i] * a + told.gains[1, i] * b
        at[PRELOAD] = max(at[PRELOAD], _LEAST_PERCENT)
        c = _innovate(model, x, at, p, r, told)
    return c


@compiled
def _likelihood(e: Floats, s: Floats, two: bool) -> tuple[float, float]:
    """Log-likelihood and normalised innovation squared."""
    if not two:
        nis = e[0] * e[0] / s[0, 0]
        return -0.5 * (nis + math.log(2.0 * math.pi * s[0, 0])), nis
    det = max(s[0, 0] * s[1, 1] - s[0, 1] * s[0, 1], 1e-300)
    nis = (s[1, 1] * e[0] * e[0] - 2.0 * s[0, 1] * e[0] * e[1] + s[0, 0] * e[1] * e[1]) / det
    return -0.5 * (nis + math.log(4.0 * math.pi**2 * det)), nis


@compiled
def _force_seen(e: Floats, s: Floats, ratio: float, compliance: float, two: bool) -> float:
    """The force on the table that explains the innovation best, N."""
    if not two:
        return float(e[0] / ratio)
    det = max(s[0, 0] * s[1, 1] - s[0, 1] * s[0, 1], 1e-300)
    a = (s[1, 1] * ratio - s[0, 1] * compliance) / det
    b = (s[0, 0] * compliance - s[0, 1] * ratio) / det
    return float((a * e[0] + b * e[1]) / (a * ratio + b * compliance))


@compiled
def _under_force(
    e: Floats, s: Floats, ratio: float, compliance: float, force_n: float, two: bool
) -> tuple[float, float]:
    """Log-likelihood with a process force of sigma `force_n`, and the force seen, N.

    The nut is no linear spring under a large force, hence a share of the compliance as error.
    """
    seen = _force_seen(e, s, ratio, compliance, two)
    var = force_n * force_n
    forced = s.copy()
    forced[0, 0] += var * ratio * ratio + (_FORCE_ERROR * ratio * seen) ** 2
    forced[1, 1] += var * compliance * compliance + (_FORCE_ERROR * compliance * seen) ** 2
    forced[0, 1] += var * ratio * compliance
    forced[1, 0] = forced[0, 1]
    log_likelihood, _ = _likelihood(e, forced, two)
    return log_likelihood, seen


@compiled
def _correct(mixture: Mixture, k: int, told: Innovation, scale: float, two: bool) -> None:
    """Kalman correction of hypothesis k; `scale` widens the innovation of an outlier."""
    x, p = mixture.mean[k], mixture.covariance[k]
    gains, e, s = told.gains, told.error, told.covariance
    s00, s11, s01 = s[0, 0] * scale, s[1, 1] * scale, s[0, 1] * scale
    det = max(s00 * s11 - s01 * s01, 1e-300)
    i00, i11, i01 = s11 / det, s00 / det, -s01 / det
    if not two:
        i00, i11, i01 = 1.0 / s00, 0.0, 0.0
    for i in range(x.shape[0]):
        k0 = gains[0, i] * i00 + gains[1, i] * i01
        k1 = gains[0, i] * i01 + gains[1, i] * i11
        x[i] += k0 * e[0] + k1 * e[1]
        for j in range(x.shape[0]):
            p[i, j] -= k0 * gains[0, j] + k1 * gains[1, j]


@compiled
def _spawn(
    mixture: Mixture, parent: int, drift: Drift, motion_s: float, payload_only: bool
) -> None:
    """Children of a hypothesis, one for each kind of jump; the least likely make room."""
    for j in range(drift.hazards.shape[0]):
        if payload_only and drift.jumps[j, MASS, MASS] == 0.0:
            continue
        log_weight = mixture.log_weight[parent] + math.log(max(drift.hazards[j] * motion_s, 1e-300))
        k = mixture.alive[0]
        if k == CAPACITY:
            k = int(np.argmin(mixture.log_weight))
            if k == parent or mixture.log_weight[k] >= log_weight:
                continue
        else:
            mixture.alive[0] += 1
        mixture.log_weight[k] = log_weight
        mixture.mode[k] = drift.modes[j]
        mixture.kind[k] = j
        mixture.age_s[k] = 0.0
        mixture.force[k] = 0.0
        mixture.mean[k] = mixture.mean[parent] + drift.shifts[j]
        if drift.shifts[j, PRELOAD] < 0.0:
            mixture.mean[k, PRELOAD] = max(mixture.mean[k, PRELOAD], _LEAST_PERCENT)
        mixture.covariance[k] = mixture.covariance[parent] + drift.jumps[j]


@compiled
def _leader(mixture: Mixture) -> int:
    return int(np.argmax(mixture.log_weight[: mixture.alive[0]]))


@compiled
def tidy(mixture: Mixture) -> None:
    """Scale the weights to 1, drop the hopeless, merge those that have become alike."""
    count = mixture.alive[0]
    top = mixture.log_weight[:count].max()
    total = 0.0
    for k in range(count):
        total += math.exp(mixture.log_weight[k] - top)
    shift = top + math.log(total)
    kept = 0
    for k in range(count):
        mixture.log_weight[k] -= shift
        least = _LEAST_BEGUN_LOG_WEIGHT if mixture.kind[k] < 0 else _LEAST_LOG_WEIGHT
        if mixture.log_weight[k] < least:
            continue
        _move(mixture, k, kept)
        kept += 1
    mixture.alive[0] = kept
    mixture.log_weight[kept:] = -math.inf
    k = 0
    while k < mixture.alive[0]:
        j = k + 1
        while j < mixture.alive[0]:
            if mixture.mode[k] == mixture.mode[j] and _alike(mixture, k, j):
                _merge(mixture, k, j)
            else:
                j += 1
        k += 1


@compiled
def _move(mixture: Mixture, source: int, target: int) -> None:
    if source != target:
        mixture.log_weight[target] = mixture.log_weight[source]
        mixture.mode[target] = mixture.mode[source]
        mixture.kind[target] = mixture.kind[source]
        mixture.age_s[target] = mixture.age_s[source]
        mixture.force[target] = mixture.force[source]
        mixture.mean[target] = mixture.mean[source]
        mixture.covariance[target] = mixture.covariance[source]


@compiled
def _alike(mixture: Mixture, k: int, j: int) -> bool:
    for i in (PRELOAD, DRY, GUIDE, MASS):
        vk, vj = mixture.covariance[k, i, i], mixture.covariance[j, i, i]
        least, most = min(vk, vj), max(vk, vj)
        away = mixture.mean[k, i] - mixture.mean[j, i]
        if away * away > _MERGE_DISTANCE * least or most > 1.5 * least:
            return False
    return True


@compiled
def _merge(mixture: Mixture, k: int, j: int) -> None:
    """Moment-match j into k and close the row."""
    wk, wj = math.exp(mixture.log_weight[k]), math.exp(mixture.log_weight[j])
    share = wj / (wk + wj)
    away = mixture.mean[j] - mixture.mean[k]
    mixture.mean[k] += share * away
    mixture.covariance[k] *= 1.0 - share
    mixture.covariance[k] += share * mixture.covariance[j]
    mixture.covariance[k] += share * (1.0 - share) * np.outer(away, away)
    mixture.log_weight[k] = math.log(wk + wj)
    last = mixture.alive[0] - 1
    _move(mixture, last, j)
    mixture.log_weight[last] = -math.inf
    mixture.alive[0] = last


@compiled
def take(
    mixture: Mixture,
    model: FusedModel,
    drift: Drift,
    r: Reading,
    elapsed_s: float,
    spawn: bool,
) -> float:
    """Take one phase.

    Args:
        mixture: changed in place.
        elapsed_s: since the phase before.
        spawn: whether jumps are considered even without a surprise.

    Returns:
        Normalised innovation squared per quantity of the leading hypothesis; about 1 is expected.
        NaN if it takes the phase for one under a process force, which teaches nothing.
    """
    ratio = model.ratio_m_per_rad
    two = not math.isnan(r.stretch_m)
    size = mixture.mean.shape[1]
    e, s = np.empty(2), np.empty((2, 2))
    told = Innovation(np.empty((2, size)), np.empty((2, size)), e, s)
    for k in range(mixture.alive[0]):
        predict_state(mixture, k, drift, elapsed_s, r.steady_s)
    leader = _leader(mixture)
    c = _innovate_well(model, mixture.mean[leader], mixture.covariance[leader], r, told)
    calm, surprise = _likelihood(e, s, two)
    leading, seen_n = _under_force(e, s, ratio, c, model.process_force_n, two)
    large = leading > calm and abs(seen_n) > _LARGE_FORCE_N
    mixture.since_force_s[0] = 0.0 if large else mixture.since_force_s[0] + r.steady_s
    motion_s = max(r.steady_s, 0.1)
    if large:
        if abs(r.acceleration_rad_s2) > _DRIVEN_RAD_S2 and mixture.force[leader] < 0.5:
            _spawn(mixture, leader, drift, motion_s, True)
    elif (spawn or surprise > _SURPRISE) and mixture.since_force_s[0] > _AFTER_FORCE_S:
        _spawn(mixture, leader, drift, motion_s, False)
    dimension = 2.0 if two else 1.0
    best_nis, best_weight = math.nan, -math.inf
    for k in range(mixture.alive[0]):
        _innovate_well(model, mixture.mean[k], mixture.covariance[k], r, told)
        calm, nis = _likelihood(e, s, two)
        scale = max(1.0, nis / _OUTLIER)
        if scale > 1.0:
            calm -= 0.5 * _OUTLIER * (1.0 + math.log(scale)) - 0.5 * nis
        before = mixture.force[k]
        acting = before * drift.force_stay + (1.0 - before) * drift.force_hazard
        calm += math.log(1.0 - acting)
        forced = leading + math.log(acting)
        top = max(calm, forced)
        both = top + math.log(math.exp(calm - top) + math.exp(forced - top))
        mixture.force[k] = math.exp(forced - both)
        mixture.log_weight[k] += both
        acts = forced > calm or (large and mixture.age_s[k] > r.steady_s)
        if large and acts:
            mixture.log_weight[k] += forced - both
        if not acts:
            _correct(mixture, k, told, scale, two)
        if mixture.log_weight[k] > best_weight:
            best_weight = mixture.log_weight[k]
            best_nis = math.nan if acts else nis / dimension
    tidy(mixture)
    return best_nis
