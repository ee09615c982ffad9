"""Sample frames as rows of one table, and the faults of time that part them."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..messages.channels import (
    ANGLE,
    EXTERNAL_FORCE,
    MOTOR_SPEED,
    SETPOINT,
    TABLE_POSITION,
    TEMPERATURE,
    TORQUE,
)
from ..messages.features import Fault
from ..messages.samples import Floats, SampleFrame

T, U, THETA, X, OMEGA, SET, TEMP, FORCE = range(8)
"""Columns of a table of rows: time, torque, angle, table, speed, setpoint, temperature, force."""

_CHANNEL_COLUMNS = {
    TORQUE: U,
    ANGLE: THETA,
    TABLE_POSITION: X,
    MOTOR_SPEED: OMEGA,
    SETPOINT: SET,
    TEMPERATURE: TEMP,
    EXTERNAL_FORCE: FORCE,
}
WILDEST = 1e12
"""No quantity of an axis in SI units, nor its clock, is as large; such a value is a missing one."""
CLOCK_RESET_S = 1.0
"""A step back in time by more than this is a new clock, less is rows out of order."""


def table_of(frame: SampleFrame, ratio_m_per_rad: float) -> Floats:
    """Rows of shape (n, 8) with NaN for what the frame lacks.

    Without a rotary encoder the linear one stands in for the angle, x / R_t.
    """
    rows = np.full((len(frame), 8), np.nan)
    rows[:, T] = frame.time_s
    for name, column in _CHANNEL_COLUMNS.items():
        if name in frame.channels:
            rows[:, column] = frame.channels[name]
    rows[~(np.abs(rows) < WILDEST)] = np.nan
    if ANGLE not in frame.channels:
        rows[:, THETA] = rows[:, X] / ratio_m_per_rad
        rows[:, X] = np.nan
    return rows


@dataclass(slots=True)
class RowCounters:
    """Monotonic counts of rows that were set aside."""

    rows: int = 0
    repeated: int = 0
    out_of_order: int = 0
    missing_value: int = 0
    clock_resets: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Screened:
    """Rows in strictly increasing time, each with the faults found just before it."""

    rows: Floats  # (n, 8)
    fault: npt.NDArray[np.int64]  # (n,), bits of Fault
    new_clock: bool  # the first row belongs to a new clock
    missing: tuple[tuple[float, Fault], ...] = ()  # time and fault of rows without a needed value


class RowScreen:
    """Sets aside rows without a time, repeats, rows out of order and rows with missing values."""

    def __init__(self, has_torque: bool) -> None:
        self.counters = RowCounters()
        self._required = [THETA, U] if has_torque else [THETA]
        self._newest_s = -np.inf
        self._pending = 0

    def split(self, rows: Floats) -> list[Screened]:
        """Screen rows in the order of arrival; a new clock starts a new element."""
        self.counters.rows += len(rows)
        if self._is_faultless(rows):
            self._newest_s = float(rows[-1, T])
            return [Screened(rows, np.zeros(len(rows), dtype=np.int64), new_clock=False)]
        parts = []
        new_clock = False
        while True:
            newest = np.maximum.accumulate(np.concatenate([[self._newest_s], _known(rows[:, T])]))
            resets = np.flatnonzero(rows[:, T] < newest[:-1] - CLOCK_RESET_S)
            end = int(resets[0]) if resets.size else len(rows)
            parts.append(self._screen(rows[:end], newest[:end], new_clock))
            if end == len(rows):
                return parts
            self.counters.clock_resets += 1
            self._newest_s, self._pending = -np.inf, int(Fault.TIME_BACKWARDS)
            rows, new_clock = rows[end:], True

    def _is_faultless(self, rows: Floats) -> bool:
        """Whether nothing has to be set aside or told: by far the most frequent case."""
        time_s = rows[:, T]
        rising = time_s[0] > self._newest_s and bool((np.diff(time_s) > 0.0).all())
        return rising and not self._pending and not np.isnan(rows[:, self._required]).any()

    def _screen(self, rows: Floats, newest: Floats, new_clock: bool) -> Screened:
        time_s = rows[:, T]
        repeated = time_s == newest
        backwards = time_s < newest
        missing = np.isnan(rows[:, self._required]).any(axis=1) & ~repeated & ~backwards
        missing &= ~np.isnan(time_s)
        self.counters.repeated += int(repeated.sum())
        self.counters.out_of_order += int(backwards.sum())
        self.counters.missing_value += int(missing.sum())
        if time_s.size:
            self._newest_s = float(np.nanmax(np.append(newest[-1], time_s)))
        bits = (
            repeated * int(Fault.REPEAT)
            | backwards * int(Fault.TIME_BACKWARDS)
            | (missing | np.isnan(time_s)) * int(Fault.HOLE)
        )
        absent = tuple(self._why(rows[index]) for index in np.flatnonzero(missing))
        return Screened(*self._keep(rows, bits), new_clock, absent)

    def _why(self, row: Floats) -> tuple[float, Fault]:
        """Time of a row without a needed value, and which one it lacks."""
        lacking = Fault.NO_POSITION if np.isnan(row[THETA]) else Fault.NO_TORQUE
        return float(row[T]), lacking

    def _keep(
        self, rows: Floats, bits: npt.NDArray[np.int64]
    ) -> tuple[Floats, npt.NDArray[np.int64]]:
        """The good rows; the faults of each bad one are told by the good row that follows it."""
        keep = np.flatnonzero(bits == 0)
        fault = np.zeros(len(keep), dtype=np.int64)
        if len(keep):
            fault[0], self._pending = self._pending, 0
        faulty = np.flatnonzero(bits)
        for index, follower in zip(faulty, np.searchsorted(keep, faulty), strict=True):
            if follower < len(keep):
                fault[follower] |= bits[index]
            else:
                self._pending |= int(bits[index])
        return rows[keep], fault


def _known(time_s: Floats) -> Floats:
    return np.where(np.isnan(time_s), -np.inf, time_s)
