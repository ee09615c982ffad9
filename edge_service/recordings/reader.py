"""Reading a trace: any supported file in, frames of canonical channels in SI units out."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, suppress
from pathlib import Path

import numpy as np

from ..messages.samples import CHANNELS, TIME, Booleans, ColumnMap, Floats, SampleFrame
from .columns import ROW_NUMBER, TraceError, choose_columns
from .forms import open_source
from .parquet import PARQUET_SUFFIXES, parquet_extent
from .sinumerik.edge import EdgeSource, edge_recording
from .sinumerik.signals import (
    SINUMERIK_SIGNALS,
    ControllerAxis,
    ControllerColumns,
    edge_meanings,
    edge_signals,
    map_signals,
)
from .sinumerik.trace import SinumerikSource
from .source import NO_TEXT, Block, Source, Text

MOST_ROWS = 20_000_000
"""Of a recording that is read into one frame."""
MOST_SPREAD, ASKED = 600_000, 150_000
"""Rows of a file that are examined, ten minutes at 1 kHz; that are asked before an estimate."""
_CHUNK_BYTES, _LINE_BYTES = 1 << 20, 1 << 14
Extent = tuple[int | None, float | None, float | None]
"""Rows, first and last `time_s` of a recording; None: not known."""


class DirectionSign:
    """Signs of successive blocks: +1 or -1 from the last change on; NaN before the first one."""

    def __init__(self) -> None:
        self._value, self._sign = np.nan, np.nan

    def of(self, values: Floats) -> Floats:
        """Signs for the next values, shape (n,) each; a missing value changes nothing."""
        before = np.append(self._value, values)
        known = _last(before, np.isfinite(before))
        turns = np.append(self._sign, np.sign(np.nan_to_num(np.diff(known))))
        signs = _last(turns, turns != 0.0)
        self._value, self._sign = float(known[-1]), float(signs[-1])
        return signs[1:]


def _last(values: Floats, counts: Booleans) -> Floats:
    """Values, each that does not count replaced by the last one before it that does, (n,)."""
    return values[np.maximum.accumulate(np.where(counts, np.arange(len(values)), 0))]


class TraceReader(Iterator[SampleFrame], AbstractContextManager["TraceReader"]):
    """An open trace: an iterator of frames, and a context manager that closes the file.

    Faults inside a recording are data: a cell without a number is NaN and counted, a row without
    a time or with the wrong number of cells is left out and counted; times that repeat, jump or
    run backwards are handed on as they are.

    Attributes:
        path: the file.
        channels: the channels that it holds, in the order of writing; then, if asked for, its
            other columns under their own names and in their own units.
        ignored: columns that are there and not read.
        rows_read: rows handed out so far.
        bad_cells: `time_s` or channel -> cells without a number so far.
    """

    def __init__(
        self,
        path: Path,
        source: Source,
        columns: Mapping[str, ColumnMap],
        remarks: tuple[str, ...] = (),
    ) -> None:
        self.path = path
        self.channels = tuple(channel for channel in columns if channel != TIME)
        self.rows_read = 0
        self.bad_cells = dict.fromkeys(columns, 0)
        self._source, self._columns, self._remarks = source, columns, remarks
        self._text: dict[str, Text] = {}
        self._has_number: set[str] = set()
        names = dict.fromkeys(name for column in columns.values() for name in column.names)
        self.ignored = tuple(name for name in source.names if name and name not in names)
        needed = (column.names for name, column in columns.items() if name in (TIME, *CHANNELS))
        self._needed = {name for each in needed for name in each}
        self._directions = {
            channel: DirectionSign() for channel, column in columns.items() if column.direction
        }
        self._source.want([name for name in names if name != ROW_NUMBER])

    @property
    def ragged_rows(self) -> int:
        return self._source.ragged_rows

    @property
    def fraction_read(self) -> float:
        return self._source.fraction_read

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on how signals of a controller were read, one line each; complete at the end."""
        unread = [f"{name!r}: {text}" for name, text in self._text.items()]
        return (*self._remarks, *self._source.remarks, *unread)

    def __next__(self) -> SampleFrame:
        """The next frame, never empty. Raises TraceError for a file that turns out to be none."""
        while True:
            try:
                block = self._source.read_block()
            except OSError as error:
                raise _unreadable(self.path, error) from None
            if block is None:
                self._check_whole()
                raise StopIteration
            self._note_text(block)
            time_s = self._values(TIME, block)
            frame = SampleFrame(time_s, {name: self._values(name, block) for name in self.channels})
            if np.isnan(time_s).any():
                frame = frame.part(~np.isnan(time_s))
            self.rows_read += len(frame)
            if len(frame):
                return frame

    def close(self) -> None:
        self._source.close()

    def __exit__(self, *_: object) -> None:
        self.close()

    def _values(self, channel: str, block: Block) -> Floats:
        column = self._columns[channel]
        is_row_number = column.column == ROW_NUMBER
        values = block.row_number if is_row_number else block.values[column.column]
        if column.minus:
            values = values - block.values[column.minus]
        if channel in self._directions:
            signs = self._directions[channel].of(block.values[column.direction])
            values = np.abs(values) * signs
        if (column.scale, column.offset) != (1.0, 0.0):
            with np.errstate(over="ignore", invalid="ignore"):
                values = values * column.scale + column.offset
        finite = np.isfinite(values)
        self.bad_cells[channel] += int(values.size - np.count_nonzero(finite))
        return np.where(finite, values, np.nan)

    def _note_text(self, block: Block) -> None:
        """Refuse a column of words at once if its first block holds nothing else."""
        for name, values in block.values.items():
            if name in block.text and name in self._needed:
                self._text[name] = self._text.get(name, NO_TEXT) + block.text[name]
            if np.isfinite(values).any():
                self._has_number.add(name)
            elif self.rows_read == 0 and 0 < self._text.get(name, NO_TEXT).count == len(block):
                raise self._no_number(name)

    def _check_whole(self) -> None:
        """At the end: a trace has rows, and every column with content has a number."""
        for name in [name for name in self._text if name not in self._has_number]:
            raise self._no_number(name)
        if self.rows_read:
            return
        untimed = self.bad_cells[TIME]
        if self.ragged_rows > untimed:
            raise TraceError(
                f"{self.path}: no row has the {len(self._source.names)} cells that the header "
                f"names ({self.ragged_rows} rows have fewer or more)"
            )
        problem = f"none of {untimed} rows holds a time" if untimed else "a header but no rows"
        raise TraceError(f"{self.path}: {problem}; expected rows of numbers")

    def _no_number(self, name: str) -> TraceError:
        first = next(iter(self._text[name].named))
        return TraceError(f"{self.path}: column {name!r} holds {first!r} and no number at all")


def open_trace(
    path: Path,
    columns: Mapping[str, ColumnMap] | None = None,
    axis: ControllerAxis | None = None,
    *,
    keep_all: bool = False,
) -> TraceReader:
    """Open a trace file in any form of `FORMS`, told apart by content.

    Args:
        columns: `time_s` or channel -> foreign column with its scale to SI units. It comes before
            what is known of a controller's signals; those it may call by their short names.
        axis: which axis of a controller's recording, and what its units need.
        keep_all: also read the columns that are no channel, under their own names.

    Raises TraceError: one line with the file, what was wrong and what was expected.
    """
    axis = axis or ControllerAxis()
    try:
        source = open_source(path, axis)
    except OSError as error:
        raise _unreadable(path, error) from None
    try:
        return read_source(path, source, columns or {}, axis, keep_all=keep_all)
    except BaseException:
        source.close()
        raise


def read_source(
    path: Path,
    source: Source,
    columns: Mapping[str, ColumnMap],
    axis: ControllerAxis,
    *,
    keep_all: bool = False,
) -> TraceReader:
    """Reader of rows from anywhere; `path` is for messages. Raises TraceError like `open_trace`."""
    columns = dict(columns)
    source = edge_recording(path, source, columns)
    if isinstance(source, EdgeSource) and source.sets_time:
        columns.pop(TIME, None)  # a scale of the count is its period already
    if isinstance(source, SinumerikSource):
        known = map_signals(path, source.signals, SINUMERIK_SIGNALS, axis, columns)
    elif signals := edge_signals(source.names):
        names = source.context.axis_names if isinstance(source, EdgeSource) else {}
        known = map_signals(path, signals, edge_meanings(signals), axis, columns, names)
    else:
        known = ControllerColumns()
    chosen = choose_columns(path, source.names, known.resolve(columns), known.columns)
    remarks = known.remarks(chosen)
    if keep_all:
        used = {column.column for column in chosen.values()} | {TIME, *CHANNELS, ""}
        chosen |= {
            name: ColumnMap(name)
            for name in source.names
            if name not in used and source.names.count(name) == 1 and source.holds_numbers(name)
        }
    return TraceReader(path, source, chosen, remarks)


def read_trace(
    path: Path,
    columns: Mapping[str, ColumnMap] | None = None,
    axis: ControllerAxis | None = None,
    *,
    keep_all: bool = False,
) -> SampleFrame:
    """Read a whole trace into one frame, for offline work; arguments as `open_trace`.

    Raises TraceError: like `open_trace`, and for a file of more than `MOST_ROWS` rows.
    """
    with open_trace(path, columns, axis, keep_all=keep_all) as reader:
        frames = []
        for frame in reader:
            if reader.rows_read > MOST_ROWS:
                raise TraceError(f"{path}: more than {MOST_ROWS} rows; cut the recording")
            frames.append(frame)
        return joined(frames)


def handed(path: Path) -> SampleFrame:
    """Rows that another process left here with `numpy.savez`, a channel an array (n,)."""
    with np.load(path) as held:
        return SampleFrame(held[TIME], {name: held[name] for name in held if name != TIME})


def joined(frames: list[SampleFrame]) -> SampleFrame:
    """Frames that follow one another as one, without quality; the list is emptied meanwhile."""
    time_s, parts = np.concatenate([e.time_s for e in frames]), [dict(e.channels) for e in frames]
    frames.clear()  # so that one channel at a time is there twice
    channels = {name: np.concatenate([p.pop(name) for p in parts]) for name in (*parts[0],)}
    return SampleFrame(time_s, channels)


def _unreadable(path: Path, error: OSError) -> TraceError:
    if isinstance(error, FileNotFoundError):
        return TraceError(f"{path}: no such file; expected a recording")
    return TraceError(f"{path}: cannot be read ({error.strerror or error})")


def extent_of(path: Path) -> Extent:
    """Extent of a Parquet or CSV file; of one in another form, or that is none, what is known."""
    with suppress(OSError, ValueError, TypeError, NotImplementedError, MemoryError):
        return parquet_extent(path, TIME) if path.suffix in PARQUET_SUFFIXES else _of_text(path)
    return None, None, None


def _of_text(path: Path) -> Extent:
    """Extent of text with a header; times are known where the first column is `time_s`."""
    with path.open("rb") as file:
        names, first, end, rows = file.readline(_LINE_BYTES), file.readline(_LINE_BYTES), b"", -1
        file.seek(0)
        while chunk := file.read(_CHUNK_BYTES):
            rows, end = rows + chunk.count(b"\n"), (end + chunk)[-_LINE_BYTES:]
    rows = max(rows + (not end.endswith(b"\n")), 0)
    if rows and names.split(b",")[0].strip() == TIME.encode():
        last = end.rstrip().rpartition(b"\n")[2]
        with suppress(ValueError):
            return rows, float(first.split(b",")[0]), float(last.split(b",")[0])
    return rows, None, None


def spread(frames: Iterable[SampleFrame], most: int = MOST_SPREAD) -> list[SampleFrame]:
    """Unbroken pieces of a recording: all, or every 2nd, 4th, ..., at most `most` rows."""
    kept: list[SampleFrame] = []
    stride = 1
    for number, frame in enumerate(frames):
        if number % stride == 0:
            kept.append(frame)
        while len(kept) > 1 and sum(map(len, kept)) > most:
            stride, kept = 2 * stride, kept[::2]
    return [joined(kept)] if kept and stride == 1 else kept
