"""Moves of recordings, each between two turns or rests, and those that several recordings share."""

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..messages.samples import ANGLE, SETPOINT, TABLE_POSITION, TEMPERATURE, TORQUE, SampleFrame
from ..regression.prepared_run import PreparationSettings, PreparedRun, prepare

CUTOFF_HZ = 20.0
_REST_SHARE = 0.02
"""Slower than this share of the fastest move is rest."""
_STEADY_SHARE = 0.95
"""Torque is read where a move has this share of its speed: nothing accelerates there."""
_TOP = 0.75
"""Quantile that is the speed of a move: the low-pass rings at its corners."""
_LEAST_STEADY = 4
FEWEST_REPEATS = 3
MOST_SECTIONS = 8
"""Of more, those with the most repeats are compared: each comparison makes all intervals wider."""
_SAME_WAY = 0.02
"""Moves are the same if they begin, end and run alike within this share of their way and speed."""
_SAME_DURATION = 0.1

TORQUE_NM, FOLLOWING_M, STRETCH_M = "torque_nm", "following_error_m", "stretch_m"
SPREAD_NM, TEMPERATURE_C = "torque_spread_nm", "temperature_c"


@dataclass(frozen=True, slots=True)
class Move:
    # values of what a section is told by beside its course (tool, block), in order
    context: tuple[float, ...]
    # start_m, end_m: of its course: the set point where there is one, else the position
    start_m: float
    end_m: float
    speed_m_s: float  # its speed; negative towards the motor's zero
    duration_s: float  # between rests
    # mean torque, following error, stretch (motor's encoder less the table's), spread of the
    # torque, temperature; over the part at speed, as far as recorded, SI units
    figures: dict[str, float]

    @property
    def turned(self) -> "Move":
        """The same course in the other direction."""
        return replace(self, start_m=self.end_m, end_m=self.start_m, speed_m_s=-self.speed_m_s)


def find_moves(frame: SampleFrame, ratio_m_per_rad: float, names: Sequence[str] = ()) -> list[Move]:
    """Moves of one recording, in its order.

    Args:
        names: columns that keep their values throughout a move: its context.

    Raises ValueError: torque and position are missing, or the clock stands.
    """
    moves = []
    for context, part in _by_context(frame, names):
        settings = PreparationSettings.sampled(ratio_m_per_rad, [part], CUTOFF_HZ)
        runs = list(prepare(part, settings))
        courses = [r.channels.get(SETPOINT, ratio_m_per_rad * r.channels[ANGLE]) for r in runs]
        speeds = [np.gradient(c, run.period_s) for c, run in zip(courses, runs, strict=True)]
        fastest = max((float(np.abs(speed).max()) for speed in speeds), default=0.0)
        for run, course, speed in zip(runs, courses, speeds, strict=True):
            way = np.where(np.abs(speed) > _REST_SHARE * fastest, np.sign(speed), 0.0)
            turns = [0, *(np.flatnonzero(np.diff(way)) + 1).tolist(), len(way)]
            for start, stop in itertools.pairwise(turns):
                top = float(np.quantile(np.abs(speed[start:stop]), _TOP))
                steady = start + np.flatnonzero(np.abs(speed[start:stop]) >= _STEADY_SHARE * top)
                if way[start] != 0.0 and steady.size >= _LEAST_STEADY:
                    ends_m = float(course[start]), float(course[stop - 1])
                    run_s, speed_m_s = (stop - start) * run.period_s, math.copysign(top, way[start])
                    moves.append(Move(context, *ends_m, speed_m_s, run_s, _figures(run, steady)))
    return moves


def _by_context(
    frame: SampleFrame, names: Sequence[str]
) -> Iterator[tuple[tuple[float, ...], SampleFrame]]:
    """Pieces of a recording in which these columns keep their values, with the values."""
    if not names:
        yield (), frame
        return
    labels = np.column_stack([frame.channels[name] for name in names])
    turns = (np.flatnonzero((labels[1:] != labels[:-1]).any(axis=1)) + 1).tolist()
    for start, stop in itertools.pairwise([0, *turns, len(frame)]):
        channels = {name: values[start:stop] for name, values in frame.channels.items()}
        yield tuple(labels[start]), SampleFrame(frame.time_s[start:stop], channels)


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


@dataclass(frozen=True, slots=True)
class Section:
    """One move, or one move there and back, in every recording."""

    # repeats in each recording; the first of all is the pattern
    there: tuple[tuple[Move, ...], ...]
    # of the same way back at the same speed; empty where there is none
    back: tuple[tuple[Move, ...], ...] = ()

    @property
    def pattern(self) -> Move:
        """Move that the others are like."""
        return self.there[0][0]

    @property
    def both_ways(self) -> bool:
        """Moves in both directions, which tell friction from a load."""
        return bool(self.back)

    @property
    def repeats(self) -> tuple[int, ...]:
        """In each recording, of the direction that has fewer."""
        there = (len(moves) for moves in self.there)
        if not self.back:
            return tuple(there)
        return tuple(min(one, len(other)) for one, other in zip(there, self.back, strict=True))


def common_sections(recordings: Sequence[Sequence[Move]]) -> list[Section]:
    """Moves that every recording repeats, in the order of the first; there and back as one."""
    members: list[list[list[Move]]] = []
    patterns: list[Move] = []
    for place, moves in enumerate(recordings):
        for move in moves:
            known = next((k for k, each in enumerate(patterns) if is_same(each, move)), None)
            if known is None:
                known = len(patterns)
                patterns.append(move)
                members.append([[] for _ in recordings])
            members[known][place].append(move)
    kinds = [tuple(map(tuple, kind)) for kind in members if min(map(len, kind)) >= FEWEST_REPEATS]
    sections: list[Section] = []
    taken: set[int] = set()
    for number, kind in enumerate(kinds):
        if number in taken:
            continue
        open_ = (k for k in range(number + 1, len(kinds)) if k not in taken)
        back = next((k for k in open_ if is_same(kind[0][0], kinds[k][0][0].turned)), None)
        taken |= {number} if back is None else {number, back}
        sections.append(Section(kind, () if back is None else kinds[back]))
    most = sorted(sections, key=lambda each: -min(each.repeats))[:MOST_SECTIONS]
    return [each for each in sections if each in most]


def is_same(first: Move, second: Move) -> bool:
    way_m = _SAME_WAY * abs(first.end_m - first.start_m)
    return (
        first.context == second.context
        and abs(first.start_m - second.start_m) <= way_m
        and abs(first.end_m - second.end_m) <= way_m
        and abs(first.speed_m_s - second.speed_m_s) <= _SAME_WAY * abs(first.speed_m_s)
        and abs(first.duration_s - second.duration_s) <= _SAME_DURATION * first.duration_s
    )


def most_frequent(moves: Sequence[Move]) -> str:
    """Most frequent move of a recording, in words."""
    ((words, count),) = Counter(map(described, moves)).most_common(1)
    return f"{words}, {count} times"


def described(move: Move) -> str:
    """A move in words: its ends and its speed."""
    ends = f"{1e3 * move.start_m:.4g} to {1e3 * move.end_m:.4g} mm"
    return f"{ends} at {1e3 * abs(move.speed_m_s):.3g} mm/s"
