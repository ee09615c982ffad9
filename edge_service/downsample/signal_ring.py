"""Ring of the latest values of a fast signal, for recordings of events. Pure."""

from collections import deque

import numpy as np

from ..messages.samples import SampleFrame
from ..messages.waveform import Waveform


class SignalRing:
    """Ring of the last seconds of one sensor's signal.

    Args:
        keep_s: length, s.
    """

    def __init__(self, keep_s: float) -> None:
        self._keep_s = keep_s
        self._pieces: deque[Waveform] = deque()

    @property
    def newest_s(self) -> float:
        """End of the kept signal on the axis' clock, s; NaN while it is empty."""
        return self._pieces[-1].end_s if self._pieces else float("nan")

    def push(self, wave: Waveform) -> None:
        """Append a piece; older ones than `keep_s` go."""
        if self._pieces and wave.start_s < self._middle_s(self._pieces[-1]):
            self._pieces.clear()  # a new clock, or the same piece again
        self._pieces.append(wave)
        while self._pieces[0].end_s < wave.end_s - self._keep_s:
            self._pieces.popleft()

    @staticmethod
    def _middle_s(piece: Waveform) -> float:
        return 0.5 * (piece.start_s + piece.end_s)

    def cut(self, from_s: float, to_s: float) -> SampleFrame | None:
        """Signal within [from, to) as rows of a trace; None where there is none."""
        kept = [piece for piece in self._pieces if piece.end_s > from_s and piece.start_s < to_s]
        if not kept:
            return None
        time_s = np.concatenate([piece.time_s for piece in kept])
        values = np.concatenate([piece.values for piece in kept])
        inside = (time_s >= from_s) & (time_s < to_s)
        return SampleFrame(time_s[inside], {kept[0].sensor: values[inside]})
