"""Lag of the torque behind the acceleration it makes, from phases that touch.

A torque that is late by tau reads J (a(t - tau)): its mean over a phase misses
J tau (a_end - a_begin) / steady_s, where the accelerations at both borders come from the phases
beside it. Motion of the shaft needs no finer samples than that.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...messages.samples import Floats
from .robust_regression import robust_regression
from .steady_phases import SteadyPhases

LEAST_PHASES = 20
"""Least number of phases between two others for a lag."""
_TOUCHING = 0.3
"""Tolerance of the way between two touching phases against that at their speeds, as a share."""


@dataclass(frozen=True, slots=True)
class TorqueLag:
    """Lag of the torque behind the motion it makes, and its standard deviation, s."""

    value_s: float
    sigma_s: float


def torque_lag(phases: SteadyPhases) -> TorqueLag | None:
    """Lag of the torque; None where hardly any phase lies between two others."""
    ordered = _in_order(phases)
    inner, jerk = _jerk(ordered)
    if np.count_nonzero(inner) < LEAST_PHASES:
        return None
    rows, v = ordered.where(inner), ordered.speed_rad_s[inner]
    motion = [rows.acceleration_rad_s2, v, np.abs(v), rows.direction]
    columns = np.column_stack([*motion, np.ones(len(rows)), -jerk[inner]])
    fit = robust_regression(columns, rows.torque_nm, rows, np.full(columns.shape[1], np.inf))
    inertia = float(fit.value[0])
    if inertia <= 0.0:
        return None
    return TorqueLag(float(fit.value[-1]) / inertia, float(fit.sigma[-1]) / inertia)


def _in_order(phases: SteadyPhases) -> SteadyPhases:
    """Phases as the axis went through them."""
    order = np.lexsort((phases.angle_rad * phases.direction, phases.time_s, phases.run))
    return phases.at(order)


def _jerk(phases: SteadyPhases) -> tuple[npt.NDArray[np.bool_], Floats]:
    """Mask of phases that touch others at both ends, and their mean jerk, rad/s3, (n,) each."""
    inner = np.zeros(len(phases), dtype=bool)
    if len(phases) < 3:
        return inner, np.zeros(len(phases))
    steady_s, acceleration = phases.steady_s, phases.acceleration_rad_s2
    touching = _touching(phases)
    inner[1:-1] = touching[:-1] & touching[1:]
    share = steady_s[:-1] / (steady_s[:-1] + steady_s[1:])
    border = acceleration[:-1] + share * np.diff(acceleration)
    return inner, np.diff(border, prepend=border[:1], append=border[-1:]) / steady_s


def _touching(phases: SteadyPhases) -> npt.NDArray[np.bool_]:
    """Mask of phases that continue in the next one, (n - 1,)."""
    way = 0.5 * np.abs(phases.speed_rad_s) * phases.steady_s
    expected = way[:-1] + way[1:]
    same = (np.diff(phases.run) == 0.0) & (np.diff(phases.direction) == 0.0)
    off = np.abs(np.abs(np.diff(phases.angle_rad)) - expected)
    return np.asarray(same & (off <= _TOUCHING * expected))
