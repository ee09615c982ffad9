"""Recorded channels made fit for analysis: runs of uniform samples, low-pass, differences, noise.

Pure functions of series. All filters run forwards and backwards, so that nothing is delayed.
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import ndimage, signal
from scipy.interpolate import CubicSpline

from ..messages.row_faults import (
    CLOCK_RESET_S,
    LIMIT_SHARE,
    MOVED_ANGLE_RAD,
    MOVED_SETPOINT_M,
    MOVED_TABLE_M,
    STUCK_S,
    WILDEST,
    clock_parts,
)
from ..messages.samples import (
    ANGLE,
    SETPOINT,
    TABLE_POSITION,
    TORQUE,
    Booleans,
    Floats,
    SampleFrame,
)
from .reader import joined

LARGEST_HOLE = 4.5
"""Samples further apart than this many periods are not bridged: up to three may be lost."""
EVEN = 1e-3  # clock jitter below this share of a period is none
MOSTLY = 0.5
"""A channel that is stuck for more than this share of a run is not measured at all."""
MAX_ROWS = 500_000  # a longer run is handed on in pieces; about 30 MB of eight channels
LEAST_ROWS = 50  # a shorter run is dropped
LEAST_REPEATS = 10
"""A slow recording or a coarse encoder repeats a value a few times while the axis creeps."""
MOVED = {ANGLE: MOVED_ANGLE_RAD, TABLE_POSITION: MOVED_TABLE_M, SETPOINT: MOVED_SETPOINT_M}
"""Travel of another channel, rad or m, above which the axis has moved."""
_STEPS = 3.0
"""Smallest steps of a channel that it must have missed."""
_STRIDES = (1, 2, 3, 4, 5)
CUTOFF_SHARE = 0.2
"""Of the sampling rate; a low-pass above it has no samples to work with."""
_CHEBYSHEV, _PASS = (8, 0.05), 0.8  # order and ripple, dB; of the new sampling rate's half
"""Chebyshev filter before decimation: the one of MATLAB's and scipy's `decimate`."""
_butter, _cheby1 = lru_cache(signal.butter), lru_cache(signal.cheby1)
"""Designs of filters; one takes as long as filtering ten thousand rows."""


@dataclass(frozen=True, slots=True, eq=False)
class UniformRun:
    """Samples at start_s + k period_s without a gap."""

    start_s: float  # on the axis' clock, s
    period_s: float  # s
    channels: Mapping[str, Floats]  # channel name -> values, shape (n,) each, all finite

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
) -> Iterator[UniformRun]:
    """Cut a recording into runs, in memory bounded by `MAX_ROWS`; its clock is its first frame's.

    Rows without a time, repeats, rows out of order and rows with a required value missing are
    dropped. A gap of more than `LARGEST_HOLE` periods, a clock that starts anew, or a channel that
    is stuck while the axis moves ends a run.
    Smaller holes and jitter are resampled by a cubic spline; an even clock is left as it is.

    Args:
        frames: one recording in its order.
        required: channels that a row must have.
        optional: channels that come along where the recording has them throughout a run.

    Raises ValueError: one line; a required channel is not there, or no clock can be made out.
    """
    buffer: list[SampleFrame] = []
    held, period_s = 0, 0.0
    for frame in [frames] if isinstance(frames, SampleFrame) else frames:
        clean = _clean(frame, required, optional)
        if len(clean) == 0:
            continue
        if not period_s:
            forward = np.diff(clean.time_s)
            forward = forward[forward > 0.0]
            if forward.size == 0:
                raise ValueError("time_s never increases; a recording needs a clock")
            period_s = float(np.median(forward))
        for piece in _pieces(clean, period_s):
            fresh, goes_on = piece, False
            if buffer and buffer[-1].channels.keys() == piece.channels.keys():
                last_s = buffer[-1].time_s[-1]
                goes_on = -CLOCK_RESET_S <= piece.time_s[0] - last_s <= LARGEST_HOLE * period_s
                fresh = piece.part(piece.time_s > last_s) if goes_on else piece
            for start in range(0, len(fresh), MAX_ROWS):
                part = fresh.part(slice(start, start + MAX_ROWS))
                if not goes_on or held + len(part) > MAX_ROWS:
                    yield from _finished(buffer, period_s, required)
                    buffer, held, goes_on = [], 0, True
                buffer.append(part)
                held += len(part)
    yield from _finished(buffer, period_s, required)


def _clean(frame: SampleFrame, required: Sequence[str], optional: Sequence[str]) -> SampleFrame:
    """The wanted channels of the rows that have a time and every required value."""
    for name in required:
        if name not in frame.channels:
            there = ", ".join(frame.channels)
            raise ValueError(f"the recording lacks {name}, which this needs; it has {there}")
    keep = np.abs(frame.time_s) < WILDEST
    channels = {}
    for name in (*required, *(name for name in optional if name in frame.channels)):
        values = frame.channels[name]
        known = np.abs(values) < WILDEST
        if name in required:
            keep &= known
        channels[name] = values if known.all() else np.where(known, values, np.nan)
    return SampleFrame(frame.time_s, channels).part(slice(None) if keep.all() else keep)


def _pieces(frame: SampleFrame, period_s: float) -> Iterator[SampleFrame]:
    """Split at gaps and at new clocks; within a piece the time strictly increases."""
    for part in clock_parts(frame.time_s):
        older = part.repeated | part.backwards
        clock = frame.part(part.rows).part(~older if older.any() else slice(None))
        gaps = np.flatnonzero(np.diff(clock.time_s) > LARGEST_HOLE * period_s) + 1
        for edge in itertools.pairwise([0, *gaps.tolist(), len(clock)]):
            yield clock.part(slice(*edge))


def _finished(
    buffer: list[SampleFrame], period_s: float, required: Sequence[str]
) -> Iterator[UniformRun]:
    """Runs from consecutive pieces, parted where a channel is stuck; on an even clock."""
    if not buffer:
        return
    whole = buffer[0] if len(buffer) == 1 else joined(buffer)
    time_s, channels = whole.time_s, dict(whole.channels)
    stuck = stuck_rows(time_s, channels)
    for name in [name for name, rows in stuck.items() if np.mean(rows) > MOSTLY]:
        if name not in required:
            del channels[name], stuck[name]
    bad = np.logical_or.reduce([np.zeros(len(time_s), dtype=bool), *stuck.values()])
    edges = np.flatnonzero(np.diff(bad)) + 1
    for start, end in itertools.pairwise([0, *edges.tolist(), len(time_s)]):
        if end - start < LEAST_ROWS or bad[start]:
            continue
        rows, times = slice(start, end), time_s[start:end]
        values = {name: all_[rows] for name, all_ in channels.items()}
        values = {name: each for name, each in values.items() if np.isfinite(each).all()}
        count = round((times[-1] - times[0]) / period_s) + 1
        step_s = float(times[-1] - times[0]) / (count - 1)
        grid = times[0] + step_s * np.arange(count)
        if count != len(times) or np.max(np.abs(grid - times)) > EVEN * step_s:
            values = {name: CubicSpline(times, each)(grid) for name, each in values.items()}
        yield UniformRun(float(times[0]), step_s, values)


def stuck_rows(time_s: Floats, channels: Mapping[str, Floats]) -> dict[str, Booleans]:
    """Rows in which torque, angle or table position is stuck, by channel, (n,) each."""
    found = {}
    for name in (TORQUE, ANGLE, TABLE_POSITION):
        if name not in channels:
            continue
        values = channels[name]
        found[name] = stuck = np.zeros(len(values), dtype=bool)
        greatest = LIMIT_SHARE * float(np.nanmax(np.abs(values), initial=0.0))
        starts = np.concatenate(([0], np.flatnonzero(np.diff(values) != 0.0) + 1))  # of runs
        ends = np.append(starts[1:], len(values)) - 1
        long = (ends - starts >= LEAST_REPEATS) & (time_s[ends] - time_s[starts] >= STUCK_S)
        for start, end in zip(starts[long].tolist(), ends[long].tolist(), strict=True):
            limited = name == TORQUE and abs(values[start]) >= greatest > 0.0
            if not limited and _moved(channels, name, slice(start, end + 1)):
                stuck[start : end + 1] = True
    return found


def _moved(channels: Mapping[str, Floats], name: str, rows: slice) -> bool:
    """Return whether another channel shows that the axis moved meanwhile."""
    for other in (each for each in MOVED if each != name and each in channels):
        values = channels[other][rows]
        steps = np.abs(np.diff(values))
        smallest = float(np.min(steps[steps > 0.0], initial=np.inf))
        travel = float(np.nanmax(values) - np.nanmin(values))
        if travel > MOVED[other] and travel > _STEPS * smallest:
            return True
    return False


def with_angle(
    frames: Iterable[SampleFrame] | SampleFrame, ratio_m_per_rad: float
) -> Iterator[SampleFrame]:
    """Frames with a motor angle; x / R_t stands in where there is no rotary encoder."""
    for frame in [frames] if isinstance(frames, SampleFrame) else frames:
        if ANGLE in frame.channels or TABLE_POSITION not in frame.channels:
            yield frame
        else:
            channels = dict(frame.channels)
            channels[ANGLE] = channels.pop(TABLE_POSITION) / ratio_m_per_rad
            yield SampleFrame(frame.time_s, channels)


def central_difference(values: Floats, period_s: float) -> Floats:
    """(x_{k-2} - 8 x_{k-1} + 8 x_{k+1} - x_{k+2}) / 12 T, (n,); shorter at the ends.

    It is right to (w T)^4 / 30. The difference of two neighbours, right to (w T)^2 / 6 only, makes
    the accelerations of a machine's moves too small by half a per mille, and an inertia too great.
    """
    rate = np.asarray(np.gradient(values, period_s), dtype=np.float64)
    outer, inner = values[4:] - values[:-4], values[3:-1] - values[1:-3]
    rate[2:-2] = (8.0 * inner - outer) / (12.0 * period_s)
    return rate


def low_pass(values: Floats, cutoff_hz: float, order: int, period_s: float) -> Floats:
    """Butterworth low-pass, forwards and backwards: zero phase, (n,)."""
    half_rate_hz = 0.5 / period_s
    if cutoff_hz >= half_rate_hz:
        raise ValueError(
            f"cutoff_hz: {cutoff_hz:g} Hz is not below half the sampling rate, {half_rate_hz:g} Hz"
        )
    sos = _butter(order, cutoff_hz / half_rate_hz, output="sos")
    return np.asarray(signal.sosfiltfilt(sos, values))


def anti_alias(values: Floats, factor: int) -> Floats:
    """Zero-phase Chebyshev low-pass of `signal.decimate` alone, (n,): all rows are kept."""
    sos = _cheby1(*_CHEBYSHEV, _PASS / factor, output="sos")
    return np.asarray(signal.sosfiltfilt(sos, values))


def white_noise_rms(values: Floats) -> float:
    """Standard deviation of the white noise on a smooth series (n,).

    From fifth differences, which a motion of limited jerk leaves at 0 except where the jerk jumps;
    their median absolute value stands for sqrt(252) sigma, sqrt(sum of binomial(5, k)^2). A channel
    that is held for some rows jumps between them, but not from every second or third to the next.
    """
    strides = _STRIDES if 2 * np.count_nonzero(np.diff(values)) < len(values) else (1,)
    fifths = [np.abs(np.diff(values[::stride], 5)) for stride in strides]
    typical = min((float(np.median(fifth)) for fifth in fifths if fifth.size), default=0.0)
    return typical / 0.6745 / math.sqrt(252.0)


def mean_of_held(values: Floats, samples: float) -> Floats:
    """Mean torque around each sample of a drive that holds its torque for a period, (n,).

    The commands shifted later by `samples`, a spline between them, and the mean over a period:
    1 - (w T)^2 / 24, which the second difference has.
    """
    shifted: Floats = ndimage.shift(values, samples, order=3, mode="nearest")
    shifted[1:-1] += np.diff(shifted, 2) / 24.0
    return shifted
