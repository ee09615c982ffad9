"""Check that recordings can be of one axis, by what neither warm-up nor oil nor a load changes."""

import contextlib
import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ..messages.samples import ANGLE, SETPOINT, TABLE_POSITION, TORQUE, SampleFrame
from ..regression.interval_estimate import IntervalEstimate, undetermined
from ..regression.inverse_dynamics import identify_inverse_dynamics
from ..regression.prepared_run import PreparationSettings
from ..regression.run import Run
from .channel_regression import CUTOFF_HZ, regress_channel

LEAST_TRAVEL_M, LONG_TRAVEL_M = 5e-3, 0.1
"""A file that stays within these says nothing of the lead, or nothing that reaches further."""
LEAD_SHARE = 0.02
LAG_RATIO = 1.8
"""The same for a setpoint, which leads its axis: how far depends on its controller."""
LOST_MOTION_M = 2e-4
"""Play, growth and wobble: by so much table and motor part on one axis, wherever it is."""
ZERO_M = 5e-4
INERTIA_RATIO, FRICTION_RATIO = 1.8, 4.0
"""Beyond what compliance and saturation, and what warming up, oil and forces, do to one axis."""
_SIGMAS = 4.0
_LEAST_MOTION_S = 5.0
"""Of motion with a torque: in less a push, or an odd load, passes for friction."""
_NOTHING = undetermined("", "not recorded")


@dataclass(frozen=True, slots=True)
class _Axis:
    """Axis as one file shows it."""

    leads_m: tuple[float, float]  # of table and setpoint; NaN if unknown
    # travel_m, middle_m: range of the motor's angle, as way of the table, and its median
    travel_m: float
    middle_m: float
    zero_m: float  # median of table position minus that of the angle
    inertia: IntervalEstimate
    friction: IntervalEstimate

    @property
    def lead_reach(self) -> float:
        """Share by which a lead may seem off on so short a way."""
        return LEAD_SHARE + LOST_MOTION_M / max(self.travel_m, LEAST_TRAVEL_M)


def by_recording(runs: Iterable[Run]) -> dict[int, list[Run]]:
    found: dict[int, list[Run]] = {}
    for run in runs:
        found.setdefault(run.recording, []).append(run)
    return found


def inconsistency(runs: Sequence[Run], ratio_m_per_rad: float, names: Sequence[str]) -> str | None:
    """Reason why two recordings cannot be of one axis, in a line; None if all can be.

    The ratio is that of the machine file; `names` are those of the recordings, by their number.
    """
    files = sorted(by_recording(runs).items())
    if len(files) < 2:
        return None
    called = dict(enumerate(names))
    axes = [(called.get(k, f"recording {k + 1}"), _axis_of(e, ratio_m_per_rad)) for k, e in files]
    for (one, axis), (other, rival) in itertools.combinations(axes, 2):
        if why := _apart(axis, rival, 2.0 * math.pi * ratio_m_per_rad):
            return f"{one} and {other} are not from the same axis: {why}"
    return None


def _axis_of(runs: Sequence[Run], ratio_m_per_rad: float) -> _Axis:
    frames = []
    for run in runs:
        motion, angle = run.motion, run.motion.angle_rad
        channels = {ANGLE: angle}
        if run.transmission_m is not None:
            channels[TABLE_POSITION] = run.transmission_m + ratio_m_per_rad * angle
        if run.setpoint_m is not None:
            channels[SETPOINT] = run.setpoint_m
        if run.has_torque:
            channels[TORQUE] = motion.torque_nm
        frames.append(SampleFrame(motion.time_s, channels))
    way = ratio_m_per_rad * np.concatenate([frame.channels[ANGLE] for frame in frames])
    travel_m, leads = float(np.ptp(way)), [math.nan, math.nan]
    for k, name in enumerate((TABLE_POSITION, SETPOINT)):
        if travel_m >= LEAST_TRAVEL_M and all(name in frame.channels for frame in frames):
            with contextlib.suppress(ValueError):
                factor = regress_channel(frames, name, ANGLE, mechanics=k == 0).factor
                leads[k] = 2.0 * math.pi * factor.value
    parts = [run.transmission_m for run in runs if run.transmission_m is not None]
    zero_m = float(np.median(np.concatenate(parts))) if len(parts) == len(runs) else math.nan
    dynamics = _dynamics(runs, frames, ratio_m_per_rad)
    return _Axis((leads[0], leads[1]), travel_m, float(np.median(way)), zero_m, *dynamics)


def _dynamics(
    runs: Sequence[Run], frames: Sequence[SampleFrame], ratio_m_per_rad: float
) -> tuple[IntervalEstimate, IntervalEstimate]:
    """Inertia and dry friction, without the rows in which the drive is at its limit."""
    inertia = friction = _NOTHING
    able, torques, moving_s = [], [], 0.0
    for run, frame in zip(runs, frames, strict=True):
        if run.has_torque:
            rows = ~run.clipped
            channels = {name: values[rows] for name, values in frame.channels.items()}
            able.append(run)
            torques.append(SampleFrame(frame.time_s[rows], channels))
            moving_s += float((run.moving & rows).sum()) * run.period_s
    if moving_s >= _LEAST_MOTION_S:
        with contextlib.suppress(ValueError):
            settings = PreparationSettings.sampled(ratio_m_per_rad, torques, CUTOFF_HZ)
            found = identify_inverse_dynamics(torques, settings).parameters
            friction = found["coulomb"]
            if not any(run.misses_acceleration for run in able):
                inertia = found["inertia"]
    return inertia, friction


def _apart(one: _Axis, other: _Axis, lead_m: float) -> str:
    """Reason why two axes are not one; empty if they may be."""
    reaches = max(one.lead_reach, other.lead_reach), 1.0 - 1.0 / LAG_RATIO
    for a, b, most in zip(one.leads_m, other.leads_m, reaches, strict=True):
        if abs(a - b) > most * max(abs(a), abs(b)):
            return f"lead {1e3 * a:.4g} mm against {1e3 * b:.4g} mm"
    # an error of the lead that both share parts the encoders with the way, not the zeros
    known = [each for each in (one, other) if math.isfinite(each.leads_m[0])]
    longer = max(known, key=lambda each: each.travel_m, default=None)
    slope = 0.0
    if longer is not None and longer.travel_m > LONG_TRAVEL_M:
        slope = longer.leads_m[0] / lead_m - 1.0
    apart_m = abs(one.zero_m - other.zero_m - slope * (one.middle_m - other.middle_m))
    if apart_m > ZERO_M:
        return f"at one motor angle their table positions are {1e3 * apart_m:.3g} mm apart"
    if _exceeds(one.inertia, other.inertia, INERTIA_RATIO):
        return f"inertia {one.inertia.value:.3g} kg m2 against {other.inertia.value:.3g} kg m2"
    if _exceeds(one.friction, other.friction, FRICTION_RATIO):
        return f"dry friction {one.friction.value:.3g} N m against {other.friction.value:.3g} N m"
    return ""


def _exceeds(one: IntervalEstimate, other: IntervalEstimate, ratio: float) -> bool:
    """Flag of two positive quantities that are surely more than a factor apart."""
    if not (one.determined and other.determined):
        return False
    low, high = sorted((one, other), key=lambda each: each.value)
    apart = high.value - ratio * max(low.value, 0.0)
    return apart > _SIGMAS * math.hypot(high.sigma, ratio * low.sigma)
