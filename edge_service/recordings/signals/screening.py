"""Runs of uniformly sampled data from recordings with faults of time or stuck channels."""

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from ...messages.channels import ANGLE, SETPOINT, TABLE_POSITION, TORQUE
from ...messages.row_faults import (
    CLOCK_RESET_S,
    LIMIT_SHARE,
    MOVED_ANGLE_RAD,
    MOVED_SETPOINT_M,
    MOVED_TABLE_M,
    STUCK_S,
    WILDEST,
    clock_parts,
    run_starts,
)
from ...messages.samples import Booleans, Floats, SampleFrame

LARGEST_HOLE = 4.5
"""Samples further apart than this many periods are not bridged: up to three may be lost."""
EVEN = 1e-3
"""Clock jitter below this share of a period is none."""
MOSTLY = 0.5
"""A channel that is stuck for more than this share of a run is not measured at all."""
MAX_ROWS = 500_000
"""A longer run is handed on in pieces; about 30 MB of eight channels."""
LEAST_REPEATS = 10
"""A slow recording or a coarse encoder repeats a value a few times while the axis creeps."""
MOVED = {ANGLE: MOVED_ANGLE_RAD, TABLE_POSITION: MOVED_TABLE_M, SETPOINT: MOVED_SETPOINT_M}
"""Travel of another channel, rad or m, above which the axis has moved."""
_STEPS = 3.0
"""Smallest steps of a channel that it must have missed."""


@dataclass(frozen=True, slots=True, eq=False)
class UniformRun:
    """Samples at start_s + k period_s without a gap.

    Attributes:
        start_s: on the axis' clock, s.
        period_s: s.
        channels: channel name -> values, shape (n,) each, all finite.
    """

    start_s: float
    period_s: float
    channels: Mapping[str, Floats]

    def __len__(self) -> int:
        return len(next(iter(self.channels.values())))

    @property
    def time_s(self) -> Floats:
        """Shape (n,)."""
        return self.start_s + self.period_s * np.arange(len(self), dtype=np.float64)


def uniform_runs(
    frames: Iterable[SampleFrame] | SampleFrame,
    required: Sequence[str],
    *,
    optional: Sequence[str] = (),
    period_s: float | None = None,
    min_rows: int = 50,
    max_rows: int = MAX_ROWS,
) -> Iterator[UniformRun]:
    """Cut a recording into runs, in memory bounded by `max_rows`.

    Rows without a time, repeats, rows out of order and rows with a required value missing are
    dropped. A gap of more than `LARGEST_HOLE` periods, a clock that starts anew, or a channel that
    is stuck while the axis moves ends a run.
    Smaller holes and jitter are resampled by a cubic spline; an even clock is left as it is.

    Args:
        frames: one recording in its order.
        required: channels that a row must have.
        optional: channels that come along where the recording has them throughout a run.
        period_s: sampling period; the median step of the first frame if not given.
        min_rows: shorter runs are dropped.
        max_rows: longer runs are cut; neighbouring pieces share no row.

    Raises:
        ValueError: one line; a required channel is not there, or no clock can be made out.
    """
    buffer: list[SampleFrame] = []
    held = 0
    for frame in [frames] if isinstance(frames, SampleFrame) else frames:
        clean = _clean(frame, required, optional)
        if len(clean) == 0:
            continue
        period_s = period_s or _period(clean.time_s)
        for piece in _pieces(clean, period_s):
            if buffer and not _follows(buffer[-1], piece, period_s):
                yield from _finished(buffer, period_s, min_rows, required)
                buffer, held = [], 0
            fresh = _after(piece, buffer[-1].time_s[-1]) if buffer else piece
            for start in range(0, len(fresh), max_rows):
                part = _rows(fresh, slice(start, start + max_rows))
                if held + len(part) > max_rows:
                    yield from _finished(buffer, period_s, min_rows, required)
                    buffer, held = [], 0
                buffer.append(part)
                held += len(part)
    if buffer and period_s is not None:
        yield from _finished(buffer, period_s, min_rows, required)


def _clean(frame: SampleFrame, required: Sequence[str], optional: Sequence[str]) -> SampleFrame:
    """The wanted channels of the rows that have a time and every required value."""
    for name in required:
        if name not in frame.channels:
            there = ", ".join(frame.channels)
            raise ValueError(f"the recording lacks {name}, which this needs; it has {there}")
    names = [*required, *(name for name in optional if name in frame.channels)]
    keep = np.abs(frame.time_s) < WILDEST
    channels = {}
    for name in names:
        known = np.abs(frame.channels[name]) < WILDEST
        if name in required:
            keep &= known
        channels[name] = np.where(known, frame.channels[name], np.nan)
    return SampleFrame(frame.time_s[keep], {name: channels[name][keep] for name in names})


def _period(time_s: Floats) -> float:
    steps = np.diff(time_s)
    forward = steps[steps > 0.0]
    if forward.size == 0:
        raise ValueError("time_s never increases; a recording needs a clock")
    return float(np.median(forward))


def _pieces(frame: SampleFrame, period_s: float) -> list[SampleFrame]:
    """Split at gaps and at new clocks; within a piece the time strictly increases."""
    pieces = []
    for part in clock_parts(frame.time_s):
        newer = ~(part.repeated | part.backwards)
        clock = _rows(frame, part.rows.start + np.flatnonzero(newer))
        gaps = np.flatnonzero(np.diff(clock.time_s) > LARGEST_HOLE * period_s) + 1
        edges = [0, *gaps.tolist(), len(clock)]
        pieces += [_rows(clock, slice(*edge)) for edge in itertools.pairwise(edges)]
    return pieces


def _follows(before: SampleFrame, after: SampleFrame, period_s: float) -> bool:
    step_s = float(after.time_s[0] - before.time_s[-1])
    unbroken = -CLOCK_RESET_S <= step_s <= LARGEST_HOLE * period_s
    return unbroken and before.channels.keys() == after.channels.keys()


def _after(frame: SampleFrame, time_s: float) -> SampleFrame:
    return _rows(frame, np.flatnonzero(frame.time_s > time_s))


def _rows(frame: SampleFrame, index: slice | np.ndarray) -> SampleFrame:
    return SampleFrame(
        frame.time_s[index], {name: values[index] for name, values in frame.channels.items()}
    )


def _finished(
    buffer: Sequence[SampleFrame], period_s: float, min_rows: int, required: Sequence[str]
) -> Iterator[UniformRun]:
    """Runs from consecutive pieces, parted where a channel is stuck."""
    time_s = np.concatenate([part.time_s for part in buffer])
    channels = {
        name: np.concatenate([part.channels[name] for part in buffer])
        for name in buffer[0].channels
    }
    stuck = stuck_rows(time_s, channels)
    for name in [name for name, rows in stuck.items() if np.mean(rows) > MOSTLY]:
        if name not in required:
            del channels[name], stuck[name]
    bad = np.logical_or.reduce([np.zeros(len(time_s), dtype=bool), *stuck.values()])
    edges = np.flatnonzero(np.diff(bad)) + 1
    for piece in np.split(np.arange(len(time_s)), edges):
        if len(piece) >= max(min_rows, 4) and not bad[piece[0]]:
            yield _even(
                time_s[piece], {name: all_[piece] for name, all_ in channels.items()}, period_s
            )


def _even(time_s: Floats, channels: Mapping[str, Floats], period_s: float) -> UniformRun:
    """One run, resampled if its clock is not even; without channels that lack a value."""
    channels = {name: values for name, values in channels.items() if np.isfinite(values).all()}
    count = round((time_s[-1] - time_s[0]) / period_s) + 1
    period_s = float(time_s[-1] - time_s[0]) / (count - 1)
    grid = time_s[0] + period_s * np.arange(count)
    if count != len(time_s) or np.max(np.abs(grid - time_s)) > EVEN * period_s:
        channels = {name: CubicSpline(time_s, values)(grid) for name, values in channels.items()}
    return UniformRun(float(time_s[0]), period_s, channels)


def stuck_rows(time_s: Floats, channels: Mapping[str, Floats]) -> dict[str, Booleans]:
    """Rows in which torque, angle or table position is stuck, by channel, (n,) each.

    Args:
        time_s: increasing, (n,).
        channels: at these times, (n,) each.
    """
    found = {}
    for name in (TORQUE, ANGLE, TABLE_POSITION):
        values = channels.get(name)
        if values is None:
            continue
        stuck = np.zeros(len(values), dtype=bool)
        greatest = LIMIT_SHARE * float(np.nanmax(np.abs(values), initial=0.0))
        for start, end in _repeats(values, time_s):
            limited = name == TORQUE and abs(values[start]) >= greatest > 0.0
            if not limited and _moved(channels, name, start, end):
                stuck[start : end + 1] = True
        found[name] = stuck
    return found


def _repeats(values: Floats, time_s: Floats) -> list[tuple[int, int]]:
    """First and last row of every long stretch of one value."""
    starts = run_starts(values)
    ends = np.append(starts[1:], len(values)) - 1
    long = (ends - starts >= LEAST_REPEATS) & (time_s[ends] - time_s[starts] >= STUCK_S)
    return list(zip(starts[long].tolist(), ends[long].tolist(), strict=True))


def _moved(channels: Mapping[str, Floats], name: str, start: int, end: int) -> bool:
    """True if another channel shows that the axis moved meanwhile."""
    for other, least in MOVED.items():
        values = channels.get(other)
        if other == name or values is None:
            continue
        steps = np.abs(np.diff(values[start : end + 1]))
        smallest = float(np.min(steps[steps > 0.0], initial=np.inf))
        travel = float(np.nanmax(values[start : end + 1]) - np.nanmin(values[start : end + 1]))
        if travel > least and travel > _STEPS * smallest:
            return True
    return False
