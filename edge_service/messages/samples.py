"""Samples of one axis at the native rate of its drive."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from .quality import Qualities
from .waveform import Waveform

Floats = npt.NDArray[np.float64]
Booleans = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class SampleFrame:
    """A run of consecutive samples of one axis.

    Attributes:
        time_s: the axis' own clock, s, shape (n,).
        channels: channel name -> values in SI units, shape (n,) each; NaN is a missing value.
            Times may repeat, jump or run backwards: judging that is the downsampler's work.
        quality: channel name -> code of `Quality` per sample, shape (n,); a channel without is
            good where it has a number.
        waveforms: what faster sensors of the axis measured meanwhile, on the same clock.
    """

    time_s: Floats
    channels: Mapping[str, Floats]
    quality: Mapping[str, Qualities] = field(default_factory=dict)
    waveforms: tuple[Waveform, ...] = ()

    def __post_init__(self) -> None:
        for name, values in self.channels.items():
            if values.shape != self.time_s.shape:
                raise ValueError(
                    f"channel {name}: shape {values.shape}, time has {self.time_s.shape}"
                )
        for name, codes in self.quality.items():
            if name not in self.channels or codes.shape != self.time_s.shape:
                raise ValueError(f"quality of {name}: no channel of that name and shape")

    def __len__(self) -> int:
        return int(self.time_s.shape[0])

    def until(self, end_s: float) -> "SampleFrame":
        """The samples before `end_s` on the axis' clock."""
        keep = self.time_s < end_s
        return SampleFrame(
            self.time_s[keep],
            {name: values[keep] for name, values in self.channels.items()},
            {name: codes[keep] for name, codes in self.quality.items()},
        )
