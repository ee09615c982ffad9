"""Sparse, change-encoded records of several clocks, as rows of one clock."""

import math
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from ...messages.samples import Floats

BLOCK_ROWS = 1 << 14
MOST_STEPS = 2.0**52
"""Rows are counted exactly up to here."""
_PRINTED_S = 0.6e-6
"""Times are printed to the microsecond: half a digit and a little."""


@dataclass(slots=True)
class SignalRecords:
    """Records of one signal, and its sampling clock."""

    interval_s: float  # time between two samples, s
    # name, unit: as they stand in the file
    name: str = ""
    unit: str = ""
    count: int | None = None  # number of samples; None where the recording does not tell
    interpolate: bool = False  # between two samples a straight line instead of the older one
    # times_s, values: of each record, times rising
    times_s: "array[float]" = field(default_factory=lambda: array("d"))
    values: "array[float]" = field(default_factory=lambda: array("d"))


class RecordGrid:
    """Rows on the clock of the fastest signal.

    A row holds, of each signal, the newest record not later than the row; nothing (NaN) before its
    first record, and nothing from one interval after its last sample. The phase of the rows is that
    of the first record of a fastest signal.

    Args:
        signals: in the order of the columns.
        newest_s: time of the last record, s.
        stop_s: end of the recording, s; None where it does not tell.
        silences: stretches between two records, s, in which there are no rows, (n, 2); None where
            silence is standstill.

    Attributes:
        rows: number of rows, those in silences included.
    """

    def __init__(
        self,
        signals: Sequence[SignalRecords],
        newest_s: float,
        stop_s: float | None,
        silences: Floats | None,
    ) -> None:
        self._signals, self._newest_s, self._silences = signals, newest_s, silences
        self._interval_s = min(each.interval_s for each in signals)
        self._tolerance_s = min(_PRINTED_S, self._interval_s / 4.0)
        heard = [each for each in signals if each.times_s]
        self.rows = self._first_row = 0
        if not heard:
            return
        first_s = min(each.times_s[0] for each in heard)
        fastest_s = [each.times_s[0] for each in heard if each.interval_s == self._interval_s]
        self._origin_s = min(fastest_s, default=first_s)
        promised_s = [
            each.times_s[0] + (each.count - 1) * each.interval_s
            for each in heard
            if each.count is not None
        ]
        end_s = min(max(promised_s, default=math.inf), math.inf if stop_s is None else stop_s)
        end_s = newest_s if math.isinf(end_s) else max(end_s, newest_s)
        margin = self._tolerance_s / self._interval_s
        self._first_row = math.ceil(self._steps(first_s - self._tolerance_s))
        self.rows = max(math.floor(self._steps(end_s) + margin) + 1 - self._first_row, 0)

    def blocks(self) -> Iterator[tuple[Floats, list[Floats]]]:
        """Times in s, shape (n,), and an array of values per signal, shape (n,) each."""
        for start in range(0, self.rows, BLOCK_ROWS):
            number = self._first_row + np.arange(start, min(start + BLOCK_ROWS, self.rows))
            time_s = np.round(self._origin_s + number * self._interval_s, 9)
            if self._silences is not None and len(self._silences):
                before_s, after_s = self._silences.T
                at = np.searchsorted(before_s, time_s - self._tolerance_s) - 1
                inside = (at >= 0) & (time_s < after_s[at] - self._tolerance_s)
                time_s = time_s[~inside]
            yield time_s, [self._values(each, time_s) for each in self._signals]

    def _steps(self, time_s: float) -> float:
        """Rows up to a time; a broken clock may mean any number."""
        return min(max((time_s - self._origin_s) / self._interval_s, -MOST_STEPS), MOST_STEPS)

    def _values(self, signal: SignalRecords, time_s: Floats) -> Floats:
        if not signal.times_s:
            return np.full(time_s.shape, np.nan)
        interval_s, first_s = signal.interval_s, signal.times_s[0]
        if signal.interpolate and interval_s > self._interval_s and len(time_s):
            ticks = (time_s[[0, -1]] + self._tolerance_s - first_s) / interval_s
            newest = math.floor((self._newest_s + self._tolerance_s - first_s) / interval_s)
            start = max(math.floor(ticks[0]), 0)
            stop = max(min(math.ceil(ticks[1]), newest), start)
            own_s = first_s + np.arange(start, stop + 1) * interval_s
            values = np.interp(time_s, own_s, self._held(signal, own_s))
            values[time_s < first_s - self._tolerance_s] = np.nan
        else:
            values = self._held(signal, time_s)
        if signal.count is not None and self._silences is None:
            end_s = first_s + signal.count * interval_s
            end_s = max(end_s, signal.times_s[-1] + interval_s)
            values[time_s > end_s - self._tolerance_s] = np.nan
        return values

    def _held(self, signal: SignalRecords, time_s: Floats) -> Floats:
        """Newest record not later than each time; NaN before the first, shape (n,)."""
        times_s = np.frombuffer(signal.times_s)
        newest = np.searchsorted(times_s, time_s + self._tolerance_s, side="right") - 1
        return np.where(newest >= 0, np.frombuffer(signal.values)[newest], np.nan)
