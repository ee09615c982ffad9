"""Ring of the latest samples of one axis, for recordings of events. Pure."""

from collections import deque

import numpy as np

from ..messages.channels import MOTOR_SPEED, TABLE_SPEED
from ..messages.samples import Floats, SampleFrame

DERIVED = (MOTOR_SPEED, TABLE_SPEED)
"""Not kept: they follow from the positions."""


class SampleRing:
    """Ring of the last seconds of an axis.

    Args:
        keep_s: length, s.
        most_rows: never more than this, whatever the rate.
    """

    def __init__(self, keep_s: float, most_rows: int) -> None:
        self.keep_s = keep_s
        self._most_rows = most_rows
        self._pieces: deque[tuple[tuple[str, ...], Floats]] = deque()
        self._rows = 0

    @property
    def newest_s(self) -> float:
        """Time of the newest sample, s; NaN while there is none."""
        return float(self._pieces[-1][1][0, -1]) if self._pieces else float("nan")

    def push(self, frame: SampleFrame) -> None:
        """Append samples; older ones than `keep_s` go."""
        if not len(frame):
            return
        if self._pieces and frame.time_s[0] < self._pieces[-1][1][0, 0]:
            self._pieces.clear()  # a new clock
            self._rows = 0
        names = tuple(name for name in frame.channels if name not in DERIVED)
        self._pieces.append(
            (names, np.array([frame.time_s, *(frame.channels[name] for name in names)]))
        )
        self._rows += len(frame)
        oldest_s = self.newest_s - self.keep_s
        while self._pieces and (
            self._pieces[0][1][0, -1] < oldest_s or self._rows > self._most_rows
        ):
            self._rows -= self._pieces.popleft()[1].shape[1]

    def cut(self, from_s: float, to_s: float) -> list[SampleFrame]:
        """Samples within [from, to), in pieces."""
        found = []
        for names, piece in self._pieces:
            rows = piece[:, (piece[0] >= from_s) & (piece[0] < to_s)]
            if rows.shape[1]:
                found.append(SampleFrame(rows[0], dict(zip(names, rows[1:], strict=True))))
        return found
