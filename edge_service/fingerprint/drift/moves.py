"""Moves of a recording, each between two turns or rests, with what they cost."""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...messages.channels import ANGLE, SETPOINT, TABLE_POSITION, TEMPERATURE, TORQUE
from ...messages.samples import Floats, SampleFrame
from ...regression.prepared_run import PreparationSettings, PreparedRun, prepare

CUTOFF_HZ = 20.0
_REST_SHARE = 0.02
"""Slower than this share of the fastest move is rest."""
_STEADY_SHARE = 0.95
"""Torque is read where a move has this share of its speed: nothing accelerates there."""
_TOP = 0.75
"""Quantile that is the speed of a move: the low-pass rings at its corners."""
_LEAST_STEADY = 4

TORQUE_NM, FOLLOWING_M, STRETCH_M, SPREAD_NM, TEMPERATURE_C = (
    "torque_nm",
    "following_error_m",
    "stretch_m",
    "torque_spread_nm",
    "temperature_c",
)


@dataclass(frozen=True, slots=True)
class Move:
    """One move of the table.

    Attributes:
        context: values of what a section is told by beside its course (tool, block), in order.
        start_m, end_m: of its course: the set point where there is one, else the position.
        speed_m_s: its speed; negative towards the motor's zero.
        duration_s: between rests.
        figures: mean torque, following error, stretch (motor's encoder less the table's), spread
            of the torque, temperature; over the part at speed, as far as recorded, SI units.
    """

    context: tuple[float, ...]
    start_m: float
    end_m: float
    speed_m_s: float
    duration_s: float
    figures: dict[str, float]


def find_moves(
    frames: Iterable[SampleFrame],
    ratio_m_per_rad: float,
    context: tuple[float, ...] = (),
) -> list[Move]:
    """Moves of one recording, in its order.

    Raises:
        ValueError: one line; torque and position are missing, or the clock stands.
    """
    known = [frame for frame in frames if len(frame)]
    settings = PreparationSettings.sampled(ratio_m_per_rad, known, CUTOFF_HZ)
    runs = list(prepare(known, settings))
    courses = [_course(run) for run in runs]
    speeds = [np.gradient(course, run.period_s) for course, run in zip(courses, runs, strict=True)]
    fastest = max((float(np.abs(speed).max()) for speed in speeds), default=0.0)
    return [
        move
        for run, course, speed in zip(runs, courses, speeds, strict=True)
        for move in _moves_of(run, course, speed, _REST_SHARE * fastest, context)
    ]


def by_context(
    frames: Sequence[SampleFrame], names: Sequence[str]
) -> Iterator[tuple[tuple[float, ...], list[SampleFrame]]]:
    """Pieces of a recording in which these columns keep their values, with the values."""
    if not names:
        yield (), list(frames)
        return
    for frame in frames:
        labels = np.column_stack([frame.channels[name] for name in names])
        turns = np.flatnonzero((labels[1:] != labels[:-1]).any(axis=1)) + 1
        for start, stop in zip([0, *turns], [*turns, len(frame)], strict=True):
            rows = slice(start, stop)
            channels = {name: values[rows] for name, values in frame.channels.items()}
            yield tuple(labels[start]), [SampleFrame(frame.time_s[rows], channels)]


def _course(run: PreparedRun) -> Floats:
    if SETPOINT in run.channels:
        return run.channels[SETPOINT]
    return run.settings.ratio_m_per_rad * run.channels[ANGLE]


def _moves_of(
    run: PreparedRun, course: Floats, speed: Floats, rest_m_s: float, context: tuple[float, ...]
) -> Iterator[Move]:
    way = np.where(np.abs(speed) > rest_m_s, np.sign(speed), 0.0)
    turns = [0, *(np.flatnonzero(np.diff(way)) + 1).tolist(), len(way)]
    for start, stop in itertools.pairwise(turns):
        if way[start] == 0.0:
            continue
        top = float(np.quantile(np.abs(speed[start:stop]), _TOP))
        steady = start + np.flatnonzero(np.abs(speed[start:stop]) >= _STEADY_SHARE * top)
        if steady.size < _LEAST_STEADY:
            continue
        yield Move(
            context,
            float(course[start]),
            float(course[stop - 1]),
            math.copysign(top, way[start]),
            (stop - start) * run.period_s,
            _figures(run, steady),
        )


def _figures(run: PreparedRun, rows: npt.NDArray[np.intp]) -> dict[str, float]:
    torque = run.channels[TORQUE][rows]
    motor_m = run.settings.ratio_m_per_rad * run.channels[ANGLE][rows]
    table = run.channels.get(TABLE_POSITION)
    table_m = motor_m if table is None else table[rows]
    found = {TORQUE_NM: float(torque.mean()), SPREAD_NM: float(torque.std())}
    if SETPOINT in run.channels:
        found[FOLLOWING_M] = float(np.mean(run.channels[SETPOINT][rows] - table_m))
    if np.any(motor_m != table_m):  # else one encoder stands for both
        found[STRETCH_M] = float(np.mean(motor_m - table_m))
    if TEMPERATURE in run.channels:
        found[TEMPERATURE_C] = float(run.channels[TEMPERATURE][rows].mean())
    return found
