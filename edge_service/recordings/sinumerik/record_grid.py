"""Sparse, change-encoded records of several clocks, as rows of one clock."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...messages.samples import Floats

BLOCK_ROWS = 1 << 14
MOST_STEPS = 2.0**52
"""Rows are counted exactly up to here."""
_PRINTED_S = 0.6e-6
"""Times are printed to the microsecond: half a digit and a little."""


@dataclass(frozen=True, slots=True)
class SignalClock:
    """Sampling clock of one signal.

    Attributes:
        interval_s: time between two samples, s.
        count: number of samples; None where the recording does not tell.
        interpolate: between two samples a straight line instead of the older one.
    """

    interval_s: float
    count: int | None = None
    interpolate: bool = False


@dataclass(slots=True)
class _Column:
    clock: SignalClock
    times_s: list[float]
    values: list[float]
    first_s: float = math.nan


class RecordGrid:
    """Rows on the clock of the fastest signal.

    A row holds, of each signal, the newest record not later than the row; nothing (NaN) before its
    first record, and nothing from one interval after its last sample. The phase of the rows is that
    of the first record of a fastest signal.

    Args:
        clocks: of each signal, in the order of the columns.
        stop_s: end of the recording, s; None where it does not tell.
        longest_silence_s: if not None, a longer stretch without any record is a gap: no rows.
    """

    def __init__(
        self,
        clocks: Sequence[SignalClock],
        stop_s: float | None = None,
        longest_silence_s: float | None = None,
    ) -> None:
        self.interval_s = min(clock.interval_s for clock in clocks)
        self.newest_s = -math.inf
        self._tolerance_s = min(_PRINTED_S, self.interval_s / 4.0)
        self._columns = [_Column(clock, [], []) for clock in clocks]
        self._stop_s = math.inf if stop_s is None else stop_s
        self._longest_silence_s = longest_silence_s
        self._silences: list[tuple[float, float]] = []
        self._first_s = math.inf
        self._origin_s = math.nan
        self._next_row = 0
        self._lookahead_s = max(
            (clock.interval_s for clock in clocks if clock.interpolate), default=0.0
        )

    def add(self, time_s: float, values: Sequence[tuple[int, float]]) -> None:
        """A record: its time, later than the last one's, and (column, value) pairs."""
        silence_s = self._longest_silence_s
        if silence_s is not None and time_s - self.newest_s > silence_s > 0.0:
            self._silences.append((self.newest_s, time_s))
        self.newest_s = time_s
        for index, value in values:
            column = self._columns[index]
            if math.isnan(column.first_s):
                column.first_s = time_s
                self._first_s = min(self._first_s, time_s)
                if math.isnan(self._origin_s) and column.clock.interval_s == self.interval_s:
                    self._set_origin(time_s)
            column.times_s.append(time_s)
            column.values.append(value)

    def rows_ahead(self, final: bool) -> int:
        """Number of rows that the records so far are good for, gaps included."""
        if math.isinf(self._first_s):
            return 0
        if math.isnan(self._origin_s):
            if not final and sum(len(each.times_s) for each in self._columns) < BLOCK_ROWS:
                return 0
            self._set_origin(self._first_s)
        end_s = self._end_s() if final else self.newest_s - self._lookahead_s
        steps = self._steps(end_s - self._origin_s)
        margin = self._tolerance_s / self.interval_s
        last = math.floor(steps + margin) if final else math.ceil(steps - margin) - 1
        return max(last + 1 - self._next_row, 0)

    def take(self, rows: int) -> tuple[Floats, list[Floats]]:
        """The next rows, at most `rows_ahead`.

        Returns:
            Times in s, shape (n,), and one array of values per column, shape (n,) each; n is less
            than `rows` where rows fall into a gap.
        """
        number = np.arange(self._next_row, self._next_row + rows)
        time_s = np.round(self._origin_s + number * self.interval_s, 9)
        self._next_row += rows
        kept = self._outside_silences(time_s)
        values = [self._values(column, time_s)[kept] for column in self._columns]
        for column in self._columns:
            self._forget(column, float(time_s[-1]))
        return time_s[kept], values

    def _set_origin(self, time_s: float) -> None:
        self._origin_s = time_s
        self._next_row = math.ceil(self._steps(self._first_s - self._tolerance_s - time_s))

    def _steps(self, span_s: float) -> float:
        """Rows in a span of time; a broken clock may mean any number."""
        return min(max(span_s / self.interval_s, -MOST_STEPS), MOST_STEPS)

    def _end_s(self) -> float:
        """Last time of the recording: what the clocks promise, but never before the last record."""
        promised_s = [
            column.first_s + (column.clock.count - 1) * column.clock.interval_s
            for column in self._columns
            if column.clock.count is not None and not math.isnan(column.first_s)
        ]
        end_s = min(max(promised_s, default=math.inf), self._stop_s)
        return self.newest_s if math.isinf(end_s) else max(end_s, self.newest_s)

    def _values(self, column: _Column, time_s: Floats) -> Floats:
        if not column.times_s:
            return np.full(time_s.shape, np.nan)
        slower = column.clock.interval_s > self.interval_s
        if column.clock.interpolate and slower:
            values = self._interpolated(column, time_s)
        else:
            values = self._held(column, time_s)
        if column.clock.count is not None and self._longest_silence_s is None:
            interval_s = column.clock.interval_s
            end_s = column.first_s + column.clock.count * interval_s
            end_s = max(end_s, column.times_s[-1] + interval_s)
            values[time_s > end_s - self._tolerance_s] = np.nan
        return values

    def _held(self, column: _Column, time_s: Floats) -> Floats:
        """Newest record not later than each time; NaN before the first, shape (n,)."""
        newest = np.searchsorted(column.times_s, time_s + self._tolerance_s, side="right") - 1
        return np.where(newest >= 0, np.asarray(column.values)[newest], np.nan)

    def _interpolated(self, column: _Column, time_s: Floats) -> Floats:
        """Straight lines between the samples of the signal's own clock, shape (n,)."""
        interval_s, first_s = column.clock.interval_s, column.first_s
        ticks = (time_s[[0, -1]] + self._tolerance_s - first_s) / interval_s
        newest = math.floor((self.newest_s + self._tolerance_s - first_s) / interval_s)
        start = max(math.floor(ticks[0]), 0)
        stop = max(min(math.ceil(ticks[1]), newest), start)
        own_s = first_s + np.arange(start, stop + 1) * interval_s
        values = np.interp(time_s, own_s, self._held(column, own_s))
        values[time_s < first_s - self._tolerance_s] = np.nan
        return values

    def _outside_silences(self, time_s: Floats) -> npt.NDArray[np.bool_]:
        kept = np.ones(time_s.shape, dtype=np.bool_)
        for before_s, after_s in self._silences:
            inside = time_s > before_s + self._tolerance_s
            kept &= ~(inside & (time_s < after_s - self._tolerance_s))
        self._silences = [pair for pair in self._silences if pair[1] > time_s[-1]]
        return kept

    def _forget(self, column: _Column, time_s: float) -> None:
        """Drop the records that no later row needs."""
        needed_s = time_s - (column.clock.interval_s if column.clock.interpolate else 0.0)
        newest = int(np.searchsorted(column.times_s, needed_s, side="right")) - 1
        if newest > 0:
            del column.times_s[:newest], column.values[:newest]
