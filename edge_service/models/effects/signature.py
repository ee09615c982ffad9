"""The two signatures of an effect on measured motion: torque, and transmission.

Torque: what the motor must give in addition to the baseline model. Transmission: how the difference
between table position and motor angle, x - R theta, changes, up to a constant. To first order in
the effect; where several are there their signatures add up.
"""

import functools
import operator
from collections.abc import Callable, Sequence

import numpy as np

from ...messages.samples import Floats
from .baseline import Baseline, Motion
from .contribution import (
    HOLDING,
    Change,
    Constant,
    Contribution,
    Curve,
    DryFriction,
    Harmonic,
    LoadFriction,
    Over,
    Place,
    Play,
    PreslidingWindUp,
    Shift,
    SmoothTorque,
    Strain,
    TableForce,
    ViscousFriction,
)
from .effect import Effect, Values
from .hysteresis import bristle_share, play

_Signature = Callable[[float, Motion, Baseline], Floats]
_ANGLE_STEP_RAD = 1e-3
_POSITION_STEP_M = 1e-5
_CURRENT_LOOP_S = 3e-4
"""Assumption: no current loop answers later."""
_CROSSING = 0.499  # of a play, from its middle, up to which the motor touches no flank
_RATTLING = 0.2  # the same of a table without friction, whose rattling is a load too


def torque_signature(effect: Effect, values: Values, motion: Motion, baseline: Baseline) -> Floats:
    """Torque that the motor must give in addition, N m, (n,); of dry friction none at rest."""
    return _sum([_torque(each, motion, baseline) for each in effect.contributions(values)], motion)


def transmission_signature(
    effect: Effect, values: Values, motion: Motion, baseline: Baseline
) -> Floats:
    """Change of x - R theta, m, (n,), up to a constant."""
    parts = [_transmission(each, motion, baseline) for each in effect.contributions(values)]
    return _sum(parts, motion)


def _sum(parts: Sequence[Floats], motion: Motion) -> Floats:
    return functools.reduce(operator.add, parts) if parts else np.zeros(len(motion))


def _torque(contribution: Contribution, motion: Motion, baseline: Baseline) -> Floats:
    torque = np.zeros(len(motion))
    match contribution:
        case DryFriction(over, level_nm, _):
            torque = motion.direction * _over(level_nm, motion, over)
        case ViscousFriction(over, per_speed):
            torque = motion.speed_rad_s * _over(per_speed, motion, over)
        case SmoothTorque(over, torque_nm, _):
            torque = _over(torque_nm, motion, over)
        case TableForce(force_n):
            torque = -baseline.ratio_m_per_rad * force_n(motion.time_s)
        case LoadFriction(coefficient, friction_share, viscous_share):
            carried_nm = _carried_nm(friction_share, viscous_share, motion, baseline)
            torque = coefficient * motion.direction * np.abs(carried_nm)
        case Shift():
            torque = _shift_torque(contribution, motion, baseline)
        case Play():
            torque = _let_go(contribution, motion, baseline)
        case Change(quantity, value) if quantity in _CHANGED_TORQUE:
            torque = _CHANGED_TORQUE[quantity](value, motion, baseline)
    return torque


def _transmission(contribution: Contribution, motion: Motion, baseline: Baseline) -> Floats:
    shift = np.zeros(len(motion))
    wound_m = functools.partial(baseline.wind_up_m, position_m=motion.position_m)
    match contribution:
        case DryFriction(over, level_nm, side):  # at rest as it came there
            level = motion.approach * _over(level_nm, motion, over)
            shift = wound_m(side.table_share(baseline.table_share) * level)
        case SmoothTorque(over, torque_nm, side):
            shift = wound_m(side.table_share(baseline.table_share) * _over(torque_nm, motion, over))
        case TableForce(force_n):
            shift = wound_m(-baseline.ratio_m_per_rad * force_n(motion.time_s))
        case Shift(Place.ANGLE_READING, over, curve):
            shift = -baseline.ratio_m_per_rad * curve(_variable(motion, over))
        case Shift(_, over, curve):
            shift = curve(_variable(motion, over))
        case Strain(over, strain):
            shift = _over(strain, motion, over) * baseline.ratio_m_per_rad * motion.angle_rad
        case PreslidingWindUp():
            shift = _wind_up_by_travel(contribution, motion, baseline)
        case Play():
            shift = _lost_motion(contribution, motion, baseline)
        case Change(quantity, value) if quantity in _CHANGED_TRANSMISSION:
            shift = _CHANGED_TRANSMISSION[quantity](value, motion, baseline)
    return shift


def _over(curve: Curve, motion: Motion, over: Over) -> Floats:
    """A curve over a variable of the motion, (n,); 0 where the variable was not recorded."""
    found = curve(_variable(motion, over))
    return np.nan_to_num(found, nan=0.0) if over is Over.TEMPERATURE else found


def _variable(motion: Motion, over: Over) -> Floats:
    return {
        Over.SPEED: motion.speed_rad_s,
        Over.ANGLE: motion.angle_rad,
        Over.POSITION: motion.position_m,
        Over.TIME: motion.time_s,
        Over.TEMPERATURE: motion.temperature_c,
    }[over]


def _shift_torque(shift: Shift, motion: Motion, baseline: Baseline) -> Floats:
    """Inertia torque of a shift: R m e'' of the nut, -J r'' and -D r' of a rotary reading."""
    along = baseline.ratio_m_per_rad, _POSITION_STEP_M
    per_rad, step = along if shift.over is Over.POSITION else (1.0, _ANGLE_STEP_RAD)
    variable = _variable(motion, shift.over)
    if isinstance(shift.shift, Harmonic):
        slope, bend = shift.shift.derivatives(variable)
    else:
        before, here, after = (shift.shift(variable + k * step) for k in (-1.0, 0.0, 1.0))
        slope = (after - before) / (2.0 * step)
        bend = (after - 2.0 * here + before) / step**2
    speed = per_rad * motion.speed_rad_s
    acceleration = bend * speed**2 + slope * per_rad * motion.acceleration_rad_s2
    seen_kg_m2 = _seen_kg_m2(motion, baseline)
    if shift.place is Place.NUT:
        return (baseline.table_inertia_kg_m2 - seen_kg_m2) / baseline.ratio_m_per_rad * acceleration
    viscous = baseline.viscous_nm_s_per_rad * (slope * speed)
    return -(baseline.inertia_kg_m2 - seen_kg_m2) * acceleration - viscous


def _seen_kg_m2(motion: Motion, baseline: Baseline) -> float:
    """Inertia of a table whose own acceleration is measured, and counts already; otherwise 0."""
    is_measured = not np.array_equal(motion.table_rad_s2, motion.acceleration_rad_s2)
    return baseline.table_inertia_kg_m2 * is_measured


def _lacking(reach_m: float, level: Floats, motion: Motion, baseline: Baseline) -> Floats:
    """Share of dry friction that bristles add to its level at once, -1 to 1, (n,)."""
    travel = baseline.ratio_m_per_rad * motion.angle_rad
    return (bristle_share(travel, reach_m) if reach_m > 0.0 else level) - level


def _presliding_torque(reach_m: float, motion: Motion, baseline: Baseline) -> Floats:
    """Presliding friction instead of all dry friction: F_c (bristle - s(v)), N m, (n,)."""
    return baseline.coulomb_nm * _lacking(reach_m, motion.direction, motion, baseline)


def _presliding_wind_up(reach_m: float, motion: Motion, baseline: Baseline) -> Floats:
    lacking = _lacking(reach_m, motion.approach, motion, baseline)
    return baseline.wind_up_m(baseline.table_coulomb_nm * lacking, motion.position_m)


def _wind_up_by_travel(each: PreslidingWindUp, motion: Motion, baseline: Baseline) -> Floats:
    """Wind-up that the spring still lacks by dry friction that turns at once, m, (n,)."""
    compliance = each.level_m_per_n + each.slope_per_n * motion.position_m
    lacking = _lacking(each.reach_m, motion.approach, motion, baseline)
    lacking_nm = each.friction_share * baseline.table_coulomb_nm * lacking
    return np.asarray(-compliance * lacking_nm / baseline.ratio_m_per_rad)


def _lost_motion(each: Play, motion: Motion, baseline: Baseline) -> Floats:
    """Lost motion of friction's flank, and that of a table that brakes onto the other one.

    One without friction rattles wherever no load holds it on a flank: halfway in the mean, here 0.
    """
    travel = baseline.ratio_m_per_rad * motion.angle_rad
    load_nm = _carried_nm(each.friction_share, each.viscous_share, motion, baseline)
    if not each.friction_share and not each.viscous_share:
        held = np.abs(load_nm) > _RATTLING * baseline.coulomb_nm
        return np.where(held, -0.5 * each.width_m * np.sign(load_nm), 0.0)
    leads = load_nm * motion.approach < -HOLDING * baseline.coulomb_nm
    ahead = np.where(leads, motion.approach, 0.0).astype(np.int8)
    return play(travel, each.width_m, ahead) - travel


def _let_go(each: Play, motion: Motion, baseline: Baseline) -> Floats:
    """Torque of the table's load, which the motor is without while it crosses a play, N m, (n,)."""
    if not each.friction_share and not each.viscous_share:  # it rattles
        return np.zeros(len(motion))
    share = _lost_motion(each, motion, baseline) / (each.width_m or 1.0)
    carried_nm = _carried_nm(each.friction_share, each.viscous_share, motion, baseline)
    return np.where(np.abs(share - 0.5) < _CROSSING, -carried_nm, 0.0)


def _carried_nm(dry: float, viscous: float, motion: Motion, baseline: Baseline) -> Floats:
    """Load between motor and table with shares of its frictions, N m at the motor, (n,)."""
    load_nm = motion.load_torque_nm + dry * _dry_load_nm(motion, baseline)
    return load_nm + viscous * _viscous_load_nm(motion, baseline)


_loaded_nm = functools.partial(_carried_nm, 1.0, 0.0)


def _dry_load_nm(motion: Motion, baseline: Baseline) -> Floats:
    """Dry friction of the table, N m at the motor, (n,); at rest as it came there."""
    return baseline.table_coulomb_nm * motion.approach


def _viscous_load_nm(motion: Motion, baseline: Baseline) -> Floats:
    return baseline.viscous_nm_s_per_rad * motion.speed_rad_s


def _given(load_nm: Callable[[Motion, Baseline], Floats]) -> _Signature:
    """-c T / R of a load T, for a compliance c."""
    return lambda value, motion, baseline: (
        -value * load_nm(motion, baseline) / baseline.ratio_m_per_rad
    )


def _given_along(load_nm: Callable[[Motion, Baseline], Floats]) -> _Signature:
    even = _given(load_nm)
    return lambda value, motion, baseline: motion.position_m * even(value, motion, baseline)


def usual_lag_s(period_s: float) -> float:
    """Lag of a healthy drive's torque, s, as likely shorter as longer, by its sampling period.

    A torque may be recorded as it acts, or as a command that is held for a period and acts half a
    period late, behind a current loop of a few tenths of a millisecond.
    """
    return 0.5 * (0.5 * period_s + _CURRENT_LOOP_S)


def _delayed(lag_s: float, motion: Motion, _baseline: Baseline) -> Floats:
    """Torque by which a command leads that of a healthy drive, which lags already."""
    slope = np.gradient(motion.model_torque_nm, motion.time_s)
    usual_s = usual_lag_s(float(motion.time_s[1] - motion.time_s[0]))
    return np.asarray(lag_s * (slope + usual_s * np.gradient(slope, motion.time_s)))


def _beyond_limit(limit_nm: float, motion: Motion, _baseline: Baseline) -> Floats:
    beyond = np.maximum(np.abs(motion.torque_nm) - limit_nm, 0.0)
    return np.asarray(np.nan_to_num(np.sign(motion.torque_nm) * beyond))


_CHANGED_TORQUE: dict[Constant, _Signature] = {
    Constant.TABLE_INERTIA: lambda value, motion, _: value * motion.table_rad_s2,
    Constant.VISCOUS: lambda value, motion, _: value * motion.speed_rad_s,
    Constant.COMMAND_SHARE: lambda value, motion, _: value * motion.model_torque_nm,
    Constant.TORQUE_LIMIT: _beyond_limit,
    Constant.TORQUE_LAG: _delayed,
    Constant.POSITION_LAG: lambda value, motion, baseline: (  # the table's acceleration is late
        value * _seen_kg_m2(motion, baseline) * np.gradient(motion.table_rad_s2, motion.time_s)
    ),
    Constant.PRESLIDING_REACH: _presliding_torque,
}

_CHANGED_TRANSMISSION: dict[Constant, _Signature] = {
    Constant.TABLE_INERTIA: lambda value, motion, baseline: baseline.wind_up_m(
        value * motion.table_rad_s2, motion.position_m
    ),
    Constant.POSITION_LAG: lambda value, motion, baseline: (
        -value * baseline.ratio_m_per_rad * motion.speed_rad_s
    ),
    Constant.COMPLIANCE: _given(_loaded_nm),
    Constant.COMPLIANCE_SLOPE: _given_along(_loaded_nm),
    Constant.COULOMB_LOAD_COMPLIANCE: _given(_dry_load_nm),
    Constant.COULOMB_LOAD_COMPLIANCE_SLOPE: _given_along(_dry_load_nm),
    Constant.VISCOUS_LOAD_COMPLIANCE: _given(_viscous_load_nm),
    Constant.VISCOUS_LOAD_COMPLIANCE_SLOPE: _given_along(_viscous_load_nm),
    Constant.PRESLIDING_REACH: _presliding_wind_up,
}
