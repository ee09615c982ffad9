"""Sample frames as rows of one table, and the faults of time that part them."""

from dataclasses import asdict, dataclass
from typing import Any

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
from ..messages.row_faults import WILDEST, ClockPart, clock_parts
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
    """Screen that sets aside rows without time or values, repeats and rows out of order."""

    def __init__(self, has_torque: bool) -> None:
        self.counters = RowCounters()
        self._required = [THETA, U] if has_torque else [THETA]
        self._newest_s = -np.inf
        self._pending = 0

    def snapshot(self) -> dict[str, Any]:
        """State as JSON-able values."""
        return {
            "has_torque": U in self._required,
            "newest_s": None if self._newest_s == -np.inf else self._newest_s,
            "pending": self._pending,
            "counters": asdict(self.counters),
        }

    @classmethod
    def restored(cls, snapshot: dict[str, Any]) -> "RowScreen":
        """A screen that goes on from a snapshot."""
        screen = cls(bool(snapshot["has_torque"]))
        newest_s = snapshot["newest_s"]
        screen._newest_s = -np.inf if newest_s is None else float(newest_s)
        screen._pending = int(snapshot["pending"])
        screen.counters = RowCounters(**snapshot["counters"])
        return screen

    def split(self, rows: Floats) -> list[Screened]:
        """Screen rows in the order of arrival; a new clock starts a new element."""
        self.counters.rows += len(rows)
        if self._is_faultless(rows):
            self._newest_s = float(rows[-1, T])
            return [Screened(rows, np.zeros(len(rows), dtype=np.int64), new_clock=False)]
        parts = []
        for part in clock_parts(rows[:, T], self._newest_s):
            if part.new_clock:
                self.counters.clock_resets += 1
                self._pending = int(Fault.TIME_BACKWARDS)
            parts.append(self._screen(rows[part.rows], part))
        return parts

    def _is_faultless(self, rows: Floats) -> bool:
        """True if no row has to be set aside: by far the most frequent case."""
        time_s = rows[:, T]
        rising = time_s[0] > self._newest_s and bool((np.diff(time_s) > 0.0).all())
        return rising and not self._pending and not np.isnan(rows[:, self._required]).any()

    def _screen(self, rows: Floats, part: ClockPart) -> Screened:
        repeated, backwards = part.repeated, part.backwards
        timeless = np.isnan(rows[:, T])
        missing = np.isnan(rows[:, self._required]).any(axis=1)
        missing &= ~(repeated | backwards | timeless)
        self.counters.repeated += int(repeated.sum())
        self.counters.out_of_order += int(backwards.sum())
        self.counters.missing_value += int(missing.sum())
        self._newest_s = part.newest_s
        bits = (
            repeated * int(Fault.REPEAT)
            | backwards * int(Fault.TIME_BACKWARDS)
            | (missing | timeless) * int(Fault.HOLE)
        )
        absent = tuple(self._why(rows[index]) for index in np.flatnonzero(missing))
        return Screened(*self._keep(rows, bits), part.new_clock, absent)

    def _why(self, row: Floats) -> tuple[float, Fault]:
        """Time of a row without a needed value, and the fault of the missing one."""
        lacking = Fault.NO_POSITION if np.isnan(row[THETA]) else Fault.NO_TORQUE
        return float(row[T]), lacking

    def _keep(
        self, rows: Floats, bits: npt.NDArray[np.int64]
    ) -> tuple[Floats, npt.NDArray[np.int64]]:
        """Good rows with their faults; those of a bad row go to the good one behind it."""
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
