"""Inertia and friction of an axis whose torque's sign nobody has said, and what they answer."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...messages.samples import ANGLE, TABLE_POSITION, TORQUE, ColumnMap, SampleFrame
from ...regression.interval_estimate import IntervalEstimate, around, undetermined
from ...regression.inverse_dynamics import identify_inverse_dynamics
from ...regression.prepared_run import PreparationSettings, prepare
from ..channel_regression import CUTOFF_HZ
from ..sampling import TOO_SLOW, clock_of
from ..torque import CLEAR_SHARE, driven_share, rows_in_motion

_STEADY_SHARE = 0.7
"""Of the top speed of a run: faster than this it is not starting or stopping."""
_LEAST_ROWS, _LEAST_PASSAGES = 5, 3
_RESPONSE_HZ = 200.0
_NO_SIGN = "a torque without a sign is wrong while the axis brakes"
_NEGATIVE = "it reads negative: a force that follows the motion is in the torque"


@dataclass(frozen=True, slots=True)
class Mechanics:
    """Parameters of torque = J a + D v + F sgn(v) + offset, at the motor."""

    inertia: IntervalEstimate
    viscous: IntervalEstimate
    coulomb: IntervalEstimate
    offset: IntervalEstimate
    is_inverted: bool  # the torque counts against the motion; the parameters are already turned
    most_inertia: float  # kg m2 that explain all of the torque; the inertia is less
    seconds: float  # of motion behind it
    sign_is_told: bool = True  # inertia or friction shows which way the torque counts

    def named(self) -> dict[str, IntervalEstimate]:
        names = "inertia", "dry friction", "viscous friction"
        found = zip(names, (self.inertia, self.coulomb, self.viscous), strict=True)
        told = {n: undetermined(x.unit, _NEGATIVE) if x.high < 0.0 else x for n, x in found}
        return told | {"constant load": self.offset}


def steady_friction(frames: Sequence[SampleFrame], ratio_m_per_rad: float) -> Mechanics:
    """Friction alone, from steady motion: for a torque that has its sign from the direction.

    Half the difference of the torque between both directions; its interval comes from the scatter
    between passages. Dry and viscous friction are one. Raises ValueError: too little motion.
    """
    settings = PreparationSettings.sampled(ratio_m_per_rad, frames, CUTOFF_HZ)
    means: dict[float, list[float]] = {1.0: [], -1.0: []}
    seconds = 0.0
    for frame in frames:
        for run in prepare(frame, settings):
            speed = run.speed_rad_s
            top = float(np.percentile(np.abs(speed), 98.0))
            for sign, found in means.items():
                steady = sign * speed > _STEADY_SHARE * top
                if np.count_nonzero(steady) >= _LEAST_ROWS:
                    found.append(float(np.mean(run.channels[TORQUE][steady])))
                    seconds += run.period_s * np.count_nonzero(steady)
    ahead, back = (np.array(means[sign]) for sign in (1.0, -1.0))
    nothing = undetermined("kg m^2", _NO_SIGN), undetermined("N m s/rad", _NO_SIGN)
    most = _most_inertia(frames, settings)
    level = load = undetermined("N m", "too little steady motion both ways")
    if (passages := min(len(ahead), len(back))) >= _LEAST_PASSAGES:
        sigma = 0.5 * math.sqrt(np.var(ahead) / len(ahead) + np.var(back) / len(back))
        level = around(0.5 * float(ahead.mean() - back.mean()), sigma, "N m", float(passages))
        load = around(0.5 * float(ahead.mean() + back.mean()), sigma, "N m", float(passages))
    return Mechanics(*nothing, level, load, False, most, seconds)


def identify_mechanics(frames: Sequence[SampleFrame], ratio_m_per_rad: float) -> Mechanics:
    """Identify the parameters, and whether the torque is inverted.

    Raises ValueError: too little motion, or no clock.
    """
    settings = PreparationSettings.sampled(ratio_m_per_rad, frames, CUTOFF_HZ)
    fit = identify_inverse_dynamics(frames, settings)
    found = [fit.parameters[name] for name in ("inertia", "viscous", "coulomb", "offset")]
    clock = clock_of([frame.time_s for frame in frames])
    if clock.is_slow:
        found[0] = undetermined(found[0].unit, TOO_SLOW.format(clock.rate_hz))
    inertia, _, coulomb, offset = found
    told = not (inertia.holds(0.0) and coulomb.holds(0.0))
    inverted = told and (coulomb if inertia.holds(0.0) else inertia).value < 0.0
    share = driven_share(*rows_in_motion(frames, settings)[:2], offset.value)
    if told and abs(share - 0.5) > CLEAR_SHARE:
        inverted = share < 0.5
        if inertia.determined and inertia.scaled(-1.0 if inverted else 1.0, "").high < 0.0:
            driven = f"the torque drives the motion in {100.0 * max(share, 1.0 - share):.0f} %"
            found[0] = undetermined(inertia.unit, f"it reads negative, though {driven} of the rows")
    way, most = -1.0 if inverted else 1.0, _most_inertia(frames, settings)
    inertia, viscous, coulomb, offset = (each.scaled(way, each.unit) for each in found)
    return Mechanics(inertia, viscous, coulomb, offset, inverted, most, fit.seconds, told)


def _most_inertia(frames: Sequence[SampleFrame], settings: PreparationSettings) -> float:
    """Inertia with which the strongest acceleration would take the largest torque, kg m2."""
    runs = [run for frame in frames for run in prepare(frame, settings)]
    torque = np.concatenate([np.abs(run.channels[TORQUE][run.moving]) for run in runs])
    acceleration = np.concatenate([np.abs(run.acceleration_rad_s2[run.moving]) for run in runs])
    strong = float(np.percentile(acceleration, 99.0))
    return float(np.percentile(torque, 99.0)) / strong if strong > 0.0 else 0.0


@dataclass(frozen=True, slots=True)
class Ability:
    """One thing that a user asks for."""

    what: str  # in the user's words
    reason: str  # why not; empty if it can be answered
    motion: str = ""  # of `edge-service motion`, which would answer it; empty if none would

    def as_text(self) -> str:
        if not self.reason:
            return f"{self.what}: yes"
        remedy = f"; record `edge-service motion {self.motion}`" if self.motion else ""
        return f"{self.what}: no, {self.reason}{remedy}"


def abilities(
    columns: Mapping[str, ColumnMap],
    mechanics: Mechanics | None,
    rate_hz: float,
    *,
    has_rating: bool,
    doubt: str = "",
) -> list[Ability]:
    """Answers that these recordings allow or not, in the order in which people ask."""
    unsigned = TORQUE in columns and bool(columns[TORQUE].direction)
    response = f"{rate_hz:.3g} samples/s are too few" if rate_hz < _RESPONSE_HZ else ""
    friction = inertia = "the travel per revolution is unknown, or too little moves", ""
    missing = [name for name in (ANGLE, TABLE_POSITION) if name not in columns]
    if len(missing) == 2:
        response = "no column is known as a position"
    if TORQUE not in columns:
        response = "no column is known as a torque in N m"
        friction = inertia = response, ""
    elif mechanics is not None:
        both_ways = "too little steady motion both ways"
        friction = _lack(mechanics.coulomb, both_ways, "it is not told from none", "friction")
        inertia = mechanics.inertia.note, ""
        if mechanics.inertia.determined:
            inertia = _lack(mechanics.inertia, "", "too little acceleration", "acceleration")
    inertia = (_NO_SIGN, "") if unsigned else inertia
    friction, inertia = (each if each[0] else (doubt, "") for each in (friction, inertia))
    preload = friction
    if not friction[0] and not has_rating:
        preload = "dynamic_load_rating_n and preload_n of the data sheet are missing", ""
    elif not friction[0]:
        not_yet = "the machine file is not commissioned yet (`edge-service commission`)"
        preload = not_yet, "production"
    ends = "the ends of travel are unknown: set axis.stroke_m in the machine file", "acceleration"
    stretch = (f"there is no {' and no '.join(missing)}", "") if missing else ends
    return [
        Ability("friction and its change", *friction),
        Ability("inertia", *inertia),
        Ability("preload in percent", *preload),
        Ability("stretch, play and stiffness between two encoders", *stretch),
        Ability("frequency response, if the motion shakes the axis", response),
    ]


def _lack(found: IntervalEstimate, unseen: str, none: str, motion: str) -> tuple[str, str]:
    """Reason why a parameter is not known, and the motion that would show it; empty if it is."""
    if not found.determined or found.low <= 0.0:
        return none if found.determined else unseen, motion
    wide = found.high - found.low > found.value
    return ("it is known to half of it at best", motion) if wide else ("", "")
