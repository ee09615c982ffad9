"""Frames put together until they may complete an interval: fewer, longer steps of arithmetic."""

import numpy as np

from ..messages.samples import SampleFrame

MOST_FRAMES = 256


class Gathering:
    """Frames of one axis that wait for the sample that completes an interval."""

    def __init__(self) -> None:
        self._waiting: list[SampleFrame] = []

    def add(self, frame: SampleFrame, due_s: float) -> list[SampleFrame]:
        """Frames that need not wait any longer, in their order.

        Args:
            due_s: time of the sample that completes the current interval, s; see `Downsampler`.
        """
        if self._waiting and not _continues(self._waiting[-1], frame):
            return [*self._all(), frame]
        self._waiting.append(frame)
        newest_s = frame.time_s[-1]  # a clock that goes back inside a frame ends an interval
        is_early = newest_s < due_s and frame.time_s.max() <= newest_s
        return [] if is_early and len(self._waiting) < MOST_FRAMES else self._all()

    def _all(self) -> list[SampleFrame]:
        frames, self._waiting = self._waiting, []
        if len(frames) < 2:
            return frames
        channels = {
            name: np.concatenate([each.channels[name] for each in frames])
            for name in frames[0].channels
        }
        return [SampleFrame(np.concatenate([each.time_s for each in frames]), channels)]


def _continues(before: SampleFrame, frame: SampleFrame) -> bool:
    """Tell whether two frames can be put together; one that is doubted stays by itself."""
    return (
        before.channels.keys() == frame.channels.keys()
        and bool(frame.time_s[0] > before.time_s[-1])
        and not (before.quality or frame.quality)
    )
