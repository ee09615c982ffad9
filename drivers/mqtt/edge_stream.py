"""Live blocks of Industrial Edge's capture: the rows that a recording of it would hold."""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from edge_service.messages.channels import TIME
from edge_service.messages.quality import Quality
from edge_service.messages.samples import Floats, SampleFrame
from edge_service.recordings.columns import AxisError, ColumnLike, TraceError
from edge_service.recordings.reader import TraceReader, read_source
from edge_service.recordings.sinumerik.edge import (
    HEADER,
    PAYLOAD,
    RESTART_GAP_S,
    SAMPLES,
    WIDE,
    EdgeRows,
    EdgeSource,
    edge_recording,
)
from edge_service.recordings.sinumerik.edge_context import EdgeContext
from edge_service.recordings.sinumerik.signals import EDGE_CYCLE, ControllerAxis
from edge_service.recordings.source import Block, Source

from ..base import DriverMisconfiguredError, DriverUnavailableError
from .order import Order
from .payload import MessageError

LARGEST_COUNT = 2.0**53
"""Beyond it neighbouring counts are the same double."""


class LiveRows(Source):
    """Rows as they come, one block at a time, where a file would be."""

    def __init__(self, path: Path, rows: EdgeRows, context: EdgeContext) -> None:
        super().__init__(path, io.BytesIO())
        self.names, self.context = rows.names, context
        self._rows = rows
        self._block: Block | None = None

    def put(self, samples: Floats) -> None:
        """Take rows, (n, signals), to be read next."""
        values = {name: samples[:, self.names.index(name)] for name in self.wanted}
        self._block = Block(values, np.arange(float(len(samples))), self._rows.take_text())

    def read_block(self) -> Block | None:
        """The rows that were put in, once."""
        self.ragged_rows = self._rows.ragged_rows
        block, self._block = self._block, None
        return block


class _Capture:
    """Rows, clock and reader of the run that one `Header` has begun."""

    def __init__(
        self,
        path: Path,
        header: Any,
        first: list[Any],
        columns: Mapping[str, ColumnLike],
        axis: ControllerAxis,
    ) -> None:
        context = EdgeContext()
        try:
            self.rows = EdgeRows(header, first, context)
        except ValueError as error:
            raise TraceError(f"{path}: {error}") from None
        if EDGE_CYCLE not in self.rows.names:
            raise TraceError(f"{path}: no {EDGE_CYCLE}, and nothing else tells what was lost")
        self.live = LiveRows(path, self.rows, context)
        source = edge_recording(path, self.live, columns)
        if not isinstance(source, EdgeSource):
            raise TraceError(f"{path}: no signal is known by its name, such as TORQUE|1")
        self.clock = source.clock
        self.reader: TraceReader = read_source(path, source, columns, axis)


class EdgeStream:
    """Frames of one axis out of messages with `Header`, `Payload` and `HFData`.

    The count tells what is lost, repeated or late; the sample after a gap is marked. A new `Header`
    is a new run, a second after the one before.

    Args:
        path: of the source, for messages.
        columns: of the machine file.
        axis: which of several axes, and what its units need.
    """

    def __init__(self, path: Path, columns: Mapping[str, ColumnLike], axis: ControllerAxis) -> None:
        self._path, self._axis = path, axis
        self._columns = {
            name: column
            for name, column in columns.items()
            if name != TIME or column.column == EDGE_CYCLE
        }
        self._order = Order()
        self._header: Any = None
        self._capture: _Capture | None = None
        self._ended = {"lost_samples": 0, "gaps": 0, "ragged_rows": 0, "restarts": 0}
        self._shift_s, self._newest_s = 0.0, -np.inf
        self._delivered = 0
        self.channels: tuple[str, ...] = ()
        """Channels of the axis; none before a message said them."""

    @property
    def counters(self) -> dict[str, int]:
        """Samples lost, repeated and late, gaps, restarts of the count, and rows set aside."""
        repeated = {"repeated_samples": self._order.repeated, "late_samples": self._order.late}
        return self._sums() | repeated

    @property
    def readings(self) -> dict[str, float]:
        """Time from one sample to the next, and percent of the samples that were lost."""
        lost = self._sums()["lost_samples"]
        told = {"lost_percent": 100.0 * lost / (lost + self._delivered)} if self._delivered else {}
        step_s = None if self._capture is None else self._capture.clock.step_s
        return told if step_s is None else told | {"sample_s": step_s}

    def frames(self, message: dict[str, Any]) -> list[SampleFrame]:
        """Frames of a message.

        Raises:
            MessageError: it says nothing that can be read.
            DriverMisconfiguredError: its signals cannot be read as they are configured.
            DriverUnavailableError: it has other channels than those before.
        """
        header = message.get(HEADER)
        payload = message.get(PAYLOAD, message)
        parts = payload if isinstance(payload, list) else [payload]
        blocks = [each[SAMPLES] for each in parts if isinstance(each, dict) and SAMPLES in each]
        if not all(isinstance(block, list) for block in blocks):
            raise MessageError(f"{SAMPLES} that is no list of rows")
        if header is not None and _signals(header) != _signals(self._header):
            self._header = header
            self._end_capture()
        rows = [row for block in blocks for row in block]
        if not rows:
            return []
        if self._header is None:
            raise MessageError(f"{SAMPLES} before a {HEADER} that names its signals")
        capture = self._capture or self._begin(rows)
        frame = self._read(capture, rows)
        return [] if frame is None else [frame]

    def _begin(self, rows: list[Any]) -> _Capture:
        header, self._header = self._header, None
        try:
            capture = _Capture(self._path, header, rows, self._columns, self._axis)
        except TraceError as error:
            if isinstance(error, AxisError) and not self._delivered:
                raise DriverMisconfiguredError("axis_number", str(error)) from None
            raise MessageError(str(error)) from None
        self._header, self._capture = header, capture
        if self._delivered:
            self._shift_s = self._newest_s + RESTART_GAP_S
        before, self.channels = self.channels, capture.reader.channels
        if before and before != self.channels:
            raise DriverUnavailableError(f"{self._path}: the capture has other channels now")
        return capture

    def _read(self, capture: _Capture, rows: list[Any]) -> SampleFrame | None:
        samples, _ = capture.rows.numbers(rows)
        counts = samples[:, capture.rows.names.index(EDGE_CYCLE)]
        counts[~(np.abs(counts) < LARGEST_COUNT)] = np.nan
        kept = self._order.keep(counts, samples)
        if not kept.any():
            return None
        capture.live.put(samples[kept])
        try:
            frame = next(capture.reader, None)
        except TraceError as error:
            raise MessageError(str(error)) from None
        return None if frame is None else self._judged(capture, frame)

    def _judged(self, capture: _Capture, frame: SampleFrame) -> SampleFrame:
        """The frame on the clock of all runs, with the quality of each sample."""
        time_s = frame.time_s + self._shift_s
        steps_s = np.diff(time_s, prepend=self._newest_s if self._delivered else time_s[0])
        after_gap = steps_s > WIDE * (capture.clock.step_s or np.inf)
        quality = {}
        for name, values in frame.channels.items():
            codes = np.where(after_gap, Quality.OVERFLOW, Quality.GOOD).astype(np.uint8)
            codes[np.isnan(values)] = Quality.NOT_A_NUMBER
            quality[name] = codes
        self._newest_s = float(time_s[-1])
        self._delivered += len(frame)
        return SampleFrame(time_s, frame.channels, quality)

    def _sums(self) -> dict[str, int]:
        """Counts of all captures; the order sees a restart before their clocks do."""
        sums = dict(self._ended)
        if self._capture is not None:
            sums["lost_samples"] += round(self._capture.clock.lost)
            sums["gaps"] += self._capture.clock.gaps
            sums["ragged_rows"] += self._capture.rows.ragged_rows
            sums["restarts"] += self._capture.clock.restarts
        return sums

    def _end_capture(self) -> None:
        self._ended, self._capture = self._sums(), None
        self._order.forget()


def _signals(header: Any) -> Any:
    """Members of a header that say how rows are to be read; others may change at will."""
    if not isinstance(header, dict):
        return header
    return header.get("SignalListHFData"), header.get("CycleTimeMs")
