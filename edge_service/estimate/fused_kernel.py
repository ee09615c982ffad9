"""One step of the fused estimator: a Gaussian mixture over what may have happened to an axis.

Every hypothesis is an extended Kalman filter (fused_state, fused_physics). The functions run
compiled; their plain Python (`.py_func`) gives the same numbers.
"""

import math

import numpy as np

from ..messages.samples import Floats
from ..models.compiled import compiled
from .fused_mixture import (
    leader_of,
    spawn_jumps,
    tidy,
)
from .fused_physics import (
    near_nodes,
    predict_stretch,
    predict_torque,
    stribeck,
)
from .fused_state import (
    BEGUN,
    DRY,
    ENDED,
    GAP,
    GAP_RATE,
    GROWTH,
    GROWTH_RATE,
    GUIDE,
    PLAY,
    PRELOAD,
    QUIET,
    RATE,
    SETTLING,
    SLIDE,
    STATES,
    VISCOUS,
    WEARING,
    Drift,
    FusedModel,
    Innovation,
    Mixture,
    Reading,
)

_SURPRISE = 9.0
_OUTLIER = 20.0
_LEAST_PERCENT = 0.02
_SETTLING_S = 15.0
_WARMING_S = 300.0
_SETTLING_HASTE = 8.0
_SETTLED_S = 4.0
_FORCE_ERROR = 0.05
_DRIVEN_RAD_S2 = 100.0
_AFTER_FORCE_S = 0.3
_LARGE_FORCE_N = 100.0
_STRAIGHT = 0.05
_RELINEARISATIONS = 2


@compiled
def predict_state(
    mixture: Mixture, k: int, model: FusedModel, drift: Drift, elapsed_s: float, r: Reading
) -> None:
    """Let a hypothesis drift over `elapsed_s`, in which the axis moved as in `r`."""
    moved_s = r.steady_s
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
    if model.edge_rad2_s2 > 0.0:
        _pass_on(x, p, model.edge_rad2_s2, r.follows)
    if mixture.mode[k] == WEARING:
        _run(x, p, PRELOAD, RATE, moved_s, 1.0)
        p[RATE, RATE] += drift.rate_walk**2 * moved_s


@compiled
def _pass_on(x: Floats, p: Floats, edge_rad2_s2: float, follows: bool) -> None:
    """Begin a phase with the speed's error at the end of the one before, or with a new one."""
    if follows:
        x[BEGUN] = x[ENDED]
        p[BEGUN, :] = p[ENDED, :]
        p[:, BEGUN] = p[:, ENDED]
        p[BEGUN, BEGUN] = p[ENDED, ENDED]
    else:
        x[BEGUN] = 0.0
        p[BEGUN, :] = 0.0
        p[:, BEGUN] = 0.0
        p[BEGUN, BEGUN] = edge_rad2_s2
    x[ENDED] = 0.0
    p[ENDED, :] = 0.0
    p[:, ENDED] = 0.0
    p[ENDED, ENDED] = edge_rad2_s2


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
        predict_state(mixture, k, model, drift, elapsed_s, r)
    leader = leader_of(mixture)
    c = _innovate_well(model, mixture.mean[leader], mixture.covariance[leader], r, told)
    calm, surprise = _likelihood(e, s, two)
    leading, seen_n = _under_force(e, s, ratio, c, model.process_force_n, two)
    large = leading > calm and abs(seen_n) > _LARGE_FORCE_N
    mixture.since_force_s[0] = 0.0 if large else mixture.since_force_s[0] + r.steady_s
    motion_s = max(r.steady_s, 0.1)
    if large:
        if abs(r.acceleration_rad_s2) > _DRIVEN_RAD_S2 and mixture.force[leader] < 0.5:
            spawn_jumps(mixture, leader, drift, motion_s, True)
    elif (spawn or surprise > _SURPRISE) and mixture.since_force_s[0] > _AFTER_FORCE_S:
        spawn_jumps(mixture, leader, drift, motion_s, False)
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
