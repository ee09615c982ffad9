"""The XML of a SINUMERIK "Solution Line Trace": records one by one, and rows block by block."""

import math
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import IO

from ...messages.samples import TIME, Floats
from ..columns import TraceError
from ..source import MOST_COLUMNS, Block, Source, Text
from .record_grid import BLOCK_ROWS, RecordGrid, SignalClock
from .signals import ControllerAxis, ControllerSignal, sinumerik_signal
from .xml_reader import XmlReader

ROOT = "traceSession"
LONGEST_INTERVAL_S = 1e6
MOST_FRAMES = 1000
FRAME_GAP_S = 1.0
"""Time between two frames where the file does not say it."""
LATEST_S = 1e12
"""A record beyond this time has none."""
LONGEST_SILENCE_ROWS = 10_000_000
"""More rows than this without a record are a broken clock, not an axis at rest."""
_SILENT_INTERVALS = 1.5


@dataclass(frozen=True, slots=True)
class DataSignal:
    """One `<dataSignal>`: id of its attribute, name, unit, interval in s, number of samples."""

    key: str
    name: str
    units_type: str
    interval_s: float
    count: int | None


@dataclass(slots=True)
class DataFrame:
    """One `<dataFrame>`: what its `<frameHeader>` says, and its signals by id.

    Attributes:
        number: from 1.
        start_time: wall-clock time as it stands there; empty where it does not.
        stop_s: time of the last sample, s; None where it does not say.
        drop_outs: how often the controller lost samples.
    """

    number: int
    start_time: str = ""
    stop_s: float | None = None
    drop_outs: int = 0
    signals: dict[str, DataSignal] = field(default_factory=dict)


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
        self._signals_wanted: tuple[str, ...] = ()
        self._frame: DataFrame | None = None
        self._grid: RecordGrid | None = None
        self._column_of: dict[str, int] = {}
        self._offset_s = 0.0
        self._time_s = -math.inf
        self._text: dict[str, Text] = {}
        self._frames: list[DataFrame] = []
        self._records: list[tuple[DataFrame, dict[str, str]]] = []
        self._records_read = 0
        self._root = self._read_up_to = ""
        self._xml = XmlReader(path, file, self._start, so_far=self._so_far)
        self._finished = False
        while not self._records and not self._finished:
            self._read_on()
        if not self._frames or not self._frames[0].signals:
            raise TraceError(
                f"{path}: a trace session without data; expected <dataFrame> with <dataSignal>"
            )
        self._signals = tuple(self._frames[0].signals.values())
        self.names = (TIME, *(signal.name for signal in self._signals))

    @property
    def signals(self) -> list[ControllerSignal]:
        """The signals that belong to an axis."""
        found = (sinumerik_signal(signal.name, signal.units_type) for signal in self._signals)
        return [signal for signal in found if signal is not None]

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on what was done to the clocks, one line each."""
        wanted = [signal for signal in self._signals if signal.name in self._signals_wanted]
        fastest_s = min((signal.interval_s for signal in wanted), default=0.0)
        slower = [signal.name for signal in wanted if signal.interval_s > fastest_s]
        remarks = []
        if slower:
            how = "interpolated or held" if self._interpolate_positions else "held"
            remarks.append(f"slower than the rows' {fastest_s:g} s and {how}: {', '.join(slower)}")
        remarks += [
            f"frame {frame.number}: {frame.drop_outs} drop-outs; stretches without records are gaps"
            for frame in self._frames
            if frame.drop_outs
        ]
        return tuple(remarks)

    def want(self, names: list[str]) -> None:
        """Read these columns only."""
        self.wanted = names
        self._signals_wanted = tuple(name for name in names if name != TIME)

    def read_block(self) -> Block | None:
        """The next rows, or None at the end. Raises TraceError and OSError."""
        while True:
            for index, (frame, attributes) in enumerate(self._records):
                if frame is not self._frame:
                    block = self._block(final=True)
                    if block is not None:
                        self._records = self._records[index:]
                        return block
                    self._begin(frame)
                self._add(attributes)
            self._records = []
            block = self._block(final=self._finished)
            if block is not None or self._finished:
                return block
            self._read_on()

    def _read_on(self) -> None:
        """Read the next piece of the file. Raises TraceError."""
        self._finished = not self._xml.feed()
        self._count()

    def _count(self) -> None:
        if self._records:
            self._records_read += len(self._records)
            self._read_up_to = f" up to {self._records[-1][1].get('time', '?')[:20]} s"

    def _so_far(self) -> str:
        self._count()
        return f"; {self._records_read} records were read{self._read_up_to}"

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        """Take in an element."""
        if name == "rec" and self._frames:
            self._records.append((self._frames[-1], attributes))
        elif not self._root and name != ROOT:
            raise TraceError(
                f"{self.path}: no trace but an HTML or XML document <{name[:40]}>; "
                f"expected <{ROOT}>, a SINUMERIK Solution Line Trace"
            )
        elif name == "dataFrame":
            if len(self._frames) >= MOST_FRAMES:
                raise TraceError(f"{self.path}: more than {MOST_FRAMES} frames")
            self._frames.append(DataFrame(len(self._frames) + 1))
        elif name == "frameHeader" and self._frames:
            frame = self._frames[-1]
            frame.start_time = attributes.get("startTime", "")
            frame.stop_s = _finite(attributes.get("stopInc")) or None
            frame.drop_outs = int(_finite(attributes.get("dropOuts")) or 0)
        elif name == "dataSignal" and self._frames:
            key = attributes.get("id", "")
            title = attributes.get("name") or key
            interval_s = _finite(attributes.get("interval"))
            if not key or interval_s is None or not 0.0 < interval_s <= LONGEST_INTERVAL_S:
                raise TraceError(
                    f"{self.path}: signal {title[:80]!r}: id {key[:40]!r}, interval "
                    f"{attributes.get('interval', '')[:40]!r}; expected an id and seconds above 0"
                )
            if sum(len(frame.signals) for frame in self._frames) >= MOST_COLUMNS:
                raise TraceError(f"{self.path}: more than {MOST_COLUMNS} signals")
            count = int(max(_finite(attributes.get("datapointCount")) or 0.0, 0.0)) or None
            units_type = attributes.get("unitsType", "")
            self._frames[-1].signals[key] = DataSignal(key, title, units_type, interval_s, count)
        self._root = self._root or name

    def _begin(self, frame: DataFrame) -> None:
        """Start a frame: its clocks, and its place in time."""
        by_name = {signal.name: signal for signal in frame.signals.values()}
        known = [by_name[name] for name in self._signals_wanted if name in by_name]
        self._column_of = {
            by_name[name].key: index
            for index, name in enumerate(self._signals_wanted)
            if name in by_name
        }
        self._grid = None
        if self._frame is not None:
            self._offset_s = self._next_offset_s(frame)
        self._frame = frame
        if known:
            fastest_s = min(signal.interval_s for signal in frame.signals.values())
            silence_s = _SILENT_INTERVALS * fastest_s if frame.drop_outs else None
            absent = SignalClock(max(signal.interval_s for signal in known))
            clocks = {
                each.name: SignalClock(
                    each.interval_s,
                    each.count,
                    self._interpolate_positions and each.units_type == "posn",
                )
                for each in known
            }
            wanted = [clocks.get(name, absent) for name in self._signals_wanted]
            self._grid = RecordGrid(wanted, frame.stop_s, silence_s)

    def _next_offset_s(self, frame: DataFrame) -> float:
        """Origin of the time of a further frame, s after the first frame's zero."""
        after_s = self._time_s + FRAME_GAP_S
        try:
            first, this = (
                datetime.fromisoformat(each.start_time) for each in (self._frames[0], frame)
            )
            offset_s = (this - first).total_seconds()
        except (ValueError, TypeError):  # no times, or one of the two has a time zone
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
                    name = self._signals_wanted[index]
                    before = self._text.get(name, Text(0, text[:40]))
                    self._text[name] = Text(before.count + 1, before.first)
        self._grid.add(time_s, values)

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
        values: dict[str, Floats] = dict(zip(self._signals_wanted, columns, strict=True))
        values[TIME] = time_s
        text, self._text = self._text, {}
        return Block(values, self._number_rows(len(time_s)), text)


def _float(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _finite(text: str | None) -> float | None:
    value = _float(text or "")
    return value if value is not None and math.isfinite(value) else None


def recognises(head: bytes, _path: Path) -> bool:
    """Return whether a file begins as such a trace."""
    return f"<{ROOT}".encode() in head
