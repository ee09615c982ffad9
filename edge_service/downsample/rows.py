"""Sample frames as rows of one table, and the faults of time that part them."""

from collections import deque
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..messages.features import Fault
from ..messages.row_faults import THETA, WILDEST, ClockPart, T, U, X, clock_parts
from ..messages.samples import ANGLE, CHANNELS, MOTOR_SPEED, TABLE_SPEED, Floats, SampleFrame
from ..messages.stored import Number
from .interval_kernels import rises

DERIVED = (MOTOR_SPEED, TABLE_SPEED)
"""Not kept in a ring: they follow from the positions."""
Bits = npt.NDArray[np.int64]
"""Faults of rows as bits of `Fault`, (n,)."""
MOST_FRAMES = 256
"""Frames that wait together at the most."""
_COLUMNS = [name for name in CHANNELS if name != TABLE_SPEED]  # as `row_faults` numbers them


def table_of(frame: SampleFrame, ratio_m_per_rad: float) -> Floats:
    """Rows of shape (n, 8) with NaN for what the frame lacks.

    Without a rotary encoder the linear one stands in for the angle, x / R_t.
    """
    rows = np.full((len(frame), 8), np.nan)
    rows[:, T] = frame.time_s
    for column, name in enumerate(_COLUMNS, start=1):
        if name in frame.channels:
            rows[:, column] = frame.channels[name]
    rows[~(np.abs(rows) < WILDEST)] = np.nan
    if ANGLE not in frame.channels:
        rows[:, THETA] = rows[:, X] / ratio_m_per_rad
        rows[:, X] = np.nan
    return rows


@dataclass(frozen=True, slots=True, eq=False)
class Screened:
    """Rows in strictly increasing time, each with the faults found just before it."""

    rows: Floats  # (n, 8)
    fault: Bits  # (n,), bits of Fault
    new_clock: bool  # the first row belongs to a new clock
    missing: tuple[tuple[float, Fault], ...] = ()  # time and fault of rows without a needed value


@dataclass(slots=True)
class RowScreen:
    """Screen that sets aside rows without time or values, repeats and rows out of order."""

    has_torque: bool  # rows without torque are set aside too
    newest_s: Number = -np.inf  # time of the newest row
    pending: int = 0  # bits of Fault found since the last good row

    @property
    def _required(self) -> list[int]:
        return [THETA, U] if self.has_torque else [THETA]

    def split(self, rows: Floats) -> list[Screened]:
        """Screen rows in the order of arrival; a new clock starts a new element."""
        if not self.pending and rises(rows, float(self.newest_s), *self._required):
            self.newest_s = float(rows[-1, T])
            return [Screened(rows, np.zeros(len(rows), dtype=np.int64), new_clock=False)]
        parts = []
        for part in clock_parts(rows[:, T], self.newest_s):
            if part.new_clock:  # its source has begun anew
                self.pending = int(Fault.NONE)
            parts.append(self._screen(rows[part.rows], part))
        return parts

    def _screen(self, rows: Floats, part: ClockPart) -> Screened:
        repeated, backwards = part.repeated, part.backwards
        timeless = np.isnan(rows[:, T])
        missing = np.isnan(rows[:, self._required]).any(axis=1)
        missing &= ~(repeated | backwards | timeless)
        self.newest_s = part.newest_s
        bits = (
            repeated * int(Fault.REPEAT)
            | backwards * int(Fault.TIME_BACKWARDS)
            | (missing | timeless) * int(Fault.HOLE)
        )
        absent = tuple(
            (float(row[T]), Fault.NO_POSITION if np.isnan(row[THETA]) else Fault.NO_TORQUE)
            for row in rows[missing]
        )
        return Screened(*self._keep(rows, bits), part.new_clock, absent)

    def _keep(self, rows: Floats, bits: Bits) -> tuple[Floats, Bits]:
        """Good rows with their faults; those of a bad row go to the good one behind it."""
        keep = np.flatnonzero(bits == 0)
        fault = np.zeros(len(keep), dtype=np.int64)
        if len(keep):
            fault[0], self.pending = self.pending, 0
        faulty = np.flatnonzero(bits)
        for index, follower in zip(faulty, np.searchsorted(keep, faulty), strict=True):
            if follower < len(keep):
                fault[follower] |= bits[index]
            else:
                self.pending |= int(bits[index])
        return rows[keep], fault


class Gathering:
    """Frames of one axis that wait for the sample that completes an interval."""

    def __init__(self) -> None:
        self._waiting: list[SampleFrame] = []
        self._newest_s: Number = -np.inf

    def add(self, frame: SampleFrame, due_s: float) -> list[SampleFrame]:
        """Frames that need not wait any longer, in their order.

        Args:
            due_s: time of the sample that completes the current interval, s; see `Downsampler`.
        """
        goes_back = frame.time_s[0] <= self._newest_s  # `due_s` is of the clock before
        self._newest_s = frame.time_s[-1]
        before = self._waiting[-1] if self._waiting else frame
        if goes_back or (
            self._waiting
            and (
                before.channels.keys() != frame.channels.keys()
                or not frame.time_s[0] > before.time_s[-1]
                or before.quality  # one that is doubted stays by itself
                or frame.quality
            )
        ):
            return [*self._all(), frame]
        self._waiting.append(frame)
        newest_s = frame.time_s[-1]  # a clock that goes back inside a frame ends an interval
        is_early = newest_s < due_s and frame.time_s.max() <= newest_s
        return [] if is_early and len(self._waiting) < MOST_FRAMES else self._all()

    def _all(self) -> list[SampleFrame]:
        frames, self._waiting = self._waiting, []
        if len(frames) < 2:
            return frames
        channels = {n: np.concatenate([e.channels[n] for e in frames]) for n in frames[0].channels}
        return [SampleFrame(np.concatenate([each.time_s for each in frames]), channels)]


class SampleRing:
    """Ring of the last seconds of an axis.

    Args:
        keep_s: length, s.
        most_rows: never more than this, whatever the rate.
    """

    def __init__(self, keep_s: float, most_rows: int) -> None:
        self.keep_s = keep_s
        self._most_rows = most_rows
        self._pieces: deque[tuple[tuple[str, ...], Floats]] = deque()
        self._rows = 0

    @property
    def newest_s(self) -> float:
        """Time of the newest sample, s; NaN while there is none."""
        return float(self._pieces[-1][1][0, -1]) if self._pieces else float("nan")

    def push(self, frame: SampleFrame) -> None:
        """Append samples; older ones than `keep_s` go."""
        if not len(frame):
            return
        if self._pieces and frame.time_s[0] < self._pieces[-1][1][0, 0]:
            self._pieces.clear()  # a new clock
            self._rows = 0
        names = tuple(name for name in frame.channels if name not in DERIVED)
        table = np.array([frame.time_s, *(frame.channels[name] for name in names)])
        self._pieces.append((names, table))
        self._rows += len(frame)
        oldest_s = self.newest_s - self.keep_s
        while self._pieces and (
            self._pieces[0][1][0, -1] < oldest_s or self._rows > self._most_rows
        ):
            self._rows -= self._pieces.popleft()[1].shape[1]

    def cut(self, from_s: float, to_s: float) -> list[SampleFrame]:
        """Samples within [from, to), in pieces."""
        found = []
        for names, piece in self._pieces:
            rows = piece[:, (piece[0] >= from_s) & (piece[0] < to_s)]
            if rows.shape[1]:
                found.append(SampleFrame(rows[0], dict(zip(names, rows[1:], strict=True))))
        return found
