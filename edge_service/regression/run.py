"""Unbroken run of an axis, and the low-pass that everything compared must pass."""

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..messages.samples import Booleans, Floats, Integers
from ..models.compiled import compiled
from ..models.effects.baseline import Motion
from ..models.effects.effect import ACCELERATION_HZ
from ..recordings.conditioning import low_pass

SLOW_HZ = ACCELERATION_HZ
"""Below this sampling rate accelerations come and go between two samples: what is compared is the
motion that lasts, sample by sample, without a low-pass."""
CUTOFF_HZ = 40.0
"""Low-pass of both sides of the comparison: above the position loop, below torsional modes."""
FILTER_ORDER = 4
CUTOFF_SHARE = 0.2
"""Of the sampling rate, where that is too low for `CUTOFF_HZ`."""
_ROWS_PER_CUTOFF = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Filter:
    """Zero-phase low-pass that keeps every `step`-th sample."""

    taps: Floats  # symmetric impulse response of a Butterworth filter run both ways, (2 m + 1,)
    step: int
    period_s: float

    @classmethod
    def of_period(cls, period_s: float) -> "Filter":
        """Filter of the comparison for a sampling period; none where samples are few."""
        if misses_acceleration(period_s):
            return cls(np.ones(1), 1, period_s)
        cutoff_hz = min(CUTOFF_HZ, CUTOFF_SHARE / period_s)
        step = max(math.floor(1.0 / (period_s * cutoff_hz * _ROWS_PER_CUTOFF)), 1)
        reach = math.ceil(3.0 / (cutoff_hz * period_s))
        impulse = np.zeros(4 * reach + 1)
        impulse[2 * reach] = 1.0
        taps = low_pass(impulse, cutoff_hz, FILTER_ORDER, period_s)[reach:-reach]
        return cls(taps / taps.sum(), step, period_s)

    @property
    def cutoff_hz(self) -> float:
        """Frequency at which half of an amplitude passes."""
        return min(CUTOFF_HZ, CUTOFF_SHARE / self.period_s)

    def __call__(self, values: Floats) -> Floats:
        """Filtered rows, (n,) -> (ceil(n / step),)."""
        return self.at(values, np.arange(-(-len(values) // self.step)))

    def at(self, values: Floats, rows: Integers) -> Floats:
        """Filtered rows by their numbers, (k,): what is thinned costs nothing."""
        reach = len(self.taps) // 2
        return _weighed(np.pad(values, reach, mode="edge"), self.taps, self.step * rows)


@partial(compiled, reordered=True)
def _weighed(values: Floats, taps: Floats, starts: Integers) -> Floats:
    """Sums of what begins at some places, by the weights of the taps, (k,)."""
    found, count = np.empty(starts.shape[0]), taps.shape[0]
    for k in range(starts.shape[0]):
        total, part = 0.0, values[starts[k] : starts[k] + count]
        for j in range(count):
            total += taps[j] * part[j]
        found[k] = total
    return found


def misses_acceleration(period_s: float) -> bool:
    """Flag of a sampling period that is too long to follow accelerations."""
    return is_below(period_s, SLOW_HZ)


def is_below(period_s: float, least_hz: float) -> bool:
    """Flag of a sampling period that is too long for a rate."""
    return period_s * least_hz > 1.0 + 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """Unbroken run at its native rate, edges cut off; all arrays (n,)."""

    motion: Motion  # of the motor, from the filtered angle, with what the baseline says of it
    moving: Booleans  # samples that are not at rest
    resolved: Booleans  # samples whose acceleration the sampling follows; all, unless it is slow
    # samples near which the motion takes more torque than the drive's limit, and the reading stays
    # there: the torque is not known but for its least size
    clipped: Booleans
    # table position minus that of the angle; None without a linear encoder
    transmission_m: Floats | None
    # temperature_c, setpoint_m: None where not recorded
    temperature_c: Floats | None
    setpoint_m: Floats | None
    recording: int  # number of the file that it comes from
    low_pass: Filter
    noise: dict[str, float]  # white noise of the raw channels, by channel

    @property
    def period_s(self) -> float:
        """Sampling period of its clock, s."""
        return float(self.motion.time_s[1] - self.motion.time_s[0])

    @property
    def duration_s(self) -> float:
        """Time from the first sample to the last, s."""
        return float(self.motion.time_s[-1] - self.motion.time_s[0])

    @property
    def has_torque(self) -> bool:
        """Presence of the torque in the recording."""
        return bool(np.isfinite(self.motion.torque_nm).all())

    def resting_zero(self, values: Floats) -> Floats:
        """Filtered rows of `values`, which count as zero at rest."""
        return self.low_pass(np.where(self.moving, values, 0.0))

    def at_rows(self, values: Floats) -> Floats:
        return values[:: self.low_pass.step]

    @property
    def misses_acceleration(self) -> bool:
        """Flag of a sampling that does not follow accelerations."""
        return misses_acceleration(self.low_pass.period_s)

    @property
    def compared_rows(self) -> Booleans:
        """Rows whose torque can be compared: in motion, resolved, and known."""
        return (self.moving & self.resolved & ~self.clipped)[:: self.low_pass.step]
