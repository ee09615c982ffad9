"""Clock and speed of recordings: they decide what is slow, and what is not seen."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..messages.row_faults import CLOCK_RESET_S
from ..messages.samples import ANGLE, Floats, SampleFrame
from ..models.machine import Machine
from ..recordings.conditioning import with_angle

LEAST_RATE_HZ = 50.0
RATE_SLACK = 0.05
"""A source that is asked at 50 Hz answers at 49.7."""
TOO_SLOW = "{:.3g} samples/s do not show what a machine does while it accelerates"
STEPS = 10
"""Samples between two angles: longer than the noise of an encoder, shorter than a move."""
GAP_PERIODS = 1.5
_TURNS = (360.0, 400.0, 3.6e3, 3.6e4, 3.6e5, 2.0 * np.pi, 1.0)
_WRAPS = (*_TURNS, *(2.0**bits for bits in range(8, 33)))
_WRAP_SLACK = 0.02


@dataclass(frozen=True, slots=True)
class Clock:
    period_s: float  # median step
    gaps: int  # steps in which a row or more is missing
    longest_s: float  # step of all
    jitter: float  # 95th percentile of a step's distance from the median, as its share
    restarts: int  # steps back from which the clock starts anew
    backwards: int  # others that repeat a time or lead back

    @property
    def rate_hz(self) -> float:
        return 1.0 / self.period_s

    @property
    def is_slow(self) -> bool:
        """Samples between which a machine accelerates and is done."""
        return self.rate_hz < (1.0 - RATE_SLACK) * LEAST_RATE_HZ

    def as_text(self) -> str:
        """Rate and faults in words."""
        longest = f", the longest of {self.longest_s:.3g} s" if self.gaps else ""
        words = f"{self.rate_hz:.4g} samples/s, {self.gaps} gaps{longest}"
        words += f", jitter {100.0 * round(self.jitter, 3):.2g} %"
        words += f", starts anew {self.restarts} times" * bool(self.restarts)
        return words + f", {self.backwards} times repeated or going back" * bool(self.backwards)


def clock_of(times_s: Sequence[Floats]) -> Clock:
    """Clock of recordings with these times, (n,) each. Raises ValueError: it stands."""
    steps = np.concatenate([np.diff(time_s) for time_s in times_s])
    forward = steps[steps > 0.0]
    if forward.size == 0:
        raise ValueError("time_s never increases")
    period_s = float(np.median(forward))
    return Clock(
        period_s,
        gaps=int(np.count_nonzero(forward > GAP_PERIODS * period_s)),
        longest_s=float(forward.max()),
        jitter=float(np.percentile(np.abs(forward - period_s), 95.0)) / period_s,
        restarts=int(np.count_nonzero(steps < -CLOCK_RESET_S)),
        backwards=int(np.count_nonzero((steps <= 0.0) & (steps >= -CLOCK_RESET_S))),
    )


def wrap_of(values: Floats) -> float:
    """Size by which a position (n,) jumps where it begins anew, and its range; 0 if it does not."""
    known = values[np.isfinite(values)]
    reach = float(np.ptp(known)) if known.size else 0.0
    jumps = np.abs(np.diff(known))
    jumps = jumps[jumps > 0.5 * reach]
    size = next((size for size in _WRAPS if abs(reach / size - 1.0) < _WRAP_SLACK), 0.0)
    return size if 0 < jumps.size < 0.1 * known.size and jumps.min() > 0.8 * reach else 0.0


def motion_speeds(machine: Machine, recordings: Sequence[SampleFrame]) -> Floats:
    """Speeds of the motor over some samples each, without rests of the clock, rad/s, (n,)."""
    found = [np.empty(0)]
    for frame in with_angle(recordings, machine.transmission_ratio_m_per_rad):
        if ANGLE in frame.channels:
            time_s, angle_rad = frame.time_s[::STEPS], frame.channels[ANGLE][::STEPS]
            step_s = np.diff(time_s)
            forward = step_s > 0.0
            found.append(np.diff(angle_rad)[forward] / step_s[forward])
    speeds: Floats = np.concatenate(found)
    return speeds[np.isfinite(speeds)]
