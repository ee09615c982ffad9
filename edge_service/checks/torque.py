"""Check of the torque: that it has a sign, the right one, and the size that the motion needs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..messages.samples import ANGLE, SETPOINT, TABLE_POSITION, TORQUE, Floats, SampleFrame
from ..models.machine import Machine, Quantity
from ..regression.interval_estimate import IntervalEstimate
from ..regression.inverse_dynamics import InverseDynamics, identify_inverse_dynamics
from ..regression.prepared_run import DECIMATION, PreparationSettings, prepare
from .channel_regression import CUTOFF_HZ, STANDSTILL_SHARE
from .finding import Finding, Verdict, usual_mistake, wrongly
from .positions import Recordings, angle_is_misread
from .sampling import clock_of, motion_speeds

INERTIA_FACTOR = 2.0
"""A load changes the inertia by less than this factor; beyond it the torque's unit is another."""
OTHER_UNIT_FACTOR = 5.0
"""No load, and no machine file that was written for this axis, is off by as much; a unit is."""
SIGMAS = 3.0
"""Of the stated inertia, whose tolerance may be wide."""
SLOW_SHARE = 0.1
"""Quantile of the speeds in motion below which an axis is slow, for itself."""
INVERTED = "torque sign looks inverted: "
ONE_SIDE = 0.05
"""Share of the greatest torque that the other side may reach by noise and an offset."""
CLEARLY = 0.8
"""Squared residual over that of the rival, from which on one model is the better one.

A load that hangs may keep torque on one side, but then it still follows the signed acceleration and
friction; a magnitude follows their absolute values.
"""
_UNEXPLAINED = 0.22
"""Of the torque: beyond it no factor explains it, as where a drive cuts off what is commanded."""
LEAST_ROWS = 40
CLEAR_SHARE = 0.15
"""Beyond half: so many rows more tell by their power which way a torque counts."""
_LONGEST_M_PER_RAD = 0.1 / 6.28  # beyond it, a rotary axis or a belt
_GREATEST = (("dry friction", "N m", 5.0, 3e3, 1), ("inertia", "kg m2", 0.02, 5e3, 2))
"""Of feed axes: motor and screw; table and guides, by a power of the travel per rad."""
WIDE = "inertia is known to half of it at best: rows may be interpolated, or motion is too slow"
_BORROWED_SIGN = Finding(
    "torque",
    Verdict.DOUBTFUL,
    "torque has the sign of the direction, which is wrong while the axis brakes",
    remedy="needs a torque or current with a sign of its own; without one compare the friction of "
    "the same moves, then and now (`edge-service drift`)",
    forbids=True,
)


def check_torque(machine: Machine, recordings: Recordings) -> Finding:
    if TORQUE in machine.columns and machine.columns[TORQUE].direction:
        return _BORROWED_SIGN
    able, settings = _readable(machine, recordings)
    rows = rows_in_motion(able, settings)
    if (by_sign := judge_sign(*rows)) is not None:
        return by_sign
    fit = identify_inverse_dynamics(able, settings)
    inertia = fit.parameters["inertia"]
    verdict, said = Verdict.FITS, "torque has the sign and the size that the inertia needs"
    judged = None
    if not inertia.determined or inertia.holds(0.0):
        verdict, said = Verdict.UNKNOWN, "cannot tell: too little acceleration"
    else:
        share = driven_share(*rows[:2], fit.parameters["offset"].value)
        judged = _judged_inertia(fit, machine.model.inertia_kg_m2, able, share)
        is_rough = fit.fit.residual_std > _UNEXPLAINED * np.std(rows[0])
        if judged and is_rough and inertia.low > 0.0:
            judged = replace(judged, forbids=False)
        if inertia.high - inertia.low > abs(inertia.value):
            verdict, said = Verdict.DOUBTFUL, WIDE
    judged = judged or _judged_drag(machine, able, fit) or _judged_size(machine, fit)
    return judged or Finding("torque", verdict, said, inertia, machine.model.inertia_kg_m2.value)


def driven_share(torque: Floats, speed: Floats, offset_nm: float) -> float:
    """Share of rows in motion, (n,), in which the torque drives it; a half where none can tell."""
    power = (torque - offset_nm) * speed
    able = len(power) >= LEAST_ROWS and {-1.0, 1.0} <= set(np.sign(speed).tolist())
    return float(np.mean(power > 0.0)) if able else 0.5


def _judged_size(machine: Machine, fit: InverseDynamics) -> Finding | None:
    """Finding on friction or inertia beyond what the feed axes of that lead have."""
    ratio = machine.transmission_ratio_m_per_rad
    for name, unit, motor, table, power in _GREATEST:
        most = motor + table * ratio**power
        found = fit.parameters["inertia" if name == "inertia" else "coulomb"]
        if ratio < _LONGEST_M_PER_RAD and found.determined and found.low > most:
            sentence = f"{name} {found.value:.3g} {unit} is more than feed axes of that lead have"
            sentence += f" ({most:.2g}): the torque may be in another unit"
            return Finding("torque", Verdict.DOUBTFUL, sentence, found, most)
    return None


def measured_inertia(machine: Machine, recordings: Recordings) -> IntervalEstimate:
    """Inertia of the whole axis that the torque shows, kg m2. Raises ValueError: no motion."""
    return identify_inverse_dynamics(*_readable(machine, recordings)).parameters["inertia"]


def _judged_inertia(
    fit: InverseDynamics, stated: Quantity, recordings: Sequence[SampleFrame], share: float
) -> Finding | None:
    """Finding on an inertia that contradicts the machine file, or that slow samples hide."""
    inertia, coulomb = fit.parameters["inertia"], fit.parameters["coulomb"]
    expected = stated.value
    both = coulomb.determined and coulomb.high < 0.0 and inertia.high < 0.0
    if not both and clock_of([frame.time_s for frame in recordings]).is_slow:
        sentence = "cannot tell: samples too slow for the acceleration"
        return Finding("torque", Verdict.UNKNOWN, sentence, inertia, expected)
    if inertia.high < 0.0:
        said = "inertia and friction read negative" if both else "inertia reads negative"
        sentence = f"{INVERTED}{said}"
        if share > 0.5 + CLEAR_SHARE:
            sentence = f"{said}, though the torque drives {100.0 * share:.0f} % of the rows"
        return Finding("torque", Verdict.DOUBTFUL, sentence, inertia, expected, forbids=True)
    if _apart(inertia, stated, INERTIA_FACTOR):
        ratio = inertia.value / expected
        reason = usual_mistake(ratio, TORQUE)
        if "rad" in reason or not (reason or any(TABLE_POSITION in f.channels for f in recordings)):
            reason = usual_mistake(1.0 / ratio, ANGLE)
        sentence = f"{TORQUE} looks {wrongly(ratio)}{reason}"
        forbids = _apart(inertia, stated, OTHER_UNIT_FACTOR)
        return Finding("torque", Verdict.DOUBTFUL, sentence, inertia, expected, forbids=forbids)
    return None


def _apart(inertia: IntervalEstimate, stated: Quantity, factor: float) -> bool:
    """Interval that is wholly further off than a factor, and than what is stated."""
    reach = SIGMAS * stated.sigma
    high = max(factor * stated.value, stated.value + reach)
    low = min(stated.value / factor, stated.value - reach)
    return inertia.low > high or inertia.high < low


def _judged_drag(
    machine: Machine, recordings: Sequence[SampleFrame], fit: InverseDynamics
) -> Finding | None:
    """Finding on a friction that drives the axis at its own slow speeds; not by extrapolation."""
    coulomb, viscous = fit.parameters["coulomb"], fit.parameters["viscous"]
    speeds = np.abs(motion_speeds(machine, recordings))
    moving = speeds[speeds > STANDSTILL_SHARE * speeds.max(initial=0.0)]
    shares = (SLOW_SHARE, 1.0 - SLOW_SHARE)
    slow, fast = np.quantile(moving, shares).tolist() if moving.size else (0.0, 0.0)
    falls = -viscous.value * fast if viscous.determined and viscous.high < 0.0 else 0.0
    if coulomb.determined and falls > 0.3 * abs(coulomb.value):  # Stribeck's takes less
        sentence = f"friction falls with speed, by {falls:.2g} N m: another force is in it"
        return Finding("torque", Verdict.DOUBTFUL, sentence, viscous, 0.0)
    carried = max(viscous.value * slow, 0.0) if viscous.determined else 0.0
    if not coulomb.determined or coulomb.high + carried >= 0.0:
        return None
    sentence = (
        f"friction {coulomb.value:.2g} N m reads negative: sign of torque or motion, or a load "
        "that pulls"
    )
    return Finding("torque", Verdict.DOUBTFUL, sentence, coulomb, 0.0, forbids=True)


def _readable(
    machine: Machine, recordings: Recordings
) -> tuple[list[SampleFrame], PreparationSettings]:
    """Channels of recordings with a torque that its model needs, and how to prepare them."""
    able = [frame for frame in recordings if TORQUE in frame.channels]
    used = {TORQUE, TABLE_POSITION, SETPOINT}
    used |= set() if angle_is_misread(machine, recordings) else {ANGLE}
    able = [SampleFrame(f.time_s, {n: v for n, v in f.channels.items() if n in used}) for f in able]
    settings = PreparationSettings.sampled(machine.transmission_ratio_m_per_rad, able, CUTOFF_HZ)
    speeds = np.abs(motion_speeds(machine, able))
    top_rad_s = float(np.quantile(speeds, 0.99)) if speeds.size else 0.0
    still = min(settings.standstill_rad_s, STANDSTILL_SHARE * (top_rad_s or np.inf))
    return able, replace(settings, standstill_rad_s=still)


def judge_sign(torque: Floats, speed: Floats, acceleration: Floats) -> Finding | None:
    """Finding on a torque, (n,), that stays on one side both ways; None of one that does not."""
    way = np.sign(speed)
    if len(torque) < LEAST_ROWS or not {-1.0, 1.0} <= set(way.tolist()):
        return None
    low, high = (float(each) for each in np.quantile(torque, (0.02, 0.98)))
    nearest, furthest = sorted((low, high), key=abs)
    if nearest * np.sign(furthest) < -ONE_SIDE * abs(furthest):
        return None
    one = np.ones_like(torque)
    signed = _left(torque, np.column_stack([way, acceleration, speed, one]))
    amount = _left(torque, np.column_stack([one, way * acceleration, np.abs(speed), way]))
    if signed < CLEARLY * amount:
        return None
    sure = amount < CLEARLY * signed
    what = "a magnitude, not a load that hangs" if sure else "a magnitude, or a load that hangs"
    sentence = (
        f"{TORQUE} stays on one side both ways ({low:.3g} to {high:.3g} N m) and does not follow "
        f"the signed acceleration: {what}"
    )
    remedy = f"needs signed torque or current in columns.{TORQUE}, and moves that accelerate"
    return Finding("torque", Verdict.DOUBTFUL, sentence, remedy=remedy, forbids=sure)


def rows_in_motion(
    recordings: Sequence[SampleFrame], settings: PreparationSettings
) -> tuple[Floats, Floats, Floats]:
    """Torque, speed and acceleration in motion, (n,) each."""
    runs = (run for frame in recordings for run in prepare(frame, settings, beside=()))
    found = [np.empty((0, 3))]
    for run in runs:
        columns = np.column_stack([run.channels[TORQUE], run.speed_rad_s, run.acceleration_rad_s2])
        found.append(columns[run.moving][::DECIMATION])
    torque, speed, acceleration = np.concatenate(found).T
    return torque, speed, acceleration


def _left(target: Floats, columns: Floats) -> float:
    """Residual sum of squares, and what rounding leaves of any."""
    value = np.linalg.lstsq(columns, target, rcond=None)[0]
    return float(np.sum((target - columns @ value) ** 2) + 1e-12 * np.sum(target**2))
