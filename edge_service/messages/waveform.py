"""A sensor that is much faster than the drive, on the clock of its axis."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, slots=True, eq=False)
class Waveform:
    """Consecutive values of one sensor at a rate of its own.

    Attributes:
        sensor: its name, e.g. `nut_acceleration`.
        unit: of the values, e.g. `m/s^2`.
        start_s: time of the first value on the axis' clock, s.
        period_s: between two values, s.
        values: shape (n,); NaN is a missing value.
    """

    sensor: str
    unit: str
    start_s: float
    period_s: float
    values: npt.NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.values)

    @property
    def end_s(self) -> float:
        """Time at which the value after the last one is due, s."""
        return self.start_s + len(self) * self.period_s

    @property
    def time_s(self) -> npt.NDArray[np.float64]:
        """Times of the values, s, shape (n,)."""
        return self.start_s + self.period_s * np.arange(len(self), dtype=np.float64)
