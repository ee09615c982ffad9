"""Momentum balance over windows of tenths of a second, from the ends of the intervals.

Phases difference the angle over a few milliseconds. Where the encoder is coarse, the samples are
slow or the torque comes late, that shrinks the inertia; over windows a hundred times as wide it
does not. Both are the same divided second difference, of the angle and of the torque integrated
twice, so both give the same inertia of a true axis (thesis, eq. 4.3.4).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np

from ...messages.features import FeatureBlock
from ...messages.samples import Floats
from .robust_regression import robust_regression
from .steady_phases import SteadyPhases

LEAST_WINDOWS = 20
LEAST_MOVING = 0.9
"""Share of an interval in motion below which its torque may be anything."""
_EDGE_SLACK = 1e-3


@dataclass(frozen=True, slots=True)
class WideInertia:
    """Inertia over windows of one width.

    Attributes:
        half_width_s: of the triangular windows, s.
        inertia_kg_m2, sigma: with its standard deviation.
    """

    half_width_s: float
    inertia_kg_m2: float
    sigma: float


def wide_inertia(
    recordings: Sequence[Sequence[FeatureBlock]], intervals: int
) -> WideInertia | None:
    """Inertia over windows with a half width of so many intervals; None without motion."""
    found = [
        _windows(run, path, intervals)
        for run, path in enumerate(_paths(recordings))
        if len(path) > 2 * intervals
    ]
    rows = _together(found)
    if rows is None or len(rows) < LEAST_WINDOWS:
        return None
    columns = _columns(rows)
    fit = robust_regression(columns, rows.torque_nm, rows, np.full(columns.shape[1], np.inf))
    half_width_s = 0.5 * float(np.median(rows.steady_s))
    return WideInertia(half_width_s, float(fit.value[0]), float(fit.sigma[0]))


def _columns(rows: SteadyPhases) -> Floats:
    """Acceleration, speed, direction and offset, (n, 4)."""
    motion = [rows.acceleration_rad_s2, rows.speed_rad_s, rows.direction]
    return np.column_stack([*motion, np.ones(len(rows))])


def _paths(recordings: Sequence[Sequence[FeatureBlock]]) -> list[Floats]:
    """Unbroken motion as time, angle and second integrals at the ends of its intervals.

    Returns:
        (n + 1, 5) for each n usable intervals that follow one another.
    """
    return [_path(run) for blocks in recordings for run in _unbroken(blocks)]


def _unbroken(blocks: Sequence[FeatureBlock]) -> Iterator[list[FeatureBlock]]:
    """Intervals in motion, parted where one is missing."""
    run: list[FeatureBlock] = []
    for block in blocks:
        follows = bool(run) and _follows(run[-1], block)
        able = block.usable and block.moving_fraction >= LEAST_MOVING
        if run and not (follows and able):
            yield run
            run = []
        if able:
            run.append(block)
    if run:
        yield run


def _follows(before: FeatureBlock, block: FeatureBlock) -> bool:
    gap_s = abs(block.time_s - block.duration_s - before.time_s)
    return gap_s <= _EDGE_SLACK * block.duration_s


def _path(run: Sequence[FeatureBlock]) -> Floats:
    steps_s = np.array([each.duration_s for each in run])
    mean = np.array([[each.torque_mean_nm, 0.0, each.direction_mean] for each in run])
    lever = np.array([[each.torque_lever_nm, 0.0, each.direction_lever] for each in run])
    once = np.cumsum(mean * steps_s[:, None], axis=0) - mean * steps_s[:, None]
    twice = once * steps_s[:, None] + lever * steps_s[:, None] ** 2
    twice[:, 1] = [each.angle_mean_rad * each.duration_s for each in run]
    angle = [run[0].angle_start_rad, *(each.angle_end_rad for each in run)]
    integrals = np.vstack([np.zeros(3), np.cumsum(twice, axis=0)])
    return np.column_stack([np.concatenate([[0.0], np.cumsum(steps_s)]), angle, integrals])


def _windows(run: int, path: Floats, intervals: int) -> SteadyPhases:
    """Means under triangular windows of twice so many intervals as rows of a regression."""
    before, here, behind = path[: -2 * intervals], path[intervals:-intervals], path[2 * intervals :]
    came = (here - before) / (here[:, :1] - before[:, :1])
    goes = (behind - here) / (behind[:, :1] - here[:, :1])
    span_s = behind[:, 0] - before[:, 0]
    _, acceleration, torque, speed, direction = (2.0 * (goes - came) / span_s[:, None]).T
    unknown = np.full(len(here), np.nan)
    return SteadyPhases(
        run=np.full(len(here), float(run)),
        time_s=here[:, 0],
        steady_s=span_s,
        direction=direction,
        torque_nm=torque,
        acceleration_rad_s2=acceleration,
        speed_rad_s=speed,
        angle_rad=unknown,
        table_m=unknown,
    )


def _together(parts: Sequence[SteadyPhases]) -> SteadyPhases | None:
    """Rows of all parts after one another; None without parts."""
    if not parts:
        return None
    names = [field.name for field in fields(SteadyPhases)]
    return SteadyPhases(
        *(np.concatenate([getattr(each, name) for each in parts]) for name in names)
    )
