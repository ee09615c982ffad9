"""The two signatures of an effect on measured motion: torque, and transmission.

Torque: what the motor must give in addition to the baseline model. Transmission: how the difference
between table position and motor angle, x - R theta, changes, up to a constant. To first order in
the effect; where several are there their signatures add up.
"""

from collections.abc import Callable

import numpy as np

from ...messages.samples import Floats
from .baseline import Baseline, Motion
from .contribution import (
    Change,
    Contribution,
    Curve,
    DryFriction,
    Over,
    Place,
    Quantity,
    Shift,
    Side,
    SmoothTorque,
    Strain,
    TableForce,
    Warming,
)
from .effect import Effect, Values
from .hysteresis import bristle_share, play

_Signature = Callable[[float, Motion, Baseline], Floats]
_ANGLE_STEP_RAD = 1e-3
_POSITION_STEP_M = 1e-5


def torque_signature(effect: Effect, values: Values, motion: Motion, baseline: Baseline) -> Floats:
    """Torque that the motor must give in addition, N m, (n,); of dry friction none at rest."""
    torque = np.zeros(len(motion))
    for contribution in effect.contributions(values):
        torque += _torque(contribution, motion, baseline)
    return torque


def transmission_signature(
    effect: Effect, values: Values, motion: Motion, baseline: Baseline
) -> Floats:
    """Change of x - R theta, m, (n,), up to a constant."""
    shift = np.zeros(len(motion))
    for contribution in effect.contributions(values):
        shift += _transmission(contribution, motion, baseline)
    return shift


def _torque(contribution: Contribution, motion: Motion, baseline: Baseline) -> Floats:
    match contribution:
        case DryFriction(over, level_nm, _):
            return motion.direction * level_nm(_variable(motion, over))
        case SmoothTorque(over, torque_nm, _):
            return torque_nm(_variable(motion, over))
        case TableForce(force_n):
            return -baseline.ratio_m_per_rad * force_n(motion.time_s)
        case Shift():
            return _shift_torque(contribution, motion, baseline)
        case Strain() | Warming():
            return np.zeros(len(motion))
        case Change(quantity, value):
            return _CHANGED_TORQUE.get(quantity, _nothing)(value, motion, baseline)


def _transmission(contribution: Contribution, motion: Motion, baseline: Baseline) -> Floats:
    match contribution:
        case DryFriction() | SmoothTorque() | TableForce():
            return baseline.wind_up_m(_carried(contribution, motion, baseline), motion.position_m)
        case Shift(Place.ANGLE_READING, over, shift):
            return -baseline.ratio_m_per_rad * shift(_variable(motion, over))
        case Shift(_, over, shift):
            return shift(_variable(motion, over))
        case Warming():
            return np.zeros(len(motion))
        case Strain(strain):
            return strain(motion.time_s) * baseline.ratio_m_per_rad * motion.angle_rad
        case Change(quantity, value):
            return _CHANGED_TRANSMISSION.get(quantity, _nothing)(value, motion, baseline)


def _carried(
    contribution: DryFriction | SmoothTorque | TableForce, motion: Motion, baseline: Baseline
) -> Floats:
    """The part of a torque that goes through the spring, N m, (n,); at rest as it came there."""
    match contribution:
        case DryFriction(over, level_nm, side):
            level = motion.approach * level_nm(_variable(motion, over))
            return _share(side, baseline) * level
        case SmoothTorque(over, torque_nm, side):
            return _share(side, baseline) * torque_nm(_variable(motion, over))
        case TableForce(force_n):
            return -baseline.ratio_m_per_rad * force_n(motion.time_s)


def _variable(motion: Motion, over: Over) -> Floats:
    match over:
        case Over.SPEED:
            return motion.speed_rad_s
        case Over.ANGLE:
            return motion.angle_rad
        case Over.POSITION:
            return motion.position_m
        case Over.TIME:
            return motion.time_s


def _share(side: Side, baseline: Baseline) -> float:
    return {Side.MOTOR: 0.0, Side.TABLE: 1.0, Side.AS_DRAG: baseline.table_share}[side]


def _shift_torque(shift: Shift, motion: Motion, baseline: Baseline) -> Floats:
    """Inertia torque of a shift: R m e'' of the nut, -J r'' and -D r' of a rotary reading."""
    rate, acceleration = _derivatives(shift.over, shift.shift, motion, baseline)
    match shift.place:
        case Place.NUT:
            return baseline.table_inertia_kg_m2 / baseline.ratio_m_per_rad * acceleration
        case Place.ANGLE_READING:
            viscous = baseline.viscous_nm_s_per_rad * rate
            return -baseline.inertia_kg_m2 * acceleration - viscous


def _derivatives(
    over: Over, shift: Curve, motion: Motion, baseline: Baseline
) -> tuple[Floats, Floats]:
    """First and second derivative of a shift by time: s' v and s'' v^2 + s' a, (n,) each."""
    variable = _variable(motion, over)
    step, per_rad = _ANGLE_STEP_RAD, 1.0
    if over is Over.POSITION:
        step, per_rad = _POSITION_STEP_M, baseline.ratio_m_per_rad
    before, here, after = (shift(variable + k * step) for k in (-1.0, 0.0, 1.0))
    slope, bend = (after - before) / (2.0 * step), (after - 2.0 * here + before) / step**2
    speed = per_rad * motion.speed_rad_s
    return slope * speed, bend * speed**2 + slope * per_rad * motion.acceleration_rad_s2


def _nothing(_value: float, motion: Motion, _baseline: Baseline) -> Floats:
    return np.zeros(len(motion))


def _presliding_torque(reach_m: float, motion: Motion, baseline: Baseline) -> Floats:
    """Presliding friction instead of all dry friction: F_c (bristle - s(v)), N m, (n,)."""
    if reach_m <= 0.0:
        return np.zeros(len(motion))
    bristle = bristle_share(baseline.ratio_m_per_rad * motion.angle_rad, reach_m)
    return baseline.coulomb_nm * (bristle - motion.direction)


def _presliding_wind_up(reach_m: float, motion: Motion, baseline: Baseline) -> Floats:
    if reach_m <= 0.0:
        return np.zeros(len(motion))
    bristle = bristle_share(baseline.ratio_m_per_rad * motion.angle_rad, reach_m)
    lacking_nm = baseline.table_coulomb_nm * (bristle - motion.approach)
    return baseline.wind_up_m(lacking_nm, motion.position_m)


def _lost_motion(width_m: float, motion: Motion, baseline: Baseline) -> Floats:
    travel = baseline.ratio_m_per_rad * motion.angle_rad
    return play(travel, width_m) - travel


def _beyond_limit(limit_nm: float, motion: Motion, _baseline: Baseline) -> Floats:
    beyond = np.maximum(np.abs(motion.torque_nm) - limit_nm, 0.0)
    useless_nm: Floats = np.nan_to_num(np.sign(motion.torque_nm) * beyond)
    return useless_nm


_CHANGED_TORQUE: dict[Quantity, _Signature] = {
    Quantity.TABLE_INERTIA: lambda value, motion, _: value * motion.acceleration_rad_s2,
    Quantity.VISCOUS: lambda value, motion, _: value * motion.speed_rad_s,
    Quantity.COMMAND_SHARE: lambda value, motion, _: value * motion.model_torque_nm,
    Quantity.TORQUE_LIMIT: _beyond_limit,
    Quantity.TORQUE_LAG: lambda value, motion, _: (
        value * np.gradient(motion.model_torque_nm, motion.time_s)
    ),
    Quantity.PRESLIDING_REACH: _presliding_torque,
    Quantity.LOAD_FRICTION: lambda value, motion, _: (
        value * motion.direction * np.abs(motion.load_torque_nm)
    ),
}

_CHANGED_TRANSMISSION: dict[Quantity, _Signature] = {
    Quantity.TABLE_INERTIA: lambda value, motion, baseline: baseline.wind_up_m(
        value * motion.acceleration_rad_s2, motion.position_m
    ),
    Quantity.POSITION_LAG: lambda value, motion, baseline: (
        -value * baseline.ratio_m_per_rad * motion.speed_rad_s
    ),
    Quantity.BACKLASH: _lost_motion,
    Quantity.COMPLIANCE: lambda value, motion, baseline: (
        -value * motion.load_torque_nm / baseline.ratio_m_per_rad
    ),
    Quantity.COMPLIANCE_SLOPE: lambda value, motion, baseline: (
        -value * motion.position_m * motion.load_torque_nm / baseline.ratio_m_per_rad
    ),
    Quantity.PRESLIDING_REACH: _presliding_wind_up,
}
