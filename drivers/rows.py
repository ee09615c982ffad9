"""Rows that a driver has read one by one, put together to sample frames."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from edge_service.messages.quality import Quality
from edge_service.messages.samples import SampleFrame

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
