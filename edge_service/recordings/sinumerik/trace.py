"""The XML of a SINUMERIK "Solution Line Trace": records one by one, and rows block by block."""

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import IO

import numpy as np

from ...messages.samples import TIME
from ..columns import TraceError
from ..source import MOST_COLUMNS, Block, Source, Text
from .record_grid import RecordGrid, SignalRecords
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
"""Of one frame."""
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


Records = list[tuple[DataFrame, dict[str, str]]]


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
        self._text: dict[str, Text] = {}
        self._frames: list[DataFrame] = []
        self._time_s = self._newest_s = -math.inf  # of all rows, and of the records of a frame
        self._silences: list[tuple[float, float]] = []
        self._silence_s = math.inf
        self._count = 0
        pieces = self._read_pieces()
        first = next((piece for piece in pieces if piece), [])
        if not self._frames or not self._frames[0].signals:
            raise TraceError(
                f"{path}: a trace session without data; expected <dataFrame> with <dataSignal>"
            )
        self._signals = tuple(self._frames[0].signals.values())
        self.names = (TIME, *(signal.name for signal in self._signals))
        self._blocks = self._read_blocks(itertools.chain([first], pieces))

    @property
    def signals(self) -> list[ControllerSignal]:
        """The signals that belong to an axis."""
        found = (sinumerik_signal(signal.name, signal.units_type) for signal in self._signals)
        return [signal for signal in found if signal is not None]

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on what was done to the clocks, one line each."""
        wanted = [signal for signal in self._signals if signal.name in self.wanted]
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

    def read_block(self) -> Block | None:
        """The next rows, or None at the end. Raises TraceError and OSError."""
        return next(self._blocks, None)

    def _read_pieces(self) -> Iterator[Records]:
        """Records of each piece of the file. Raises TraceError."""
        root, read, up_to = "", 0, ""
        records: Records = []

        def so_far() -> str:
            count()
            return f"; {read} records were read{up_to}"

        def count() -> None:
            nonlocal read, up_to
            if records:
                read += len(records)
                up_to = f" up to {records[-1][1].get('time', '?')[:20]} s"

        def start(name: str, attributes: dict[str, str]) -> None:
            nonlocal root
            if not root and name != ROOT:
                raise TraceError(
                    f"{self.path}: no trace but an HTML or XML document <{name[:40]}>; "
                    f"expected <{ROOT}>, a SINUMERIK Solution Line Trace"
                )
            root = ROOT
            if name == "dataFrame":
                if len(self._frames) >= MOST_FRAMES:
                    raise TraceError(f"{self.path}: more than {MOST_FRAMES} frames")
                self._frames.append(DataFrame(len(self._frames) + 1))
            elif name == "rec" and self._frames:
                records.append((self._frames[-1], attributes))
            elif name == "frameHeader" and self._frames:
                frame = self._frames[-1]
                frame.start_time = attributes.get("startTime", "")
                frame.stop_s = _finite(attributes.get("stopInc")) or None
                frame.drop_outs = int(_finite(attributes.get("dropOuts")) or 0)
            elif name == "dataSignal" and self._frames:
                signal = self._data_signal(attributes)
                self._frames[-1].signals[signal.key] = signal

        xml = XmlReader(self.path, self._file, start, so_far=so_far)
        more = True
        while more:
            more = xml.feed()
            count()
            yield records.copy()
            records.clear()

    def _data_signal(self, attributes: dict[str, str]) -> DataSignal:
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
        return DataSignal(key, title, attributes.get("unitsType", ""), interval_s, count)

    def _read_blocks(self, pieces: Iterable[Records]) -> Iterator[Block]:
        """The rows of one frame after the other, on one clock."""
        frame: DataFrame | None = None
        records: dict[str, SignalRecords] = {}
        for this, attributes in itertools.chain.from_iterable(pieces):
            if this is not frame:
                if frame is not None:
                    yield from self._rows(frame, records)
                frame, records = this, self._begin(this)
            if records:
                self._add(records, attributes)
        if frame is not None:
            yield from self._rows(frame, records)

    def _begin(self, frame: DataFrame) -> dict[str, SignalRecords]:
        """No records yet of the wanted signals of a frame, by id."""
        self._newest_s, self._silences, self._count = -math.inf, [], 0
        fastest_s = min((each.interval_s for each in frame.signals.values()), default=0.0)
        self._silence_s = _SILENT_INTERVALS * fastest_s if frame.drop_outs else math.inf
        return {
            each.key: SignalRecords(
                each.interval_s,
                each.count,
                self._interpolate_positions and each.units_type == "posn",
            )
            for each in frame.signals.values()
            if each.name in self.wanted
        }

    def _add(self, records: dict[str, SignalRecords], attributes: dict[str, str]) -> None:
        """Keep a record; one without a time, or not after the last, is set aside."""
        time_s = _float(attributes.pop("time", ""))
        if time_s is None or not time_s > self._newest_s or abs(time_s) > LATEST_S:
            self.ragged_rows += 1
            return
        if time_s - self._newest_s > self._silence_s:
            self._silences.append((self._newest_s, time_s))
        self._newest_s = time_s
        for key, text in attributes.items():
            if key in records:
                value = _float(text)
                if value is None:
                    name = self._frames[-1].signals[key].name
                    before = self._text.get(name, Text(0, text[:40]))
                    self._text[name] = Text(before.count + 1, before.first)
                records[key].times_s.append(time_s)
                records[key].values.append(math.nan if value is None else value)
                self._count += 1
        if self._count > MOST_VALUES:
            raise TraceError(f"{self.path}: more than {MOST_VALUES} values in a frame")

    def _rows(self, frame: DataFrame, records: dict[str, SignalRecords]) -> Iterator[Block]:
        if not records:
            return
        by_name = {
            each.name: records[each.key] for each in frame.signals.values() if each.key in records
        }
        absent = SignalRecords(max(each.interval_s for each in records.values()))
        names = [name for name in self.wanted if name != TIME]
        signals = [by_name.get(name, absent) for name in names]
        silences = np.array(self._silences).reshape(-1, 2) if frame.drop_outs else None
        grid = RecordGrid(signals, self._newest_s, frame.stop_s, silences)
        if grid.rows - self._count > LONGEST_SILENCE_ROWS:
            raise TraceError(
                f"{self.path}: {grid.rows} samples without a record up to {self._newest_s:g} s; "
                "the clock of the file is broken"
            )
        offset_s = self._offset_s(frame)
        for frame_s, columns in grid.blocks():
            values = dict(zip(names, columns, strict=True)) | {TIME: frame_s + offset_s}
            if len(frame_s):
                self._time_s = float(values[TIME][-1])
            text, self._text = self._text, {}
            yield Block(values, self._number_rows(len(frame_s)), text)

    def _offset_s(self, frame: DataFrame) -> float:
        """Origin of the time of a frame, s after the first frame's zero."""
        if math.isinf(self._time_s):
            return 0.0
        after_s = self._time_s + FRAME_GAP_S
        try:
            first, this = (
                datetime.fromisoformat(each.start_time) for each in (self._frames[0], frame)
            )
            offset_s = (this - first).total_seconds()
        except (ValueError, TypeError):  # no times, or one of the two has a time zone
            return after_s
        return offset_s if offset_s > self._time_s else after_s


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
