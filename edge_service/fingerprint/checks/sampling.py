"""Sampling and speed as recordings show them: they decide what is slow, and what is not seen."""

from collections.abc import Sequence

import numpy as np

from ...messages.channels import ANGLE
from ...messages.samples import Floats, SampleFrame
from ...models.machine import Machine
from ...recordings.signals.conditioning import with_angle

LEAST_RATE_HZ = 50.0
RATE_SLACK = 0.05
TOO_SLOW = "{:.3g} samples/s do not show what a machine does while it accelerates"
"""A source that is asked at 50 Hz answers at 49.7."""
STEPS = 10
"""Samples between two angles: longer than the noise of an encoder, shorter than a move."""


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


def sampling_period_s(recordings: Sequence[SampleFrame]) -> float:
    """Median step of the clock, s. Raises ValueError: it stands."""
    steps = np.concatenate([np.diff(frame.time_s) for frame in recordings])
    forward = steps[steps > 0.0]
    if forward.size == 0:
        raise ValueError("time_s never increases")
    return float(np.median(forward))


def is_slow(period_s: float) -> bool:
    """Tell whether a machine accelerates and is done between a few of such samples."""
    return 1.0 / period_s < (1.0 - RATE_SLACK) * LEAST_RATE_HZ
