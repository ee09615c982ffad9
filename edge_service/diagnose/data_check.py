"""What is wrong with a recording before anything is fitted to it: units, signs, cover, faults."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..fingerprint.regression import Booleans
from ..messages.samples import Floats
from .recorded import Run

LEAST_MOTION_S = 2.0
SHORT_MOTION_S = 10.0
LEAST_TRAVEL_REV = 0.5
LEAST_RATE_HZ = 50.0
_LEAD_SHARE = 0.02
_GAIN_RANGE = (0.2, 5.0)
_LEAST_CORRELATION = 0.3
_STUCK_SHARE = 0.3
_BETWEEN_FILES = 3.0
_NO_RUN = "no unbroken run of a second or more: rows or channels are missing, or a channel is stuck"


@dataclass(frozen=True, slots=True)
class DataCheck:
    """Faults that forbid a diagnosis, one line each, and remarks that do not."""

    faults: tuple[str, ...]
    remarks: tuple[str, ...]


def check_data(runs: Sequence[Run], ratio_m_per_rad: float) -> DataCheck:
    """Judge the runs of one axis."""
    if not runs:
        return DataCheck((_NO_RUN,), ())
    faults = [*_cover(runs)]
    if not faults:
        faults += [*_units(runs, ratio_m_per_rad), *_stuck(runs), *_torque(runs)]
    return DataCheck(tuple(faults), tuple(_remarks(runs)))


def _cover(runs: Sequence[Run]) -> list[str]:
    period_s = max(_period(run) for run in runs)
    if 1.0 / period_s < LEAST_RATE_HZ:
        return [f"sampled at {1.0 / period_s:.3g} Hz, expected {LEAST_RATE_HZ:g} Hz or more"]
    moving_s = sum(float(run.moving.sum()) * _period(run) for run in runs)
    if moving_s < LEAST_MOTION_S:
        return [f"the axis moves for {moving_s:.2g} s, expected {LEAST_MOTION_S:g} s or more"]
    travel = sum(
        float(np.abs(np.diff(run.motion.angle_rad[:: max(1, round(0.01 / _period(run)))])).sum())
        for run in runs
    )
    if travel < LEAST_TRAVEL_REV * 2.0 * np.pi:
        return [f"the screw turns {travel / 6.2832:.2g} revolutions in all, expected more"]
    return []


def _period(run: Run) -> float:
    return float(run.motion.time_s[1] - run.motion.time_s[0])


def _units(runs: Sequence[Run], ratio_m_per_rad: float) -> list[str]:
    """Table against motor: the lead says how far one turn goes."""
    found = []
    for run in runs:
        if run.transmission_m is None:
            continue
        angle, table = run.motion.angle_rad * ratio_m_per_rad, run.motion.position_m
        spread = float(np.var(angle))
        if spread <= 0.0:
            continue
        slope = float(np.cov(angle, table)[0, 1]) / float(np.var(angle, ddof=1))
        if abs(slope - 1.0) > _LEAD_SHARE:
            what = "its sign is turned" if slope < 0.0 else "a unit or the lead is wrong"
            found.append(
                f"table_position_m moves {slope:.3g} times as far as motor_angle_rad says: {what}"
            )
    return found[:1]


def _stuck(runs: Sequence[Run]) -> list[str]:
    moving = np.concatenate(
        [run.moving[1:] for run in runs if run.has_torque] or [np.zeros(0, bool)]
    )
    still = np.concatenate(
        [_repeats(run.motion.torque_nm) for run in runs if run.has_torque] or [np.zeros(0, bool)]
    )
    if moving.any() and float(still[moving].mean()) > _STUCK_SHARE:
        return ["torque_command_nm does not change while the axis moves"]
    return []


def _repeats(values: Floats) -> Booleans:
    found: Booleans = np.abs(np.diff(values)) <= 1e-12 * max(float(np.abs(values).max()), 1e-12)
    return found


def _torque(runs: Sequence[Run]) -> list[str]:
    """Torque against the model: sign and scale must be of the same kind."""
    found: list[str] = []
    gains: dict[int, float] = {}
    for run in runs:
        if not run.has_torque or run.moving.sum() < 100:
            continue
        model, torque = run.motion.model_torque_nm[run.moving], run.motion.torque_nm[run.moving]
        gains[run.recording] = float(model @ torque) / max(float(model @ model), 1e-300)
    if not gains:
        return found
    middle = float(np.median(list(gains.values())))
    if middle < -0.2:
        return ["torque_command_nm has the wrong sign: it drives against the motion"]
    if not _GAIN_RANGE[0] < abs(middle) < _GAIN_RANGE[1]:
        return [
            f"torque_command_nm is {middle:.3g} times what the machine file needs: "
            "expected N m at the motor shaft; a unit, the inertia or the machine file is wrong"
        ]
    spread = max(gains.values()) / max(min(gains.values()), 1e-9)
    if len(gains) > 1 and spread > _BETWEEN_FILES:
        found.append("the recordings differ too much to be of one axis")
    return found


def _remarks(runs: Sequence[Run]) -> list[str]:
    found = []
    moving_s = sum(float(run.moving.sum()) * _period(run) for run in runs)
    if moving_s < SHORT_MOTION_S:
        found.append(f"{moving_s:.0f} s of motion in all: what shows seldom or weakly is not seen")
    if not any(run.has_torque for run in runs):
        found.append("no torque_command_nm: friction, inertia and torque are not judged")
    if all(run.transmission_m is None for run in runs):
        found.append("one encoder only: nothing between motor and table is judged")
    if len(runs) > len({run.recording for run in runs}):
        found.append(f"gaps in the recording: {len(runs)} unbroken runs")
    speeds = np.concatenate([np.abs(run.motion.speed_rad_s[run.moving]) for run in runs])
    if speeds.size and float(np.quantile(speeds, 0.95)) < 3.0 * float(np.quantile(speeds, 0.05)):
        found.append("nearly one speed only: the shapes of friction cannot be told apart")
    return found
