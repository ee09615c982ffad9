"""Rows as sample frames: put together one by one, or cut out of a recording."""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np

from edge_service.messages.quality import Quality
from edge_service.messages.samples import SampleFrame

LARGEST_FRAME = 4096
"""Rows of a frame, where the recorded clock stands still."""
LOOK_AHEAD_S = 0.0045
"""So long after a multiple of its length a frame ends: the direction of motion at the end of an
interval is a difference over 4 ms to either side, and so no interval waits for another frame.
"""
Values = Mapping[str, tuple[float, Quality]]
"""Channel -> value in SI units and its quality."""


class RowBlock:
    """Collects rows until they are taken as one frame; every frame holds every channel.

    What a row does not bring is NaN and no fault of its own: a slower signal has no new value.
    """

    def __init__(self, channels: Sequence[str]) -> None:
        self._channels = tuple(channels)
        self._times_s: list[float] = []
        self._rows: list[Values] = []

    def __len__(self) -> int:
        return len(self._times_s)

    @property
    def span_s(self) -> float:
        """Time from the first to the last row, s."""
        return self._times_s[-1] - self._times_s[0] if self._times_s else 0.0

    def add(self, time_s: float, values: Values) -> None:
        """Append a row; a bad value becomes NaN."""
        self._times_s.append(time_s)
        self._rows.append(values)

    def take(self) -> SampleFrame:
        """All rows as one frame; the block is empty afterwards."""
        times_s, rows = np.array(self._times_s), self._rows
        self._times_s, self._rows = [], []
        channels, quality = {}, {}
        for name in self._channels:
            cells = [row.get(name, (math.nan, Quality.GOOD)) for row in rows]
            codes = np.array([code for _, code in cells], dtype=np.uint8)
            values = np.array([value for value, _ in cells], dtype=np.float64)
            channels[name] = np.where(codes >= Quality.NO_VALUE, np.nan, values)
            if codes.any():
                quality[name] = codes
        return SampleFrame(times_s, channels, quality)


class QualityCounts:
    """Monotonic counts of samples that were not good, by reason."""

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}

    def count(self, values: Values) -> None:
        """Count the cells of one row."""
        for _, code in values.values():
            if code is not Quality.GOOD:
                name = f"{code.level}_{code.name.lower()}"
                self.counts[name] = self.counts.get(name, 0) + 1


class FrameCutter:
    """Cuts runs of rows where axis time, less `LOOK_AHEAD_S`, passes a multiple of `frame_s`."""

    def __init__(self, frame_s: float) -> None:
        self._frame_s = frame_s
        self._rest: SampleFrame | None = None

    def cut(self, block: SampleFrame) -> Iterator[SampleFrame]:
        """Whole frames; the last, perhaps unfinished one is kept for the next rows."""
        rows = block if self._rest is None else _join(self._rest, block)
        with np.errstate(over="ignore", invalid="ignore"):
            number = np.floor((rows.time_s - LOOK_AHEAD_S) / self._frame_s)
        edges = [0, *(np.flatnonzero(number[1:] != number[:-1]) + 1).tolist(), len(rows)]
        for start, end in pairwise(edges):
            cuts = range(start, end, LARGEST_FRAME)
            for cut in cuts[:-1] if end == len(rows) else cuts:
                yield _rows(rows, cut, min(cut + LARGEST_FRAME, end))
        self._rest = _rows(rows, cuts[-1], len(rows))

    def rest(self) -> SampleFrame | None:
        """The rows kept at the end."""
        return self._rest


def _rows(frame: SampleFrame, start: int, end: int) -> SampleFrame:
    channels = {name: values[start:end] for name, values in frame.channels.items()}
    return SampleFrame(frame.time_s[start:end], channels)


def _join(first: SampleFrame, second: SampleFrame) -> SampleFrame:
    channels = {
        name: np.concatenate([values, second.channels[name]])
        for name, values in first.channels.items()
    }
    return SampleFrame(np.concatenate([first.time_s, second.time_s]), channels)
