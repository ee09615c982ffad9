"""Rows as sample frames: put together one by one, or cut out of a recording."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np

from edge_service.messages.samples import Quality, SampleFrame
from edge_service.recordings.reader import joined

FRAME_S = 0.1
"""Axis time of a frame."""
GREATEST_LAG_S = 1.0
"""Further behind real time than this, a driver lets the missed time go instead of bursting."""
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

    def count(self, frame: SampleFrame) -> SampleFrame:
        """Count the cells of a frame; returns it."""
        for codes in frame.quality.values():
            for code, count in zip(*np.unique(codes, return_counts=True), strict=True):
                if code != Quality.GOOD:
                    name = f"{Quality(code).level}_{Quality(code).name.lower()}"
                    self.counts[name] = self.counts.get(name, 0) + int(count)
        return frame


class FrameCutter:
    """Cuts runs of rows where axis time, less `LOOK_AHEAD_S`, passes a multiple of `frame_s`."""

    def __init__(self, frame_s: float) -> None:
        self._frame_s = frame_s
        self.rest: SampleFrame | None = None
        """Rows kept at the end."""

    def cut(self, block: SampleFrame) -> Iterator[SampleFrame]:
        """Whole frames; the last, perhaps unfinished one is kept for the next rows."""
        rows = block if self.rest is None else joined([self.rest, block])
        with np.errstate(over="ignore", invalid="ignore"):
            number = np.floor((rows.time_s - LOOK_AHEAD_S) / self._frame_s)
        edges = [0, *(np.flatnonzero(number[1:] != number[:-1]) + 1).tolist(), len(rows)]
        for start, end in pairwise(edges):
            cuts = range(start, end, LARGEST_FRAME)
            for cut in cuts[:-1] if end == len(rows) else cuts:
                yield rows.part(slice(cut, min(cut + LARGEST_FRAME, end)))
        self.rest = rows.part(slice(cuts[-1], None))


class Pace:
    """Schedule of what is played, against one fixed start, so that nothing drifts.

    The speed is axis time over real time, 0 as fast as possible; the clock shows real time, s.
        clock: real time, s.
    """

    def __init__(self, speed: float, clock: Callable[[], float]) -> None:
        self._speed, self._clock = speed, clock
        self._start_s, self._played_s = clock(), 0.0

    def wait_s(self, step_s: float) -> float:
        """Real time to wait until a further `step_s` of axis time is due."""
        if self._speed == 0.0:
            return 0.0
        self._played_s += step_s
        wait_s = self._start_s + self._played_s / self._speed - self._clock()
        if wait_s < -GREATEST_LAG_S:
            self._start_s -= wait_s
        return max(wait_s, 0.0)
