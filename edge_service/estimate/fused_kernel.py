"""One step of the fused estimator: a Gaussian mixture over what may have happened to an axis.

Every hypothesis is an extended Kalman filter (fused_state, fused_physics). The functions run
compiled; their plain Python (`.py_func`) gives the same numbers.
"""

import math

import numpy as np
import numpy.typing as npt

from ..models.compiled import compiled, inlined
from .fused_correction import correct, likelihood, under_force
from .fused_innovation import Room, innovate, room_for_innovation
from .fused_mixture import leader_of, spawn_jumps, tidy
from .fused_physics import Spot, spot_of
from .fused_predict import Step, predict_state, step_of
from .fused_state import Drift, FusedModel, Innovation, Mixture, Reading

_SURPRISE = 9.0
_OUTLIER = 20.0
_DRIVEN_RAD_S2 = 100.0
_AFTER_FORCE_S = 0.3
_LARGE_FORCE_N = 100.0


@compiled
def _explained(
    mixture: Mixture,
    model: FusedModel,
    r: Reading,
    spot: Spot,
    told: Innovation,
    room: Room,
    least: float,
) -> bool:
    """Whether one of the hypotheses explains a phase without a force, at `least` as likely."""
    two = not math.isnan(r.stretch_m)
    for k in range(mixture.alive[0]):
        innovate(model, mixture.mean[k], mixture.covariance[k], r, spot, told, room)
        calm, _ = likelihood(told.error, told.covariance, two)
        if mixture.log_weight[k] + calm > least:
            return True
    return False


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
    calm, nis = likelihood(told.error, told.covariance, two)
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
    correct(mixture, k, told, scale, two)
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
    of_leader, of_other = room_for_innovation(size), room_for_innovation(size)
    room = Room(np.empty(size), np.empty(size, dtype=np.int64))
    step, spot = step_of(drift, elapsed_s, r.steady_s), spot_of(model, r, size)
    drifted = np.zeros(mixture.mean.shape[0], dtype=np.bool_)
    leader = leader_of(mixture)
    _drift(mixture, leader, model, drift, step, r.follows, drifted)
    x, p = mixture.mean[leader], mixture.covariance[leader]
    c = innovate(model, x, p, r, spot, of_leader, room)
    calm, surprise = likelihood(of_leader.error, of_leader.covariance, two)
    wide = of_other.covariance
    leading, seen_n = under_force(of_leader, wide, ratio, c, model.process_force_n, two)
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
            innovate(model, mixture.mean[k], mixture.covariance[k], r, spot, told, room)
        nis = _learn(mixture, k, drift, told, r, leading, large)
        if mixture.log_weight[k] > best_weight:
            best_weight, best_nis = mixture.log_weight[k], nis
    tidy(mixture)
    return best_nis
