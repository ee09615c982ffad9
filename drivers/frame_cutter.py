"""Recorded rows as frames of about equal axis time."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from edge_service.messages.samples import SampleFrame

LARGEST_FRAME = 4096
"""Rows of a frame, where the recorded clock stands still."""
LOOK_AHEAD_S = 0.0045
"""So long after a multiple of its length a frame ends: the direction of motion at the end of an
interval is a difference over 4 ms to either side, and so no interval waits for another frame.
"""


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
