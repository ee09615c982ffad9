"""One step of the fused estimator: a Gaussian mixture over what may have happened to an axis.

Every hypothesis is an extended Kalman filter (fused_state, fused_physics). The functions run
compiled; their plain Python (`.py_func`) gives the same numbers.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..messages.samples import Floats
from ..models.compiled import compiled, inlined
from .fused_mixture import (
    leader_of,
    spawn_jumps,
    tidy,
)
from .fused_physics import (
    NearNodes,
    Spot,
    flank_variance,
    predict_stretch,
    predict_torque,
    spot_of,
    turn_variance,
)
from .fused_predict import Step, predict_state, step_of
from .fused_state import (
    PLAY,
    PRELOAD,
    STATES,
    Drift,
    FusedModel,
    Innovation,
    Mixture,
    Reading,
)

_SURPRISE = 9.0
_OUTLIER = 20.0
_LEAST_PERCENT = 0.02
_FORCE_ERROR = 0.05
_DRIVEN_RAD_S2 = 100.0
_AFTER_FORCE_S = 0.3
_LARGE_FORCE_N = 100.0
_STRAIGHT = 0.05
_RELINEARISATIONS = 2


class _Room(NamedTuple):
    """Room for what `_innovate` works with."""

    at: Floats  # (n,), state around which the stretch is linear
    rows: npt.NDArray[np.int64]  # (n,), states on which a quantity depends


@inlined
def _innovate(
    model: FusedModel, x: Floats, p: Floats, r: Reading, spot: Spot, told: Innovation, room: _Room
) -> float:
    """Fill `told`. The stretch is linear around where the correction leads, if the preload is too
    uncertain for one step.

    Returns the compliance there, m/N.
    """
    told.error[0] = r.torque_nm - predict_torque(model, x, r, spot, told.slopes[0])
    count = _project(told.slopes[0], p, spot.near, room.rows, told.gains[0])
    speed = max(abs(r.speed_rad_s), 1e-3)
    told.covariance[0, 0] = (
        _along(room.rows, count, told.slopes[0], told.gains[0])
        + model.torque_density * (1.0 + (model.torque_slow_rad_s / speed) ** 2) / r.steady_s
        + (0.3 * spot.stribeck_nm) ** 2
    )
    at = room.at
    for i in range(x.shape[0]):
        at[i] = x[i]
    c = _stretch(model, x, p, r, spot, told, room)
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
        c = _stretch(model, x, p, r, spot, told, room)
    return c


@inlined
def _stretch(
    model: FusedModel,
    x: Floats,
    p: Floats,
    r: Reading,
    spot: Spot,
    told: Innovation,
    room: _Room,
) -> float:
    """Fill the stretch's part of `told`, linear around `room.at`; the compliance, m/N."""
    slope, gains, at, s = told.slopes[1], told.gains[1], room.at, told.covariance
    error_m, compliance, doubt_var = 0.0, 0.0, 0.0
    if math.isnan(r.stretch_m):
        for i in range(x.shape[0]):
            slope[i] = 0.0
    else:
        predicted, compliance = predict_stretch(model, at, r, spot, slope)
        error_m = r.stretch_m - predicted
        doubt_var = flank_variance(r, at[PLAY], p[PLAY, PLAY], -slope[PLAY])
        doubt_var += turn_variance(at, p, r)
    rows = room.rows
    count = _project(slope, p, spot.near, rows, gains)
    for i in range(count):
        m = rows[i]
        error_m -= slope[m] * (x[m] - at[m])
    told.error[1] = error_m
    speed = max(abs(r.speed_rad_s), 1e-3)
    s[0, 1] = _along(rows, count, slope, told.gains[0])
    s[1, 0] = s[0, 1]
    s[1, 1] = _along(rows, count, slope, gains) + doubt_var
    s[1, 1] += model.stretch_density * (1.0 + (model.stretch_slow_rad_s / speed) ** 2) / r.steady_s
    return compliance


@inlined
def _along(rows: npt.NDArray[np.int64], count: int, slope: Floats, gains: Floats) -> float:
    """H (P H'), of one quantity or of two."""
    total = 0.0
    for i in range(count):
        m = rows[i]
        total += slope[m] * gains[m]
    return total


@inlined
def _project(
    slope: Floats, p: Floats, near: NearNodes, rows: npt.NDArray[np.int64], gains: Floats
) -> int:
    """P H' of one quantity into `gains`; the states on which it depends, counted, in `rows`.

    No slope but the nearest nodes' is other than 0 along the stroke.
    """
    count = 0
    for m in range(STATES):
        if slope[m] != 0.0:
            rows[count] = m
            count += 1
    if near.growth >= 0:
        rows[count], rows[count + 1] = near.growth, near.growth + 1
        rows[count + 2], rows[count + 3] = near.rub, near.rub + 1
        count += 4
    _weigh(slope, p, rows, count, gains)
    return count


@inlined
def _weigh(
    slope: Floats, p: Floats, rows: npt.NDArray[np.int64], count: int, gains: Floats
) -> None:
    """The weighed sum of some rows, four at a time: each pass over `gains` costs as much."""
    for j in range(gains.shape[0]):
        gains[j] = 0.0
    whole = count - count % 4
    for m in range(0, whole, 4):
        a, b, c, d = rows[m], rows[m + 1], rows[m + 2], rows[m + 3]
        wa, wb, wc, wd = slope[a], slope[b], slope[c], slope[d]
        for j in range(gains.shape[0]):
            gains[j] += wa * p[a, j] + wb * p[b, j] + wc * p[c, j] + wd * p[d, j]
    for m in range(whole, count):
        a = rows[m]
        wa = slope[a]
        for j in range(gains.shape[0]):
            gains[j] += wa * p[a, j]


@inlined
def _likelihood(e: Floats, s: Floats, two: bool) -> tuple[float, float]:
    """Log-likelihood and normalised innovation squared."""
    if not two:
        nis = e[0] * e[0] / s[0, 0]
        return -0.5 * (nis + math.log(2.0 * math.pi * s[0, 0])), nis
    det = max(s[0, 0] * s[1, 1] - s[0, 1] * s[0, 1], 1e-300)
    nis = (s[1, 1] * e[0] * e[0] - 2.0 * s[0, 1] * e[0] * e[1] + s[0, 0] * e[1] * e[1]) / det
    return -0.5 * (nis + math.log(4.0 * math.pi**2 * det)), nis


@inlined
def _force_seen(e: Floats, s: Floats, ratio: float, compliance: float, two: bool) -> float:
    """The force on the table that explains the innovation best, N."""
    if not two:
        return float(e[0] / ratio)
    det = max(s[0, 0] * s[1, 1] - s[0, 1] * s[0, 1], 1e-300)
    a = (s[1, 1] * ratio - s[0, 1] * compliance) / det
    b = (s[0, 0] * compliance - s[0, 1] * ratio) / det
    return float((a * e[0] + b * e[1]) / (a * ratio + b * compliance))


@inlined
def _under_force(
    told: Innovation, forced: Floats, ratio: float, compliance: float, force_n: float, two: bool
) -> tuple[float, float]:
    """Log-likelihood with a process force of sigma `force_n`, and the force seen, N.

    The nut is no linear spring under a large force, hence a share of the compliance as error.
    `forced` is room to work in.
    """
    e, s = told.error, told.covariance
    seen = _force_seen(e, s, ratio, compliance, two)
    var = force_n * force_n
    forced[0, 0] = s[0, 0] + var * ratio * ratio + (_FORCE_ERROR * ratio * seen) ** 2
    forced[1, 1] = s[1, 1] + var * compliance * compliance
    forced[1, 1] += (_FORCE_ERROR * compliance * seen) ** 2
    forced[0, 1] = s[0, 1] + var * ratio * compliance
    forced[1, 0] = forced[0, 1]
    log_likelihood, _ = _likelihood(e, forced, two)
    return log_likelihood, seen


@inlined
def _correct(mixture: Mixture, k: int, told: Innovation, scale: float, two: bool) -> None:
    """Kalman correction of hypothesis k; `scale` widens the innovation of an outlier.

    With S = L L', P H' S^-1 H P = A A' for A = P H' L'^-1, which stays symmetric to the last bit.
    `told.gains` becomes A'.
    """
    x, p = mixture.mean[k], mixture.covariance[k]
    s = told.covariance
    first, second = told.gains[0], told.gains[1]
    left = math.sqrt(s[0, 0] * scale)
    step = told.error[0] / left
    for i in range(x.shape[0]):
        first[i] /= left
        x[i] += first[i] * step
    if not two:
        for i in range(x.shape[0]):
            a = first[i]
            for j in range(x.shape[0]):
                p[i, j] -= a * first[j]
        return
    below = s[0, 1] * scale / left
    det = max(s[0, 0] * s[1, 1] - s[0, 1] * s[0, 1], 1e-300)
    right = math.sqrt(det / s[0, 0] * scale)
    step = (told.error[1] - below * step) / right
    for i in range(x.shape[0]):
        second[i] = (second[i] - below * first[i]) / right
        x[i] += second[i] * step
    for i in range(x.shape[0]):
        a, b = first[i], second[i]
        if a == 0.0 and b == 0.0:
            continue
        for j in range(x.shape[0]):
            p[i, j] -= a * first[j] + b * second[j]


@compiled
def _explained(
    mixture: Mixture,
    model: FusedModel,
    r: Reading,
    spot: Spot,
    told: Innovation,
    room: _Room,
    least: float,
) -> bool:
    """Whether one of the hypotheses explains a phase without a force, at `least` as likely."""
    two = not math.isnan(r.stretch_m)
    for k in range(mixture.alive[0]):
        _innovate(model, mixture.mean[k], mixture.covariance[k], r, spot, told, room)
        calm, _ = _likelihood(told.error, told.covariance, two)
        if mixture.log_weight[k] + calm > least:
            return True
    return False


@compiled
def _innovation(size: int) -> Innovation:
    return Innovation(np.empty((2, size)), np.empty((2, size)), np.empty(2), np.empty((2, 2)))


@inlined
def _drift(
    mixture: Mixture,
    k: int,
    model: FusedModel,
    drift: Drift,
    step: Step,
    follows: bool,
    drifted: npt.NDArray[np.bool_],
) -> None:
    """Let a hypothesis drift unless it has."""
    if not drifted[k]:
        predict_state(mixture, k, model, drift, step, follows)
        drifted[k] = True


@inlined
def _learn(
    mixture: Mixture,
    k: int,
    drift: Drift,
    told: Innovation,
    r: Reading,
    leading: float,
    large: bool,
) -> float:
    """Weigh hypothesis k by a phase, with and without a process force, and correct it.

    Args:
        leading: log-likelihood of the phase under a force.
        large: whether one acts beyond doubt.

    Returns:
        Normalised innovation squared per quantity; NaN if a force acts.
    """
    two = not math.isnan(r.stretch_m)
    calm, nis = _likelihood(told.error, told.covariance, two)
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
    if forced > calm or (large and mixture.age_s[k] > r.steady_s):
        if large:
            mixture.log_weight[k] += forced - both
        return math.nan
    _correct(mixture, k, told, scale, two)
    return nis / 2.0 if two else nis


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
    of_leader, of_other = _innovation(size), _innovation(size)
    room = _Room(np.empty(size), np.empty(size, dtype=np.int64))
    step, spot = step_of(drift, elapsed_s, r.steady_s), spot_of(model, r, size)
    drifted = np.zeros(mixture.mean.shape[0], dtype=np.bool_)
    leader = leader_of(mixture)
    _drift(mixture, leader, model, drift, step, r.follows, drifted)
    x, p = mixture.mean[leader], mixture.covariance[leader]
    c = _innovate(model, x, p, r, spot, of_leader, room)
    calm, surprise = _likelihood(of_leader.error, of_leader.covariance, two)
    wide = of_other.covariance
    leading, seen_n = _under_force(of_leader, wide, ratio, c, model.process_force_n, two)
    large = leading > calm and abs(seen_n) > _LARGE_FORCE_N
    if large:
        for k in range(mixture.alive[0]):
            _drift(mixture, k, model, drift, step, r.follows, drifted)
        least = mixture.log_weight[leader] + leading
        large = not _explained(mixture, model, r, spot, of_other, room, least)
    mixture.since_force_s[0] = 0.0 if large else mixture.since_force_s[0] + r.steady_s
    motion_s = max(r.steady_s, 0.1)
    if large:
        if abs(r.acceleration_rad_s2) > _DRIVEN_RAD_S2 and mixture.force[leader] < 0.5:
            spawn_jumps(mixture, leader, drift, motion_s, True, drifted)
    elif (spawn or surprise > _SURPRISE) and mixture.since_force_s[0] > _AFTER_FORCE_S:
        spawn_jumps(mixture, leader, drift, motion_s, False, drifted)
    best_nis, best_weight = math.nan, -math.inf
    for k in range(mixture.alive[0]):
        told = of_leader if k == leader else of_other
        if k != leader:
            _drift(mixture, k, model, drift, step, r.follows, drifted)
            _innovate(model, mixture.mean[k], mixture.covariance[k], r, spot, told, room)
        nis = _learn(mixture, k, drift, told, r, leading, large)
        if mixture.log_weight[k] > best_weight:
            best_weight, best_nis = mixture.log_weight[k], nis
    tidy(mixture)
    return best_nis
