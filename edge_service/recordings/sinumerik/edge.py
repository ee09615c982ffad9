"""Recordings of Industrial Edge in any form: rows, `CYCLE` as time, tool and block as columns.

`SignalListHFData` of a `Header` lists a row's signals (`Name`, `Type`, `Axis`, `Address`),
`CycleTimeMs` is the length of a cycle, `CYCLE` the count of the position controller's cycles. An
`HFBlockEvent` says from which count on a block is worked off: `HFProbeCounter`, the count,
`ActiveTool`, `SeekOffset` (place in the program) and `GCode` (text of the block).

As JSON (`Capture4Analysis` of Analyze MyWorkpiece) it has a `Payload` of messages: `HFData` is a
block of samples; `HFTimestamp`, `HFCallEvent` and `LFData` say nothing of the axes.
As CSV such a recording is three files: `..._hfdata.csv` with columns `NAME|axis`, beside it
`..._header.csv` (`SignalName,Type,Axis,Address`) and `..._hfblockevent.csv`.
Layout: CaptureDataParser of max-scw, and the files of Stroebel et al., "A Multimodal Dataset for
Process Monitoring and Anomaly Detection in Industrial CNC Milling" (KIT, 2025).
"""

import codecs
import csv
import json
import math
import os
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, TextIO

import numpy as np

from ...messages.samples import TIME, Booleans, ColumnMap, Floats
from ..columns import TraceError
from ..source import BYTE_ORDER_MARK, MOST_COLUMNS, NO_TEXT, Block, Source, Text, number_of
from .signals import EDGE_CYCLE, edge_signals

PERIOD_S = 0.002
"""Of Industrial Edge's high-frequency data: 500 Hz."""
RESTART_GAP_S = 1.0
"""Time between two runs where the count begins anew."""
WIDE = 1.5
"""A step of so many usual ones is a gap."""
HEADER, PAYLOAD, SAMPLES, EVENT = "Header", "Payload", "HFData", "HFBlockEvent"
SHORTEST_S, LONGEST_S = 1e-5, 10.0
MOST_EVENTS = 2_000_000
_NUMBERS, _GCODE = ("ActiveTool", "SelectedTool", "SeekOffset"), "GCode"
EVENT_COLUMNS = tuple(f"{EVENT}.{name}" for name in (*_NUMBERS, _GCODE))
_COUNTERS = ("HFProbeCounter", "HfProbeCounter")
_LARGEST_FILE, _LONGEST_HEADER, _MOST_AXES = 1 << 28, 1 << 20, 1000
BLOCK_ROWS, CHUNK_BYTES = 1 << 12, 1 << 18
LONGEST_ELEMENT, MOST_MEMBERS = 1 << 23, 100
_BETWEEN = " \t\r\n,:"
_JSON = json.JSONDecoder()
_BESIDE = {
    "the NC blocks": {"HFProbeCounter", "GCode"},
    "the list of signals": {"SignalName", "Address"},
}


class CycleClock:
    """Time of each sample, from 0 at the first one; gaps and restarts are counted.

    A count that falls is the recorder begun anew: a new run, a second after the one before. A count
    that stays is the same sample again, and is handed on as it is.

    Attributes:
        period_s: of the count.
        restarts, gaps: how often the count has begun anew, and has left out samples.
        lost: samples that it has left out.
    """

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s
        self.restarts = self.gaps = self._rows = 0
        self.lost = self._at = 0.0  # counts since the first, a gap before each new run among them
        self._restart_rows: list[int] = []
        self._usual: float | None = None
        self._last: float | None = None

    @property
    def step_s(self) -> float | None:
        """Usual time from one sample to the next; None before two have come."""
        return None if self._usual is None else self._usual * self.period_s

    def times(self, cycle: Floats) -> tuple[Floats, Floats]:
        """Times in s and number of the run of each sample, (n,); NaN where there is no count."""
        rows = np.flatnonzero(np.isfinite(cycle))
        time_s, run = np.full(cycle.shape, np.nan), np.full(cycle.shape, float(self.restarts))
        counts = cycle[rows]
        if len(counts):
            first = float(counts[0]) if self._last is None else self._last
            steps = np.diff(counts, prepend=first)
            forward = steps[steps > 0.0]
            if self._usual is None and len(forward):
                self._usual = float(np.median(forward))
            if self._usual is not None:
                wide = steps[steps > WIDE * self._usual]
                self.gaps += len(wide)
                self.lost += float(np.sum(wide / self._usual - 1.0))
            fallen = steps < 0.0
            steps[fallen] = RESTART_GAP_S / self.period_s
            at = np.cumsum(np.append(self._at, steps))[1:]  # one sum, however a recording is parted
            time_s[rows], run[rows] = at * self.period_s, self.restarts + np.cumsum(fallen)
            self._restart_rows += (self._rows + rows[fallen]).tolist()
            self.restarts += int(np.count_nonzero(fallen))
            self._at, self._last = float(at[-1]), float(counts[-1])
        self._rows += len(cycle)
        return time_s, run

    def remarks(self) -> list[str]:
        """One line each on the period, on gaps and on restarts."""
        step = self._usual or 1.0
        every = "" if step == 1.0 else f", every {step:g}. one recorded"
        lines = [f"time_s = {self.period_s:g} s * CYCLE{every}"]
        if self.gaps:
            lines.append(f"CYCLE: {self.gaps} gaps, {self.lost:.0f} samples missing")
        if self.restarts:
            shown = ", ".join(str(row) for row in self._restart_rows[:5])
            more = ", ..." if self.restarts > 5 else ""
            lines.append(
                f"CYCLE starts over {self.restarts} times (at row {shown}{more}): each is a new "
                f"run, {RESTART_GAP_S:g} s after the one before"
            )
        return lines


@dataclass(slots=True)
class EdgeContext:
    """Context beside the samples; tool and block may still come while the samples are read."""

    period_s: float | None = None  # of the count; None where nothing says it
    axis_names: dict[int, str] = field(default_factory=dict)  # number of an axis -> its name
    # of each run, counts and [tool, next tool, place, block] from them on, in order
    events: list[tuple[list[float], list[list[float]]]] = field(default_factory=lambda: [([], [])])
    event_count: int = 0  # of all runs
    has_events: bool = False  # whether there may be some
    remarks: list[str] = field(default_factory=list)  # one line each

    def name_axis(self, address: str, name: str) -> None:
        number = address.rpartition("|")[2]
        if name.strip() and number.isdecimal() and len(self.axis_names) < _MOST_AXES:
            self.axis_names.setdefault(int(number), name.strip()[:20])

    def add_event(self, event: Mapping[str, Any]) -> None:
        """Keep an event; one without a count says nothing, one that falls begins the next run."""
        counter = next((number_of(event[name]) for name in _COUNTERS if name in event), math.nan)
        if not math.isfinite(counter) or self.event_count >= MOST_EVENTS:
            return
        if self.events[-1][0] and counter < self.events[-1][0][-1]:
            self.events.append(([], []))
        block = str(event.get(_GCODE) or "").strip()
        # CRC-32 of the text: a number that equal blocks share, whatever the day
        number = float(zlib.crc32(block.encode())) if block else math.nan
        self.events[-1][0].append(counter)
        self.events[-1][1].append([*(number_of(event.get(name)) for name in _NUMBERS), number])
        self.event_count += 1

    def events_at(self, cycle: Floats, run: Floats) -> dict[str, Floats]:
        """Columns of the events in force; NaN before the first, shape (n,) each.

        Args:
            cycle: count of each sample, (n,).
            run: how often the count has begun anew before it, (n,).
        """
        values = np.full((len(cycle), len(EVENT_COLUMNS)), np.nan)
        for number in np.unique(run).astype(int):
            counters, found = self.events[min(number, len(self.events) - 1)]
            newest = np.searchsorted(counters, cycle, side="right") - 1
            here = (run == number) & (newest >= 0) & np.isfinite(cycle)
            if here.any():
                values[here] = np.array(found)[newest[here]]
        return dict(zip(EVENT_COLUMNS, values.T, strict=True))


def _context_beside(path: Path) -> EdgeContext:
    """Content of the files beside a `hfdata.csv`; what cannot be read is a remark."""
    context = EdgeContext()
    place = path.name.lower().rfind("hfdata")
    for kind, read in (("header", _read_header), ("hfblockevent", _read_events)):
        beside = path.with_name(path.name[:place] + kind + path.name[place + len("hfdata") :])
        if place < 0 or not beside.is_file():
            continue
        try:
            with beside.open(encoding="utf-8-sig", errors="replace", newline="") as file:
                read(file, context)
        except (OSError, ValueError, csv.Error) as error:
            why = " ".join(str(error).split())[:80]
            context.remarks.append(f"{beside.name}: not used ({why})")
            continue
        if context.has_events:
            context.remarks.append(f"{beside.name}: {context.event_count} blocks of the NC program")
    return context


def _read_header(file: TextIO, context: EdgeContext) -> None:
    for row in csv.DictReader(file.read(_LONGEST_HEADER).splitlines()):
        context.name_axis(row.get("Address") or "", row.get("Axis") or "")


def _read_events(file: TextIO, context: EdgeContext) -> None:
    if os.fstat(file.fileno()).st_size > _LARGEST_FILE:
        raise ValueError(f"more than {_LARGEST_FILE >> 20} MB")
    delimiter = ";" if ";" in file.readline(_LONGEST_HEADER).split(_GCODE)[0] else ","
    file.seek(0)
    reader = csv.DictReader(file, delimiter=delimiter)
    if not set(_COUNTERS) & set(reader.fieldnames or ()):
        raise ValueError(f"no column {_COUNTERS[0]}")
    events = EdgeContext()
    for row in reader:
        events.add_event(row)
    context.events, context.event_count = events.events, events.event_count
    context.has_events = True


class EdgeRows:
    """The signals of one `Header`. A row without a number for each is set aside and counted.

    Args:
        header: as JSON gives it.
        first: the first rows; they show whether the count stands before the listed signals.
        context: gets the period and the names of the axes.

    Raises ValueError: one line; a header without signals.
    """

    def __init__(self, header: Any, first: Sequence[Any], context: EdgeContext) -> None:
        listed = header.get("SignalListHFData") if isinstance(header, dict) else None
        signals = [each for each in listed or () if isinstance(each, dict)]
        if not signals or len(signals) > MOST_COLUMNS:
            raise ValueError("no SignalListHFData with signals in its Header")
        names = [str(each.get("Address") or each.get("Name") or "") for each in signals]
        for name, each in zip(names, signals, strict=True):
            context.name_axis(name, str(each.get("Axis") or ""))
        period_s = number_of(header.get("CycleTimeMs")) / 1e3
        context.period_s = period_s if SHORTEST_S <= period_s <= LONGEST_S else None
        width = len(first[0]) if first and isinstance(first[0], list) else 0
        if width == len(names) + 1 and EDGE_CYCLE not in names:
            names.insert(0, EDGE_CYCLE)  # each row begins with its count, listed or not
        self.names = tuple(names)
        self.ragged_rows = 0
        self._text: dict[str, Text] = {}

    def numbers(self, rows: Sequence[Any]) -> tuple[Floats, Booleans]:
        """Numbers of the rows that are whole, (m, signals), and which those are, (n,)."""
        width = len(self.names)
        whole = np.array([isinstance(row, list) and len(row) == width for row in rows], dtype=bool)
        self.ragged_rows += int(np.count_nonzero(~whole))
        kept = [row for row, each in zip(rows, whole, strict=True) if each]
        try:
            samples = np.array(kept, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            samples = np.empty(0)
        if samples.shape != (len(kept), width):
            cells = [list(map(self._cell, self.names, row)) for row in kept]
            samples = np.array(cells, dtype=np.float64).reshape(-1, width)
        return samples, whole

    def take_text(self) -> dict[str, Text]:
        """Texts that stood in place of numbers since the last call, by signal."""
        text, self._text = self._text, {}
        return text

    def _cell(self, name: str, value: Any) -> float:
        with suppress(TypeError, ValueError, OverflowError):
            return math.nan if value is None else float(value)
        self._text[name] = self._text.get(name, NO_TEXT) + Text(1, {str(value)[:40]: 1})
        return math.nan


class JsonText:
    """Values of a JSON text one by one, in bounded memory."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = codecs.getreader("utf-8-sig")(file, "replace")
        self._text, self._position, self._passed = "", 0, 0

    def elements(self, name: str, members: dict[str, Any]) -> Iterator[Any]:
        """Elements of the list `name` of the outermost object; `members` takes those before it.

        Raises ValueError, one line, for JSON that is cut off or damaged, or another than expected.
        """
        self._position += self._peek() == "{"
        while self._peek() != "}" and len(members) <= MOST_MEMBERS:
            key = self._value()
            if key == name and self._peek() == "[":
                break
            members[str(key)] = self._value()
        else:
            raise ValueError(f"no list {name!r}")
        self._position += 1
        while self._peek() != "]":
            yield self._value()

    def _peek(self) -> str:
        """The next character that is not between two values; empty at the end."""
        while self._position < len(self._text) or self._more():
            if self._text[self._position] not in _BETWEEN:
                return self._text[self._position]
            self._position += 1
        return ""

    def _value(self) -> Any:
        self._peek()
        while True:
            try:
                value, end = _JSON.raw_decode(self._text, self._position)
            except RecursionError:
                raise ValueError("its values are nested too deeply") from None
            except ValueError as error:
                if not self._more():
                    place = f"behind character {self._passed + self._position}"
                    reason = f"cut off or damaged {place} ({str(error)[:60]})"
                    raise ValueError(reason) from None
            else:
                if end < len(self._text) or not self._more():  # a number may go on
                    self._position = end
                    return value

    def _more(self) -> bool:
        """Read on; False at the end of the file."""
        rest = self._text[self._position :]
        if len(rest) > LONGEST_ELEMENT:
            raise ValueError(f"an element of more than {LONGEST_ELEMENT} characters")
        text = self._file.read(max(len(rest), CHUNK_BYTES))
        if text:
            self._passed += self._position
            self._text, self._position = rest + text, 0
        return bool(text)


class EdgeJsonSource(Source):
    """An open JSON. A row without a number for each signal is set aside and counted."""

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        super().__init__(path, file)
        self.context = EdgeContext(has_events=True)
        self._waiting: list[Any] = []
        members: dict[str, Any] = {}
        self._messages = JsonText(file).elements(PAYLOAD, members)
        self._fill(1)
        try:
            self._rows = EdgeRows(members.get(HEADER), self._waiting, self.context)
        except ValueError as error:
            raise TraceError(f"{path}: {error}") from None
        self.names = self._rows.names

    def read_block(self) -> Block | None:
        self._fill(BLOCK_ROWS)
        if not self._waiting:
            return None
        rows, self._waiting = self._waiting, []
        samples, kept = self._rows.numbers(rows)
        self.ragged_rows = self._rows.ragged_rows
        number = self._number_rows(len(rows))[kept]
        values = {name: samples[:, self.names.index(name)] for name in self.wanted}
        text = self._rows.take_text()
        return Block(values, number, {name: text[name] for name in self.wanted if name in text})

    def _fill(self, rows: int) -> None:
        """Read messages until so many rows wait, or all have been read."""
        try:
            for message in self._messages:
                found = message if isinstance(message, dict) else {}
                samples, event = found.get(SAMPLES), found.get(EVENT)
                if isinstance(samples, list):
                    self._waiting += samples
                if isinstance(event, dict):
                    self.context.add_event(event)
                if len(self._waiting) >= rows:
                    return
        except ValueError as error:
            why = f"{error}; {self._rows_seen} samples were read"
            raise TraceError(f"{self.path}: {why}") from None


class EdgeSource(Source):
    """The same rows with `time_s`, and with tool and block where events are known."""

    def __init__(
        self, inner: Source, context: EdgeContext, period_s: float | None, *, sets_time: bool
    ) -> None:
        self.path, self.ragged_rows, self.wanted, self.below = inner.path, 0, [], []
        self.context = context
        self.sets_time = sets_time
        self._inner = inner
        told_s = period_s or context.period_s
        self.clock = CycleClock(told_s or PERIOD_S)
        self._guessed = "" if told_s else "; the usual period of Industrial Edge: no header says it"
        self._counted = EDGE_CYCLE in inner.names
        self._own = ((TIME,) if sets_time else ()) + EVENT_COLUMNS
        time = (TIME,) if sets_time and TIME not in inner.names else ()
        events = EVENT_COLUMNS if self._counted and context.has_events else ()
        self.names = (*time, *inner.names, *events)

    @property
    def fraction_read(self) -> float:
        return self._inner.fraction_read

    @property
    def remarks(self) -> tuple[str, ...]:
        time: list[str] = []
        if self.sets_time and TIME in self.wanted and self._counted:
            first, *more = self.clock.remarks()
            time = [first + self._guessed, *more]
        elif self.sets_time and TIME in self.wanted:
            period_s = self.clock.period_s
            time = [f"no CYCLE and no time: rows are taken as {period_s:g} s apart{self._guessed}"]
        return (*self._inner.remarks, *time, *self.context.remarks)

    def holds_numbers(self, name: str) -> bool:
        return name not in self._inner.names or self._inner.holds_numbers(name)

    def want(self, names: list[str]) -> None:
        self.wanted = names
        inner = [name for name in names if name in self._inner.names]
        if self._counted and set(names) & set(self._own) and EDGE_CYCLE not in inner:
            inner.append(EDGE_CYCLE)
        self._inner.want(inner)

    def read_block(self) -> Block | None:
        block = self._inner.read_block()
        self.ragged_rows = self._inner.ragged_rows
        derived = set(self.wanted) & set(self._own)
        if block is None or not derived:
            return block
        values = {TIME: block.row_number * self.clock.period_s}
        if self._counted:
            cycle = np.asarray(block.values[EDGE_CYCLE], dtype=np.float64)
            time_s, run = self.clock.times(cycle)
            values = {TIME: time_s} | self.context.events_at(cycle, run)
        kept = {name: values[name] for name in derived}
        return Block(block.values | kept, block.row_number, block.text)

    def close(self) -> None:
        self._inner.close()


def edge_recording(path: Path, source: Source, columns: Mapping[str, ColumnMap]) -> Source:
    """The source with what Industrial Edge means by its columns; any other as it is.

    The time is the file's or the machine file's where they have one, and that of the count if not.
    A scale of `CYCLE` in the machine file is the period.

    Raises TraceError: it is one of the files beside a recording.
    """
    if isinstance(source, EdgeSource):
        return source
    for what, columns_of_it in _BESIDE.items():
        if columns_of_it <= set(source.names):
            raise TraceError(
                f"{path}: holds {what} of a recording of Industrial Edge; expected its "
                "..._hfdata.csv, which is read together with it"
            )
    if not edge_signals(source.names):
        return source
    mapped = columns.get(TIME)
    by_count = mapped is not None and mapped.column == EDGE_CYCLE
    period_s = mapped.scale if mapped is not None and by_count else None
    sets_time = by_count or (mapped is None and TIME not in source.names)
    context: EdgeContext | None = getattr(source, "context", None)
    return EdgeSource(source, context or _context_beside(path), period_s, sets_time=sets_time)


def is_edge_json(head: bytes, _path: Path) -> bool:
    """Return whether a file begins as the JSON of such a recording."""
    start = head.removeprefix(BYTE_ORDER_MARK).lstrip()
    return start.startswith(b"{") and (b'"SignalListHFData"' in head or b'"HFData"' in head)
