"""Checks of a session before anything is fitted to it: motion, units, signs, one axis."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..messages.samples import TORQUE
from ..regression.run import Run
from .finding import usual_mistake, wrongly
from .same_axis import by_recording, inconsistency
from .torque import INVERTED

LEAST_MOTION_S = 2.0
SHORT_MOTION_S = 10.0
LEAST_TRAVEL_REV = 0.5
LEAST_RATE_HZ = 20.0
_GAIN_RANGE = (0.2, 5.0)
_FRICTION_RANGE = (0.03, 30.0)
"""The same where the torque shows nothing but friction, of which a data sheet says little."""
_LEAST_INERTIAL = 0.02
"""Of the model's energy: with less of it no friction could stand in for, the inertia is unseen."""
_LEAST_MOVING = 100
_NO_RUN = (
    "no unbroken run of a second or more: recordings are too short, rows or values are missing, or "
    "a channel is stuck"
)
_RATE = f"expected {LEAST_RATE_HZ:g} or more; is time_s in seconds?"


@dataclass(frozen=True, slots=True)
class DataCheck:
    """Faults that forbid a diagnosis, one line each, and remarks that do not."""

    faults: tuple[str, ...]
    remarks: tuple[str, ...]


def check_data(runs: Sequence[Run], ratio_m_per_rad: float, names: Sequence[str] = ()) -> DataCheck:
    """Check the runs of one axis; `names` are those of the recordings, by their number."""
    if not runs:
        return DataCheck((_NO_RUN,), ())
    if any(len(run.motion) < 2 for run in runs):
        return DataCheck((f"too few samples to know the sampling rate, {_RATE}",), ())
    faults = _cover(runs)
    if not faults and (mixed := inconsistency(runs, ratio_m_per_rad, names)):
        faults = [mixed]
    return DataCheck(tuple(faults or _torque(runs)), tuple(_remarks(runs)))


def _cover(runs: Sequence[Run]) -> list[str]:
    period_s = max(run.period_s for run in runs)
    if 1.0 / period_s < LEAST_RATE_HZ:
        return [f"{1.0 / period_s:.3g} samples/s, {_RATE}"]
    moving_s = sum(float(run.moving.sum()) * run.period_s for run in runs)
    if moving_s < LEAST_MOTION_S:
        return [f"the axis moves for {moving_s:.2g} s, expected {LEAST_MOTION_S:g} s or more"]
    travel = sum(
        float(np.abs(np.diff(run.motion.angle_rad[:: max(1, round(0.01 / run.period_s))])).sum())
        for run in runs
    )
    if travel < LEAST_TRAVEL_REV * 2.0 * np.pi:
        return [
            f"the screw turns {travel / 6.2832:.2g} revolutions in all, "
            f"expected {LEAST_TRAVEL_REV:g} or more"
        ]
    return []


def _torque(runs: Sequence[Run]) -> list[str]:
    """Torque against the model: sign and scale must be of the same kind."""
    middle = _gain(runs, _whole_gain)
    if middle < -0.2:
        return [f"{INVERTED}it drives against the motion"]
    if math.isnan(middle) or _GAIN_RANGE[0] < abs(middle) < _GAIN_RANGE[1]:
        return []
    gain, (low, high) = _gain(runs, _inertial_gain), _FRICTION_RANGE
    is_friction = math.isnan(gain) and low < abs(middle) < high
    if is_friction or _GAIN_RANGE[0] < gain < _GAIN_RANGE[1]:
        return []
    return [
        f"{TORQUE} looks {wrongly(middle)}{usual_mistake(abs(middle), TORQUE)}: expected N m at "
        "the motor shaft; a unit, the inertia or the file is wrong, or rows are filled in"
    ]


def _gain(runs: Sequence[Run], of: Callable[[Run], float]) -> float:
    """Median over the recordings of the torque over that of the model; NaN where none shows it."""
    able = [run for run in runs if run.has_torque and run.moving.sum() >= _LEAST_MOVING]
    gains = {run.recording: gain for run in able if not math.isnan(gain := of(run))}
    return float(np.median(list(gains.values()))) if gains else math.nan


def _whole_gain(run: Run) -> float:
    """Gain by the energy, or by the middle row if that is less: a unit scales every row."""
    model, torque = run.motion.model_torque_nm[run.moving], run.motion.torque_nm[run.moving]
    whole = float(model @ torque) / max(float(model @ model), 1e-300)
    typical = float(np.median(np.abs(torque))) / max(float(np.median(np.abs(model))), 1e-300)
    return math.copysign(min(abs(whole), typical), whole)


def _inertial_gain(run: Run) -> float:
    """Gain of that part of the model which no friction can stand in for; NaN where that is none."""
    motion, moving = run.motion, run.moving
    friction = np.column_stack((motion.direction, motion.speed_rad_s, np.ones(len(moving))))
    model, torque = motion.model_torque_nm[moving], motion.torque_nm[moving]
    both = np.column_stack((model, torque))
    rest = both - friction[moving] @ np.linalg.lstsq(friction[moving], both, rcond=None)[0]
    own = float(rest[:, 0] @ rest[:, 0])
    if own < _LEAST_INERTIAL * float(model @ model):
        return math.nan
    return float(rest[:, 0] @ rest[:, 1]) / own


def _remarks(runs: Sequence[Run]) -> list[str]:
    found = []
    moving_s = sum(float(run.moving.sum()) * run.period_s for run in runs)
    if moving_s < SHORT_MOTION_S:
        found.append(
            f"{moving_s:.0f} s of motion in all: causes that show rarely or weakly are not found"
        )
    if not any(run.has_torque for run in runs):
        found.append(f"no {TORQUE}: friction, inertia and torque are not judged")
    if all(run.transmission_m is None for run in runs):
        found.append("one encoder only: what happens between motor and table is not judged")
    gain = abs(_gain(runs, _whole_gain))
    if not _torque(runs) and (gain < _GAIN_RANGE[0] or gain > _GAIN_RANGE[1]):
        found.append(
            f"friction is {gain:.2g} times what the machine file says: a torque in a wrong unit "
            "would look the same"
        )
    found += _gaps(runs)
    moving = sum(int(run.moving.sum()) for run in runs)
    clipped = sum(int((run.clipped & run.moving).sum()) for run in runs)
    if clipped:
        found.append(
            f"{100.0 * clipped / moving:.2g} % of the motion takes more than the drive's torque "
            "limit: its torque is not compared"
        )
    speeds = np.concatenate([np.abs(run.motion.speed_rad_s[run.moving]) for run in runs])
    if speeds.size and float(np.quantile(speeds, 0.95)) < 3.0 * float(np.quantile(speeds, 0.05)):
        found.append("hardly more than one speed: kinds of friction cannot be told apart")
    return found


def _gaps(runs: Sequence[Run]) -> list[str]:
    """Remark on how much of the time between first and last rows is there, if not all of it is."""
    files = by_recording(runs)
    if len(files) == len(runs):
        return []
    held_s = sum(run.duration_s for run in runs)
    spans = [
        max(run.motion.time_s[-1] for run in file) - min(run.motion.time_s[0] for run in file)
        for file in files.values()
    ]
    if held_s > 0.8 * sum(spans):
        return [f"gaps in the recording: {len(runs)} unbroken runs"]
    return [f"evaluated: {held_s:.0f} of {sum(spans):.0f} s, in {len(runs)} runs spread over them"]
