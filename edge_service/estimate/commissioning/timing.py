"""Torque and motion that are not of the same moment, or too coarse: by lag, and by wide windows."""

from collections.abc import Iterator, Sequence

import numpy as np

from ...messages.features import FeatureBlock
from ...messages.samples import Floats
from .phases import SteadyPhases, place_columns, robust_regression
from .shares import SIGMAS
from .torque_balance import TorqueBalance

LEAST_PHASES = 20
"""Least number of phases between two others for a lag."""
TOUCHING = 0.3
"""Tolerance of the way between two touching phases against that at their speeds, as a share."""
LEAST_WINDOWS = 20
SURE = 0.1
"""Relative standard deviation beyond which inertia or friction is not known."""
LEAST_MOVING = 0.9
"""Share of an interval in motion below which its torque may be anything."""
_EDGE_SLACK = 1e-3


def torque_lag(phases: SteadyPhases) -> tuple[float, float] | None:
    """Lag of the torque behind the motion it makes, and its standard deviation, s.

    A torque that is late by tau reads J (a(t - tau)): its mean over a phase misses
    J tau (a_end - a_begin) / steady_s, where the accelerations at both borders come from the phases
    beside it. Motion of the shaft needs no finer samples than that. None where hardly any phase
    lies between two others.
    """
    order = np.lexsort((phases.angle_rad * phases.direction, phases.time_s, phases.run))
    phases = phases.at(order)
    if len(phases) < LEAST_PHASES:
        return None
    steady_s, acceleration = phases.steady_s, phases.acceleration_rad_s2
    way = 0.5 * np.abs(phases.speed_rad_s) * steady_s
    expected = way[:-1] + way[1:]
    touching = (np.diff(phases.run) == 0.0) & (np.diff(phases.direction) == 0.0)
    touching &= np.abs(np.abs(np.diff(phases.angle_rad)) - expected) <= TOUCHING * expected
    inner = np.zeros(len(phases), dtype=bool)
    inner[1:-1] = touching[:-1] & touching[1:]
    if np.count_nonzero(inner) < LEAST_PHASES:
        return None
    share = steady_s[:-1] / (steady_s[:-1] + steady_s[1:])
    border = acceleration[:-1] + share * np.diff(acceleration)
    jerk = np.diff(border, prepend=border[:1], append=border[-1:]) / steady_s
    rows, v = phases.where(inner), phases.speed_rad_s[inner]
    motion = [rows.acceleration_rad_s2, v, np.abs(v), rows.direction]
    columns = np.column_stack([*motion, np.ones(len(rows)), -jerk[inner]])
    fit = robust_regression(columns, rows.torque_nm, rows, np.full(columns.shape[1], np.inf))
    inertia = float(fit.value[0])
    if inertia <= 0.0:
        return None
    return float(fit.value[-1]) / inertia, float(fit.sigma[-1]) / inertia


def inertia_doubt(recordings: Sequence[Sequence[FeatureBlock]], torque: TorqueBalance) -> float:
    """Standard deviation, kg m2, by which the inertia of short windows misses that of wide ones.

    Phases difference the angle over a few milliseconds. Where the encoder is coarse, the samples
    are slow or the torque comes late, that shrinks the inertia; over windows of whole intervals it
    does not. Both are the same divided second difference, of the angle and of the torque integrated
    twice, so both give the same inertia of a true axis (thesis, eq. 4.3.4). What parts them beyond
    what friction and noise explain is doubt, as between two laboratories (DerSimonian, Laird 1986).
    """
    runs = [(k, run) for k, blocks in enumerate(recordings) for run in _unbroken(blocks)]
    found = [_windows(k, run) for k, run in runs if len(run) >= 2]
    rows = SteadyPhases(*np.concatenate([np.empty((9, 0)), *found], axis=1))
    if len(rows) < LEAST_WINDOWS:
        return 0.0
    place = place_columns(rows)
    motion = [rows.acceleration_rad_s2, rows.speed_rad_s, rows.direction, np.ones(len(rows))]
    columns = np.column_stack([*motion, place])
    level = float(np.median(np.abs(rows.torque_nm)))
    prior_sigma = np.array([np.inf] * 4 + [0.5 * level] * place.shape[1])
    fit = robust_regression(columns, rows.torque_nm, rows, prior_sigma)
    # friction that the model leaves over is the same in all moves, and more of them do not average
    # it out; all of it along the acceleration is the most it can do (Cauchy, Schwarz): three sigmas
    left = fit.residual / np.sqrt(fit.noise.variance(rows.steady_s, rows.speed_rad_s))
    by_friction = float(fit.sigma[0]) * max(float(np.linalg.norm(left)) / SIGMAS, 1.0)
    apart = abs(float(fit.value[0]) - torque.inertia_kg_m2)
    if by_friction > SURE * torque.inertia_kg_m2 and apart < SIGMAS * by_friction:
        return 0.0  # intervals cannot tell
    return float(np.sqrt(max(apart**2 - by_friction**2 - torque.inertia_sigma**2, 0.0)))


def _unbroken(blocks: Sequence[FeatureBlock]) -> Iterator[list[FeatureBlock]]:
    """Intervals in motion, parted where one is missing."""
    run: list[FeatureBlock] = []
    for block in blocks:
        able = block.usable and block.moving_fraction >= LEAST_MOVING
        gap_s = abs(block.time_s - block.duration_s - run[-1].time_s) if run else 0.0
        if run and not (able and gap_s <= _EDGE_SLACK * block.duration_s):
            yield run
            run = []
        if able:
            run.append(block)
    if run:
        yield run


def _windows(number: int, run: Sequence[FeatureBlock]) -> Floats:
    """Means under windows of two intervals, as rows of SteadyPhases, (9, n).

    A path of time, angle and second integrals at the ends of the intervals gives them.
    """
    steps_s = np.array([each.duration_s for each in run])[:, None]
    mean = np.array([[each.torque_mean_nm, 0.0, each.direction_mean] for each in run])
    lever = np.array([[each.torque_lever_nm, 0.0, each.direction_lever] for each in run])
    once = np.cumsum(mean * steps_s, axis=0) - mean * steps_s
    twice = once * steps_s + lever * steps_s**2
    twice[:, 1] = [each.angle_mean_rad * each.duration_s for each in run]
    angle = [run[0].angle_start_rad, *(each.angle_end_rad for each in run)]
    integrals = np.vstack([np.zeros(3), np.cumsum(twice, axis=0)])
    path = np.column_stack([np.concatenate([[0.0], np.cumsum(steps_s)]), angle, integrals])
    before, here, behind = path[:-2], path[1:-1], path[2:]
    came = (here - before) / (here[:, :1] - before[:, :1])
    goes = (behind - here) / (behind[:, :1] - here[:, :1])
    span_s = behind[:, 0] - before[:, 0]
    _, acceleration, torque, speed, direction = (2.0 * (goes - came) / span_s[:, None]).T
    unknown = np.full(len(here), np.nan)
    steady = (np.full(len(here), float(number)), here[:, 0], span_s, direction)
    return np.array([*steady, torque, acceleration, speed, here[:, 1], unknown])
