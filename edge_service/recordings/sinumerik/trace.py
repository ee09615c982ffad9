"""The XML of a SINUMERIK "Solution Line Trace": sparse records of several clocks, as rows."""

import math
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import IO

import numpy as np

from ...messages.samples import TIME, Floats
from ..columns import TraceError
from ..source import MOST_COLUMNS, NO_TEXT, Block, Source, Text, number_of
from .signals import ControllerAxis, ControllerSignal, sinumerik_signal
from .xml_reader import XmlReader

ROOT = "traceSession"
LONGEST_INTERVAL_S = 1e6
MOST_FRAMES = 1000
FRAME_GAP_S = 1.0
"""Time between two frames where the file does not say it."""
LATEST_S = 1e12
"""A record beyond this time has none."""
MOST_VALUES = 1 << 24
"""Of all frames together; 16 bytes each."""
LONGEST_SILENCE_ROWS = 10_000_000
"""More rows than this without a record are a broken clock, not an axis at rest."""
_SILENT_INTERVALS = 1.5
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


@dataclass(slots=True)
class DataFrame:
    """One `<dataFrame>`: what its `<frameHeader>` says, and its signals with their records."""

    start_time: str = ""  # wall-clock time as it stands there; empty where it does not
    stop_s: float | None = None  # time of the last sample, s; None where it does not say
    drop_outs: int = 0  # how often the controller lost samples
    signals: dict[str, SignalRecords] = field(default_factory=dict)  # by id
    newest_s: float = -math.inf  # time of the last record, s
    records: int = 0  # number of them
    # stretches without a record, s
    silences: list[tuple[float, float]] = field(default_factory=list)
    # what stands in place of numbers, by name of the signal
    text: dict[str, Text] = field(default_factory=dict)


class RecordGrid:
    """Rows on the clock of the fastest signal.

    A row holds, of each signal, the newest record not later than the row; nothing (NaN) before its
    first record, and nothing from one interval after its last sample. The phase of the rows is that
    of the first record of a fastest signal.

    Args:
        signals: in the order of the columns.
        frame: that they are of; with drop-outs there are no rows in its silences, which are
            standstill without.

    Attributes:
        rows: number of rows, those in silences included.
    """

    def __init__(self, signals: Sequence[SignalRecords], frame: DataFrame) -> None:
        self._signals, self._newest_s, stop_s = signals, frame.newest_s, frame.stop_s
        self._silences = np.array(frame.silences).reshape(-1, 2) if frame.drop_outs else None
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
        end_s = max(frame.newest_s, -math.inf if math.isinf(end_s) else end_s)
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


class SinumerikSource(Source):
    """An open trace. Columns are `time_s` and the signals by name, in the controller's units.

    Records are sparse: a value that stands in none has not changed. Rows are those of the fastest
    wanted signal; slower ones are held (or drawn as straight lines, where positions shall be
    interpolated). Nothing is known of a signal before its first record, nor beyond its number of
    samples. Where the controller dropped samples, silence is not taken for standstill: a stretch
    without records has no rows. Later frames follow at the distance of their start times.
    """

    def __init__(self, path: Path, file: IO[bytes], axis: ControllerAxis) -> None:
        super().__init__(path, file)
        self._interpolate_positions = axis.interpolate_positions
        self._frames: list[DataFrame] = []
        self._records, self._values, self._read_up_to = 0, 0, ""
        self._has_root = False
        so_far = lambda: f"; {self._records} records were read{self._read_up_to}"  # noqa: E731
        self._xml = XmlReader(path, file, self._start, so_far=so_far)
        self._has_more = True
        while self._has_more and not self._records:
            self._has_more = self._xml.feed()
        if not self._frames or not self._frames[0].signals:
            raise TraceError(
                f"{path}: a trace session without data; expected <dataFrame> with <dataSignal>"
            )
        self._signals = list(self._frames[0].signals.values())
        self.names = (TIME, *(signal.name for signal in self._signals))
        self._blocks = self._read_blocks()

    @property
    def signals(self) -> list[ControllerSignal]:
        """The signals that belong to an axis."""
        found = (sinumerik_signal(signal.name, signal.unit) for signal in self._signals)
        return [signal for signal in found if signal is not None]

    @property
    def remarks(self) -> tuple[str, ...]:
        wanted = [signal for signal in self._signals if signal.name in self.wanted]
        fastest_s = min((signal.interval_s for signal in wanted), default=0.0)
        slower = [signal.name for signal in wanted if signal.interval_s > fastest_s]
        remarks = []
        if slower:
            how = "interpolated or held" if self._interpolate_positions else "held"
            remarks.append(f"slower than the rows' {fastest_s:g} s and {how}: {', '.join(slower)}")
        remarks += [
            f"frame {number}: {frame.drop_outs} drop-outs; stretches without records are gaps"
            for number, frame in enumerate(self._frames, start=1)
            if frame.drop_outs
        ]
        return tuple(remarks)

    def read_block(self) -> Block | None:
        return next(self._blocks, None)

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        if not self._has_root and name != ROOT:
            raise TraceError(
                f"{self.path}: no trace but an HTML or XML document <{name[:40]}>; "
                f"expected <{ROOT}>, a SINUMERIK Solution Line Trace"
            )
        self._has_root = True
        if name == "dataFrame":
            if len(self._frames) >= MOST_FRAMES:
                raise TraceError(f"{self.path}: more than {MOST_FRAMES} frames")
            self._frames.append(DataFrame())
        if not self._frames:
            return
        frame = self._frames[-1]
        if name == "rec":
            self._add(frame, attributes)
        elif name == "frameHeader":
            frame.start_time = attributes.get("startTime", "")
            frame.stop_s = _finite(attributes.get("stopInc")) or None
            frame.drop_outs = int(_finite(attributes.get("dropOuts")))
        elif name == "dataSignal":
            key = attributes.get("id", "")
            title = attributes.get("name") or key
            interval_s = _finite(attributes.get("interval"))
            if not key or not 0.0 < interval_s <= LONGEST_INTERVAL_S:
                raise TraceError(
                    f"{self.path}: signal {title[:80]!r}: id {key[:40]!r}, interval "
                    f"{attributes.get('interval', '')[:40]!r}; expected an id and seconds above 0"
                )
            if sum(len(each.signals) for each in self._frames) >= MOST_COLUMNS:
                raise TraceError(f"{self.path}: more than {MOST_COLUMNS} signals")
            count = int(max(_finite(attributes.get("datapointCount")), 0.0)) or None
            unit = attributes.get("unitsType", "")
            drawn = self._interpolate_positions and unit == "posn"
            frame.signals[key] = SignalRecords(interval_s, title, unit, count, drawn)

    def _add(self, frame: DataFrame, attributes: dict[str, str]) -> None:
        """Keep a record; one without a time, or not after the last, is set aside."""
        self._records += 1
        self._read_up_to = f" up to {attributes.get('time', '?')[:20]} s"
        time_s = number_of(attributes.pop("time", ""))
        if not time_s > frame.newest_s or abs(time_s) > LATEST_S:
            self.ragged_rows += 1
            return
        if frame.drop_outs:
            fastest_s = min((each.interval_s for each in frame.signals.values()), default=0.0)
            if time_s - frame.newest_s > _SILENT_INTERVALS * fastest_s:
                frame.silences.append((frame.newest_s, time_s))
        frame.newest_s = time_s
        frame.records += 1
        for key, text in attributes.items():
            signal = frame.signals.get(key)
            if signal is None:
                continue
            value = number_of(text)
            if math.isnan(value) and not text.strip().lower().endswith("nan"):
                before = frame.text.get(signal.name, NO_TEXT)
                frame.text[signal.name] = before + Text(1, {text[:40]: 1})
            signal.times_s.append(time_s)
            signal.values.append(value)
            self._values += 1
        if self._values > MOST_VALUES:
            raise TraceError(f"{self.path}: more than {MOST_VALUES} values; cut the recording")

    def _read_blocks(self) -> Iterator[Block]:
        number, newest_s = 0, -math.inf
        while True:
            while self._has_more and len(self._frames) <= number + 1:
                self._has_more = self._xml.feed()
            if number == len(self._frames):
                return
            frame = self._frames[number]
            offset_s = self._offset_s(frame, newest_s)
            for block in self._rows(frame):
                block.values[TIME] += offset_s
                if len(block):
                    newest_s = float(block.values[TIME][-1])
                yield block
            number += 1

    def _rows(self, frame: DataFrame) -> Iterator[Block]:
        by_name = {each.name: each for each in frame.signals.values() if each.name in self.wanted}
        if not by_name:
            return
        absent = SignalRecords(max(each.interval_s for each in by_name.values()))
        names = [name for name in self.wanted if name != TIME]
        signals = [by_name.get(name, absent) for name in names]
        grid = RecordGrid(signals, frame)
        if grid.rows - frame.records > LONGEST_SILENCE_ROWS:
            raise TraceError(
                f"{self.path}: {grid.rows} samples without a record up to {frame.newest_s:g} s; "
                "the clock of the file is broken"
            )
        for time_s, columns in grid.blocks():
            values = dict(zip(names, columns, strict=True)) | {TIME: time_s}
            text, frame.text = frame.text, {}
            yield Block(values, self._number_rows(len(time_s)), text)

    def _offset_s(self, frame: DataFrame, newest_s: float) -> float:
        """Origin of the time of a frame, s after the first frame's zero."""
        if math.isinf(newest_s):
            return 0.0
        after_s = newest_s + FRAME_GAP_S
        try:
            texts = self._frames[0].start_time, frame.start_time
            first, this = map(datetime.fromisoformat, texts)
            offset_s = (this - first).total_seconds()
        except (ValueError, TypeError):  # no times, or one of the two has a time zone
            return after_s
        return offset_s if offset_s > newest_s else after_s


def _finite(text: str | None) -> float:
    """The number that an attribute holds; 0 where it holds none."""
    value = number_of(text)
    return value if math.isfinite(value) else 0.0
