"""Rows as sample frames: put together, or cut out of a recording."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np

from edge_service.messages.samples import Quality, SampleFrame
from edge_service.recordings.reader import joined

FRAME_S = 0.1  # axis time of a frame
GREATEST_LAG_S = 1.0
"""Further behind real time than this, a driver lets the missed time go instead of bursting."""
LARGEST_FRAME = 4096
"""Rows of a frame, where the recorded clock stands still."""
LOOK_AHEAD_S = 0.0125
"""So long after a multiple of its length a frame ends: at 1 kHz an interval looks at 12 rows behind
it, for the direction of motion and for samples that no drive can make; none waits for a frame more.
"""
Values = Mapping[str, tuple[float, Quality]]
"""Channel -> value in SI units and its quality."""


def frame_of(rows: Sequence[tuple[float, Values]], names: Iterable[str]) -> SampleFrame:
    """One frame of rows, each a time in s and its values; a bad value becomes NaN.

    What a row does not bring is NaN and no fault of its own: a slower signal has no new value.
    """
    channels, quality = {}, {}
    for name in names:
        cells = [values.get(name, (math.nan, Quality.GOOD)) for _, values in rows]
        codes = np.array([code for _, code in cells], dtype=np.uint8)
        numbers = np.array([value for value, _ in cells], dtype=np.float64)
        channels[name] = np.where(codes >= Quality.NO_VALUE, np.nan, numbers)
        if codes.any():
            quality[name] = codes
    return SampleFrame(np.array([time_s for time_s, _ in rows]), channels, quality)


class QualityCounts:
    """Monotonic counts of samples that were not good, by reason."""

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}

    def count(self, frame: SampleFrame) -> SampleFrame:
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
