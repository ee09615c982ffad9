"""JSON of Industrial Edge's capture as rows of samples, and the order of samples of any JSON."""

import io
import json
import math
import time
from collections import Counter, OrderedDict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from edge_service.messages.samples import TIME, Booleans, ColumnMap, Floats, Quality, SampleFrame
from edge_service.recordings.columns import AxisError, TraceError
from edge_service.recordings.reader import read_source
from edge_service.recordings.sinumerik.edge import (
    HEADER,
    PAYLOAD,
    RESTART_GAP_S,
    SAMPLES,
    WIDE,
    EdgeContext,
    EdgeRows,
    EdgeSource,
    edge_recording,
)
from edge_service.recordings.sinumerik.signals import EDGE_CYCLE, ControllerAxis
from edge_service.recordings.source import Block, Source

from ..base import DriverMisconfiguredError, DriverUnavailableError

LARGEST_COUNT = 2.0**53
"""Beyond it neighbouring counts are the same double."""
LARGEST_BYTES = 4_000_000  # of a message
MEMORY = 1 << 15
"""Samples that are remembered: a minute at 500 Hz."""
MOST_LATE, LATE_S = 500, 0.8
"""Late ones in a row, and real time with nothing else, s: then the newest key was wrong."""
SETTLES_S, LONGEST_WAIT_S = 2.0, 0.1
"""Time in which a lag is forgotten, and the longest part of it that one message may add, s."""


class MessageError(Exception):
    """A message that is skipped, and counted by `counter`; the text is a part of a line."""

    counter = "malformed_messages"


class Lateness:
    """By how much samples come later than the promptest of their run: kept somewhere meanwhile.

    A source that is as late for longer has only another clock.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._run, self._heard_s, self._prompt_s = -1, 0.0, 0.0

    def lag_s(self, time_s: float, run: int) -> float:
        """Lag of a sample of a time, s, in the run of that number."""
        now_s = self._clock()
        late_s, waited_s = now_s - time_s, now_s - self._heard_s
        if run != self._run:
            self._run, self._prompt_s = run, late_s
        share = min(waited_s, LONGEST_WAIT_S) / SETTLES_S
        self._prompt_s += share * (late_s - self._prompt_s)
        self._prompt_s, self._heard_s = min(self._prompt_s, late_s), now_s
        return late_s - self._prompt_s


def decode_object(payload: Any) -> dict[str, Any]:
    """The object that a payload holds. Raises MessageError."""
    if len(payload or b"") > LARGEST_BYTES:
        raise MessageError(f"more than {LARGEST_BYTES} bytes")
    try:
        content = json.loads(payload)
    except (ValueError, TypeError, RecursionError) as error:
        raise MessageError(f"no JSON ({str(error)[:60]})") from None
    if not isinstance(content, dict):
        raise MessageError(f"JSON that is no object but a {type(content).__name__}")
    return content


class Order:
    """Keeps a sample that is new, or the first of a new run; drops one that is neither.

    A key that is known, with the same values, comes again. An unknown one between known ones comes
    late, and its place has been passed; so does every other time that does not rise. A count begins
    a new run then. Where nothing else comes any more, and the late ones rise, they are a new run.

    Args:
        are_times: the keys are no counts but times.
        clock: real time, s.

    Attributes:
        counts: samples repeated and late, and restarts.
    """

    def __init__(
        self, *, are_times: bool = False, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.counts = {"repeated_samples": 0, "late_samples": 0, "restarts": 0}
        self._are_times, self._clock = are_times, clock
        self._known: OrderedDict[float, int] = OrderedDict()
        self._newest = -math.inf
        self._late_in_a_row = 0
        self._first_late = self._late_since_s = 0.0

    def keep(self, keys: Floats, rows: Floats) -> Booleans:
        """Mask of the samples to keep, (n,).

        Args:
            keys: count or time, (n,); a sample without one is kept, and judged by its reader.
            rows: the values, (n, m).
        """
        pairs = zip(keys.tolist(), rows, strict=True)
        return np.array([math.isnan(k) or self._is_wanted(k, hash(r.tobytes())) for k, r in pairs])

    def forget(self) -> None:
        """Begin anew: what comes next belongs to another run."""
        self._known.clear()
        self._newest = -math.inf

    def _is_wanted(self, key: float, content: int) -> bool:
        if key <= self._newest:
            known = self._known.get(key)
            if known == content:
                self.counts["repeated_samples"] += 1
                return False
            passed = known is None and key > next(iter(self._known))
            if (passed or self._are_times) and not self._is_new_run(key):
                self.counts["late_samples"] += 1
                return False
            self.counts["restarts"] += 1
            self._known.clear()
        self._late_in_a_row = 0
        self._newest = key
        self._known[key] = content
        if len(self._known) > MEMORY:
            self._known.popitem(last=False)
        return True

    def _is_new_run(self, key: float) -> bool:
        """Return whether so many came late, or for so long, that the newest key was wrong."""
        if not self._late_in_a_row:
            self._first_late, self._late_since_s = key, self._clock()
        self._late_in_a_row += 1
        if not self._are_times and self._late_in_a_row > MOST_LATE:
            return True
        return key > self._first_late and self._clock() - self._late_since_s >= LATE_S


class LiveRows(Source):
    """Rows of the run that one `Header` has begun, as they come, where a file would be.

    Attributes:
        rows, clock, reader: of the run.

    Raises TraceError: a header, or first rows, that cannot be read.
    """

    def __init__(
        self,
        path: Path,
        header: Any,
        first: list[Any],
        columns: Mapping[str, ColumnMap],
        axis: ControllerAxis,
    ) -> None:
        super().__init__(path, io.BytesIO())
        self.context = EdgeContext()
        try:
            self.rows = EdgeRows(header, first, self.context)
        except ValueError as error:
            raise TraceError(f"{path}: {error}") from None
        self.names = self.rows.names
        if EDGE_CYCLE not in self.names:
            raise TraceError(f"{path}: no {EDGE_CYCLE}, and nothing else tells what was lost")
        self._block: Block | None = None
        source = edge_recording(path, self, columns)
        if not isinstance(source, EdgeSource):
            raise TraceError(f"{path}: no signal is known by its name, such as TORQUE|1")
        self.clock = source.clock
        self.reader = read_source(path, source, columns, axis)

    def read(self, samples: Floats) -> SampleFrame | None:
        """Frame of further rows, (n, signals). Raises TraceError."""
        values = {name: samples[:, self.names.index(name)] for name in self.wanted}
        self._block = Block(values, np.arange(float(len(samples))), self.rows.take_text())
        return next(self.reader, None)

    def read_block(self) -> Block | None:
        """The rows that were put in, once."""
        self.ragged_rows = self.rows.ragged_rows
        block, self._block = self._block, None
        return block


class EdgeStream:
    """Frames of one axis out of messages with `Header`, `Payload` and `HFData`.

    The count tells what is lost, repeated or late; the sample after a gap is marked. A new `Header`
    is a new run, a second after the one before.

    Attributes:
        channels: of the axis; none before a message said them.
    """

    def __init__(self, path: Path, columns: Mapping[str, ColumnMap], axis: ControllerAxis) -> None:
        self._path, self._axis = path, axis
        self._columns = {
            name: column
            for name, column in columns.items()
            if name != TIME or column.column == EDGE_CYCLE
        }
        self._order = Order()
        self._header: Any = None
        self._live: LiveRows | None = None
        self._ended = Counter[str](lost_samples=0, gaps=0, ragged_rows=0, restarts=0)
        self._shift_s, self._newest_s = 0.0, -np.inf
        self._delivered = 0
        self.channels: tuple[str, ...] = ()

    @property
    def counters(self) -> dict[str, int]:
        return self._order.counts | self._sums()

    @property
    def readings(self) -> dict[str, float]:
        """Time from one sample to the next, and percent of the samples that were lost."""
        lost = self._sums()["lost_samples"]
        told = {"lost_percent": 100.0 * lost / (lost + self._delivered)} if self._delivered else {}
        step_s = None if self._live is None else self._live.clock.step_s
        return told if step_s is None else told | {"sample_s": step_s}

    def frames(self, message: dict[str, Any]) -> list[SampleFrame]:
        """Frames of a message.

        Raises MessageError: it says nothing that can be read; DriverMisconfiguredError: its signals
        cannot be read as they are configured; DriverUnavailableError: it has other channels than
        those before.
        """
        header = message.get(HEADER)
        payload = message.get(PAYLOAD, message)
        parts = payload if isinstance(payload, list) else [payload]
        blocks = [each[SAMPLES] for each in parts if isinstance(each, dict) and SAMPLES in each]
        if not all(isinstance(block, list) for block in blocks):
            raise MessageError(f"{SAMPLES} that is no list of rows")
        if header is not None and _signals(header) != _signals(self._header):
            self._ended, self._live, self._header = self._sums(), None, header
            self._ended["restarts"] += self._delivered > 0
            self._order.forget()
        rows = [row for block in blocks for row in block]
        if not rows:
            return []
        try:
            live = self._live or self._begin(rows)
            samples, _ = live.rows.numbers(rows)
            counts = samples[:, live.names.index(EDGE_CYCLE)]
            counts[~(np.abs(counts) < LARGEST_COUNT)] = np.nan
            kept = self._order.keep(counts, samples)
            frame = live.read(samples[kept]) if kept.any() else None
        except TraceError as error:
            raise MessageError(str(error)) from None
        return [] if frame is None else [self._judged(live, frame)]

    def _begin(self, rows: list[Any]) -> LiveRows:
        header, self._header = self._header, None
        if header is None:
            raise MessageError(f"{SAMPLES} before a {HEADER} that names its signals")
        try:
            live = LiveRows(self._path, header, rows, self._columns, self._axis)
        except AxisError as error:
            if not self._delivered:
                raise DriverMisconfiguredError("topic", str(error)) from None
            raise
        self._header, self._live = header, live
        if self._delivered:
            self._shift_s = self._newest_s + RESTART_GAP_S
        before, self.channels = self.channels, live.reader.channels
        if before and before != self.channels:
            raise DriverUnavailableError(f"{self._path}: the capture has other channels now")
        return live

    def _judged(self, live: LiveRows, frame: SampleFrame) -> SampleFrame:
        """The frame on the clock of all runs, with the quality of each sample."""
        time_s = frame.time_s + self._shift_s
        steps_s = np.diff(time_s, prepend=self._newest_s if self._delivered else time_s[0])
        after_gap = steps_s > WIDE * (live.clock.step_s or np.inf)
        quality = {}
        for name, values in frame.channels.items():
            codes = np.where(after_gap, Quality.OVERFLOW, Quality.GOOD).astype(np.uint8)
            codes[np.isnan(values)] = Quality.NOT_A_NUMBER
            quality[name] = codes
        self._newest_s = float(time_s[-1])
        self._delivered += len(frame)
        return SampleFrame(time_s, frame.channels, quality)

    def _sums(self) -> Counter[str]:
        sums = self._ended.copy()
        if self._live is not None:
            clock, ragged_rows = self._live.clock, self._live.rows.ragged_rows
            sums.update(lost_samples=round(clock.lost), gaps=clock.gaps)
            sums.update(ragged_rows=ragged_rows, restarts=clock.restarts)
        return sums


def _signals(header: Any) -> Any:
    """Members of a header that say how rows are to be read; others may change at will."""
    if not isinstance(header, dict):
        return header
    return header.get("SignalListHFData"), header.get("CycleTimeMs")
