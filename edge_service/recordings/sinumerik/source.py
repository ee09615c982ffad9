"""Rows of a SINUMERIK "Solution Line Trace", block by block."""

import math
from datetime import datetime
from pathlib import Path

from ...messages.channels import TIME
from ...messages.samples import Floats
from ..block import Block, Text, number_rows
from ..columns import TraceError
from .controller_signals import ControllerSignal, sinumerik_signal
from .parser import ROOT, DataFrame, DataSignal, Record, SinumerikParser
from .record_grid import BLOCK_ROWS, RecordGrid, SignalClock

HEAD_BYTES = 1 << 16
FRAME_GAP_S = 1.0
"""Time between two frames where the file does not say it."""
LATEST_S = 1e12
"""A record beyond this time has none."""
LONGEST_SILENCE_ROWS = 10_000_000
"""More rows than this without a record are a broken clock, not an axis at rest."""
_SILENT_INTERVALS = 1.5


def is_sinumerik(head: bytes) -> bool:
    """Tell whether the first bytes of a file are those of a trace in XML."""
    return f"<{ROOT}".encode() in head


class SinumerikSource:
    """An open trace. Columns are `time_s` and the signals by name, in the controller's units.

    Records are sparse: a value that stands in none has not changed. Rows are those of the fastest
    wanted signal; slower ones are held (or drawn as straight lines, where positions shall be
    interpolated). Nothing is known of a signal before its first record, nor beyond its number of
    samples. Where the controller dropped samples, silence is not taken for standstill: a stretch
    without records has no rows. Later frames follow at the distance of their start times.
    """

    def __init__(self, path: Path, interpolate_positions: bool = False) -> None:
        self.path = path
        self.ragged_rows = 0
        self._interpolate_positions = interpolate_positions
        self._wanted: tuple[str, ...] = ()
        self._frame: DataFrame | None = None
        self._grid: RecordGrid | None = None
        self._column_of: dict[str, int] = {}
        self._offset_s = 0.0
        self._time_s = -math.inf
        self._rows_seen = 0
        self._text: dict[str, Text] = {}
        self._bytes = path.stat().st_size
        self._file = path.open("rb")
        try:
            self._parser = SinumerikParser(path, self._file)
            self._records = self._first_records()
        except BaseException:
            self._file.close()
            raise
        self._signals = tuple(self._parser.frames[0].signals.values())
        self.names = (TIME, *(signal.name for signal in self._signals))

    @property
    def signals(self) -> list[ControllerSignal]:
        """The signals that belong to an axis."""
        found = (sinumerik_signal(signal.name, signal.units_type) for signal in self._signals)
        return [signal for signal in found if signal is not None]

    @property
    def fraction_read(self) -> float:
        """Fraction of the file that has been read, 0 to 1."""
        return 1.0 if self._file.closed else self._file.tell() / max(self._bytes, 1)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on what was done to the clocks, one line each."""
        wanted = [signal for signal in self._signals if signal.name in self._wanted]
        fastest_s = min((signal.interval_s for signal in wanted), default=0.0)
        slower = [signal.name for signal in wanted if signal.interval_s > fastest_s]
        remarks = []
        if slower:
            how = "interpolated or held" if self._interpolate_positions else "held"
            remarks.append(f"slower than the rows' {fastest_s:g} s and {how}: {', '.join(slower)}")
        remarks += [
            f"frame {frame.number}: {frame.drop_outs} drop-outs; stretches without records are gaps"
            for frame in self._parser.frames
            if frame.drop_outs
        ]
        return tuple(remarks)

    def holds_numbers(self, name: str) -> bool:
        """Every signal does."""
        return name in self.names

    def want(self, names: list[str]) -> None:
        """Read these columns only."""
        self._wanted = tuple(name for name in names if name != TIME)

    def close(self) -> None:
        """Close the file; safe twice."""
        self._file.close()

    def read_block(self) -> Block | None:
        """The next rows, or None at the end. Raises TraceError and OSError."""
        while True:
            while self._records:
                block = self._read_records()
                if block is not None:
                    return block
            block = self._block(final=self._parser.finished)
            if block is not None:
                return block
            if self._parser.finished:
                return None
            self._records = self._parser.read()

    def _first_records(self) -> list[Record]:
        records: list[Record] = []
        while not records and not self._parser.finished:
            records = self._parser.read()
        if not self._parser.frames or not self._parser.frames[0].signals:
            raise TraceError(
                f"{self.path}: a trace session without data; expected <dataFrame> with <dataSignal>"
            )
        return records

    def _read_records(self) -> Block | None:
        """Add the records of one frame; a block if the frame before must be finished first."""
        for index, (frame, attributes) in enumerate(self._records):
            if frame is not self._frame:
                block = self._block(final=True)
                if block is not None:
                    self._records = self._records[index:]
                    return block
                self._begin(frame)
            self._add(attributes)
        self._records = []
        return None

    def _begin(self, frame: DataFrame) -> None:
        """Start a frame: its clocks, and its place in time."""
        by_name = {signal.name: signal for signal in frame.signals.values()}
        signals = [by_name.get(name) for name in self._wanted]
        known = [signal for signal in signals if signal is not None]
        self._column_of = {
            signal.key: index for index, signal in enumerate(signals) if signal is not None
        }
        self._grid = None
        if self._frame is not None:
            self._offset_s = self._next_offset_s(frame)
        self._frame = frame
        if known:
            fastest_s = min(signal.interval_s for signal in frame.signals.values())
            silence_s = _SILENT_INTERVALS * fastest_s if frame.drop_outs else None
            absent = SignalClock(max(signal.interval_s for signal in known))
            clocks = [self._clock(signal) if signal else absent for signal in signals]
            self._grid = RecordGrid(clocks, frame.stop_s, silence_s)

    def _clock(self, signal: DataSignal) -> SignalClock:
        interpolate = self._interpolate_positions and signal.units_type == "posn"
        return SignalClock(signal.interval_s, signal.count, interpolate)

    def _next_offset_s(self, frame: DataFrame) -> float:
        """Origin of the time of a further frame, s after the first frame's zero."""
        first, this = (_start(each.start_time) for each in (self._parser.frames[0], frame))
        after_s = self._time_s + FRAME_GAP_S
        if first is None or this is None:
            return after_s
        try:
            offset_s = (this - first).total_seconds()
        except TypeError:  # one of the two has a time zone
            return after_s
        return offset_s if offset_s > self._time_s else after_s

    def _add(self, attributes: dict[str, str]) -> None:
        """Put a record into the grid; one without a time, or not after the last, is set aside."""
        if self._grid is None:
            return
        time_s = _float(attributes.pop("time", ""))
        if time_s is None or not time_s > self._grid.newest_s or abs(time_s) > LATEST_S:
            self.ragged_rows += 1
            return
        values = []
        for key, text in attributes.items():
            index = self._column_of.get(key)
            if index is not None:
                value = _float(text)
                values.append((index, math.nan if value is None else value))
                if value is None:
                    self._note_text(self._wanted[index], text)
        self._grid.add(time_s, values)

    def _note_text(self, name: str, text: str) -> None:
        before = self._text.get(name, Text(0, text[:40]))
        self._text[name] = Text(before.count + 1, before.first)

    def _block(self, final: bool) -> Block | None:
        """Rows that are due; `final` for all of a frame that has ended."""
        rows = 0 if self._grid is None else self._grid.rows_ahead(final)
        if self._grid is None or not (rows if final else rows >= BLOCK_ROWS):
            return None
        if rows > LONGEST_SILENCE_ROWS:
            raise TraceError(
                f"{self.path}: {rows} samples without a record up to {self._grid.newest_s:g} s; "
                "the clock of the file is broken"
            )
        time_s, columns = self._grid.take(min(rows, BLOCK_ROWS))
        time_s = time_s + self._offset_s
        if len(time_s):
            self._time_s = float(time_s[-1])
        values: dict[str, Floats] = dict(zip(self._wanted, columns, strict=True))
        values[TIME] = time_s
        number = number_rows(self._rows_seen, len(time_s))
        self._rows_seen += len(time_s)
        text, self._text = self._text, {}
        return Block(values, number, text)


def _start(text: str) -> datetime | None:
    try:
        return datetime.fromisoformat(text)
    except ValueError:
        return None


def _float(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
