"""Recorded rows as frames of about equal axis time."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from edge_service.messages.samples import SampleFrame

LARGEST_FRAME = 4096
"""Rows of a frame, where the recorded clock stands still."""


_GRID_SLACK = 1e-4
"""Share of a frame by which a time stamp may miss the grid."""


class FrameCutter:
    """Cuts runs of rows after the row at which axis time reaches a multiple of `frame_s`.

    That row is the last of its frame: an interval ends with it, so that whoever reads intervals of
    the same grid need not wait for the next frame. Time that runs backwards begins a frame as well.
    """

    def __init__(self, frame_s: float) -> None:
        self._frame_s = frame_s
        self._rest: SampleFrame | None = None

    def cut(self, block: SampleFrame) -> Iterator[SampleFrame]:
        """Whole frames; the last, perhaps unfinished one is kept for the next rows."""
        rows = block if self._rest is None else _join(self._rest, block)
        with np.errstate(over="ignore", invalid="ignore"):
            number = np.ceil(rows.time_s / self._frame_s - _GRID_SLACK)
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
