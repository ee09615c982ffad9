"""Friction points: the mean torque of every cruise in a recording (the thesis' friction test)."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ...messages.channels import ANGLE, TABLE_POSITION, TEMPERATURE, TORQUE
from ...messages.samples import Booleans, Floats
from ...recordings.conditioning import central_difference, low_pass
from ...regression.linear import correlation_time
from ...regression.prepared_run import PreparedRun

TREND_HZ = 10.0
"""Slower than the ripple of a revolution at feed speeds, faster than a ramp."""


@dataclass(frozen=True, slots=True)
class CruiseSettings:
    """Criteria for constant speed.

    Attributes:
        speed_change: greatest relative change of speed in `over_s`.
        over_s: time over which the speed may change by so much, s.
        settle_s: cut from the start and the end of each cruise, where the drive settles, s.
        least_s: shortest cruise that is used, after the cut, s.
    """

    speed_change: float = 0.02
    over_s: float = 0.1
    settle_s: float = 0.1
    least_s: float = 0.1


@dataclass(frozen=True, slots=True)
class FrictionPoint:
    """Torque at one constant speed.

    Attributes:
        time_s: middle of the cruise, s.
        speed_rad_s: mean motor speed, signed, rad/s.
        torque_nm: mean torque, signed, N m; what its mean acceleration needs is taken off.
        standard_error_nm: of that mean, from the effective number of samples, N m.
        n_effective: independent samples behind it.
        position_m: middle of the travel, m.
        travel_m: signed length of the travel, m.
        temperature_c: mean, degC; NaN without that channel.
    """

    time_s: float
    speed_rad_s: float
    torque_nm: float
    standard_error_nm: float
    n_effective: float
    position_m: float
    travel_m: float
    temperature_c: float

    @property
    def forward(self) -> bool:
        """True if the axis moved in the positive direction."""
        return self.speed_rad_s > 0.0


def friction_points(
    runs: Iterable[PreparedRun],
    settings: CruiseSettings | None = None,
    inertia_kg_m2: float = 0.0,
) -> Iterator[FrictionPoint]:
    """One point per cruise.

    A cruise of a revolution or more is cut to whole revolutions, so that what repeats with the
    screw leaves the mean alone.

    Args:
        runs: with torque.
        settings: what counts as constant speed.
        inertia_kg_m2: of the axis at the motor, for the small acceleration that is left.
    """
    settings = settings or CruiseSettings()
    for run in runs:
        for cruise in cruises(run, settings):
            yield _point(run, cruise, inertia_kg_m2)


def cruises(run: PreparedRun, settings: CruiseSettings) -> Iterator[slice]:
    """Samples of constant speed, trimmed."""
    trend_hz = min(TREND_HZ, run.settings.cutoff_hz)
    speed = low_pass(run.speed_rad_s, trend_hz, 2, run.period_s)
    change = np.abs(central_difference(speed, run.period_s)) * settings.over_s
    steady = run.moving & (change < settings.speed_change * np.abs(speed))
    margin = math.ceil(settings.settle_s / run.period_s)
    least = max(math.ceil(settings.least_s / run.period_s), 8)
    for start, end in _stretches(steady):
        inside = _whole_revolutions(run.channels[ANGLE], start + margin, end - margin)
        if inside.stop - inside.start >= least:
            yield inside


def _stretches(mask: Booleans) -> list[tuple[int, int]]:
    """First and one-past-last index of every stretch of True."""
    labels, count = ndimage.label(mask)
    found = ndimage.find_objects(labels, count)
    return [(where[0].start, where[0].stop) for where in found]


def _whole_revolutions(angle_rad: Floats, start: int, end: int) -> slice:
    if end - start < 2:
        return slice(start, start)
    travel = np.abs(angle_rad[start:end] - angle_rad[start])
    revolutions = math.floor(travel[-1] / (2.0 * math.pi))
    if revolutions == 0:
        return slice(start, end)
    return slice(start, start + int(np.searchsorted(travel, 2.0 * math.pi * revolutions)))


def _point(run: PreparedRun, cruise: slice, inertia_kg_m2: float) -> FrictionPoint:
    torque = run.channels[TORQUE][cruise] - inertia_kg_m2 * run.acceleration_rad_s2[cruise]
    n_effective = len(torque) / correlation_time(torque)
    position = run.channels.get(TABLE_POSITION, run.channels[ANGLE] * run.settings.ratio_m_per_rad)[
        cruise
    ]
    temperature = run.channels.get(TEMPERATURE)
    return FrictionPoint(
        time_s=float(np.mean(run.time_s[cruise])),
        speed_rad_s=float(np.mean(run.speed_rad_s[cruise])),
        torque_nm=float(np.mean(torque)),
        standard_error_nm=float(np.std(torque)) / math.sqrt(max(n_effective - 1.0, 1.0)),
        n_effective=n_effective,
        position_m=float(0.5 * (position[0] + position[-1])),
        travel_m=float(position[-1] - position[0]),
        temperature_c=math.nan if temperature is None else float(np.mean(temperature[cruise])),
    )
