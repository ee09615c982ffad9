"""Friction points: the mean torque of every cruise in a recording (the thesis' friction test)."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ...messages.samples import ANGLE, TORQUE
from ...recordings.conditioning import central_difference, low_pass
from ...regression.linear import correlation_time
from ...regression.prepared_run import PreparedRun

TREND_HZ = 10.0
"""Slower than the ripple of a revolution at feed speeds, faster than a ramp."""


STEADY, OVER_S = 0.02, 0.1
"""Greatest relative change of a constant speed, and the time within which."""
SETTLE_S = 0.1
"""Cut from the start and the end of each cruise, where the drive settles."""
LEAST_S = 0.1
"""Shortest cruise that is used, after the cut."""


@dataclass(frozen=True, slots=True)
class FrictionPoint:
    """Torque at one constant speed.

    Attributes:
        time_s: middle of the cruise, s.
        speed_rad_s: mean motor speed, signed, rad/s.
        torque_nm: mean torque, signed, N m; what its mean acceleration needs is taken off.
        standard_error_nm: of that mean, from the effective number of samples, N m.
    """

    time_s: float
    speed_rad_s: float
    torque_nm: float
    standard_error_nm: float

    @property
    def forward(self) -> bool:
        """Motion in the positive direction."""
        return self.speed_rad_s > 0.0


def friction_points(
    runs: Iterable[PreparedRun], inertia_kg_m2: float = 0.0
) -> Iterator[FrictionPoint]:
    """One point per cruise.

    Args:
        runs: with torque.
        inertia_kg_m2: of the axis at the motor, for the small acceleration that is left.
    """
    for run in runs:
        for cruise in cruises(run):
            torque = run.channels[TORQUE][cruise] - inertia_kg_m2 * run.acceleration_rad_s2[cruise]
            independent = len(torque) / correlation_time(torque)
            error_nm = float(np.std(torque)) / math.sqrt(max(independent - 1.0, 1.0))
            time_s = float(np.mean(run.time_s[cruise]))
            speed_rad_s = float(np.mean(run.speed_rad_s[cruise]))
            yield FrictionPoint(time_s, speed_rad_s, float(np.mean(torque)), error_nm)


def cruises(run: PreparedRun) -> Iterator[slice]:
    """Samples of constant speed, trimmed; of a revolution or more, to whole revolutions.

    So what repeats with the screw leaves the mean alone.
    """
    trend_hz = min(TREND_HZ, run.settings.cutoff_hz)
    speed = low_pass(run.speed_rad_s, trend_hz, 2, run.period_s)
    change = np.abs(central_difference(speed, run.period_s)) * OVER_S
    steady = run.moving & (change < STEADY * np.abs(speed))
    margin = math.ceil(SETTLE_S / run.period_s)
    least = max(math.ceil(LEAST_S / run.period_s), 8)
    labels, count = ndimage.label(steady)
    for (where,) in ndimage.find_objects(labels, count):
        start, end = where.start + margin, where.stop - margin
        if end - start < least:
            continue
        angle = run.channels[ANGLE]
        travel = np.abs(angle[start:end] - angle[start])
        revolutions = math.floor(travel[-1] / (2.0 * math.pi))
        if revolutions:
            end = start + int(np.searchsorted(travel, 2.0 * math.pi * revolutions))
        if end - start >= least:
            yield slice(start, end)
