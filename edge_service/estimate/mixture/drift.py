"""Prediction of a hypothesis from one phase to the next."""

import math

from ...messages.samples import Floats
from ...models.compiled import inlined
from . import state
from .physics import mapped
from .state import AxisModel, Bank, Process, Reading


@inlined
def drift(
    bank: Bank, k: int, model: AxisModel, process: Process, r: Reading, elapsed_s: float
) -> None:
    """Predict a hypothesis over the time since the phase before, in place."""
    x, p = bank.mean[k], bank.covariance[k]
    keep = math.exp(-elapsed_s / process.assumed.friction_s)
    for i in range(state.NUT_FRICTION, state.GUIDE_VISCOUS + 1):
        _fade(x, p, i, keep)
    spread = process.together * (1.0 - keep * keep) / 2.0 * process.assumed.friction_s
    for i in range(state.NUT_FRICTION, state.GUIDE_VISCOUS + 1):
        for j in range(state.NUT_FRICTION, state.GUIDE_VISCOUS + 1):
            p[i, j] += spread
    if x.shape[0] > state.TORQUE_STATES:
        _fade(x, p, state.REVERSAL, keep)
    keep = math.exp(-r.steady_s / process.assumed.wander_s)
    _fade(x, p, state.TORQUE_WANDER, keep)
    p[state.TORQUE_WANDER, state.TORQUE_WANDER] += process.torque_wander_nm**2 * (1.0 - keep * keep)
    if model.edge_rad2_s2 > 0.0:
        _pass_on(x, p, model.edge_rad2_s2, r.follows)
    if x.shape[0] > state.TORQUE_STATES:
        way_m = abs(r.speed_rad_s) * model.ratio_m_per_rad * r.steady_s
        keep = math.exp(-way_m / process.assumed.wander_m)
        _fade(x, p, state.STRETCH_WANDER, keep)
        slope2 = x[state.ENCODER_SLOPE] ** 2 + p[state.ENCODER_SLOPE, state.ENCODER_SLOPE]
        uneven_m2 = (process.assumed.uneven_share * model.stroke_m) ** 2 * slope2
        unknown_m = mapped(model.map_sigma_m, model.stroke_m, r.table_m)
        wander_m2 = process.stretch_wander_m**2 + uneven_m2 + unknown_m**2
        p[state.STRETCH_WANDER, state.STRETCH_WANDER] += wander_m2 * (1.0 - keep * keep)
        keep = math.exp(-elapsed_s / process.assumed.growth_s)
        grown_s = process.assumed.growth_s * (1.0 - keep)
        _grow(x, p, state.ENCODER_OFFSET, state.OFFSET_RATE, grown_s)
        _grow(x, p, state.ENCODER_SLOPE, state.SLOPE_RATE, grown_s)
        _fade(x, p, state.OFFSET_RATE, keep)
        _fade(x, p, state.SLOPE_RATE, keep)
    back_s = _settled_s(process.assumed.friction_s, elapsed_s)
    for i in range(state.NUT_FRICTION, state.GUIDE_VISCOUS + 1):
        p[i, i] += process.walk[i] * back_s
    for i in (state.TORQUE_OFFSET, state.TORQUE_SCALE):
        p[i, i] += process.walk[i] * back_s
    if x.shape[0] > state.TORQUE_STATES:
        warm_s = _settled_s(process.assumed.growth_s, elapsed_s)
        for i in range(state.TORQUE_STATES, x.shape[0]):
            p[i, i] += process.walk[i] * (back_s if i == state.REVERSAL else warm_s)
    if p[state.WEAR_RATE, state.WEAR_RATE] > 0.0:
        _grow(x, p, state.PRELOAD, state.WEAR_RATE, r.steady_s)
        p[state.WEAR_RATE, state.WEAR_RATE] += process.assumed.rate_walk**2 * r.steady_s
    p[state.PRELOAD, state.PRELOAD] += process.moving_walk[k] * r.steady_s


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
    first, last = state.SPEED_ERROR_START, state.SPEED_ERROR_END
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
