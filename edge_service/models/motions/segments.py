"""Pieces of motion that start and end at rest and never turn back between.

Each has `duration_s` until rest, `distance_m`, signed, `peak_speed_m_s` and
`peak_acceleration_m_s2`, bounds of the magnitudes, and `setpoints` at times since its start.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...messages.samples import Floats


@dataclass(frozen=True, slots=True)
class Dwell:
    """Standing still."""

    duration_s: float
    distance_m: ClassVar[float] = 0.0
    peak_speed_m_s: ClassVar[float] = 0.0
    peak_acceleration_m_s2: ClassVar[float] = 0.0

    def setpoints(self, time_s: Floats) -> Floats:
        """Zeros, shape (n, 3)."""
        return np.zeros((len(time_s), 3))


def rise_time(speed_m_s: float, acceleration_m_s2: float, jerk_m_s3: float) -> float:
    """Time from rest to a speed within acceleration and jerk, s; it takes half that time's way."""
    jerk_s = min(acceleration_m_s2 / jerk_m_s3, math.sqrt(speed_m_s / jerk_m_s3))
    return max(speed_m_s / acceleration_m_s2 + jerk_s, 2.0 * jerk_s)


@dataclass(frozen=True, slots=True)
class Move:
    """A point-to-point move of seven phases: jerk, hold, jerk; cruise; and the same backwards.

    Rest-to-rest double S in closed form (Biagiotti and Melchiorri, Trajectory Planning for
    Automatic Machines and Robots, 2008, section 3.4). A distance too short for the given speed or
    acceleration lowers what is reached. The second half is the first in reverse: it ends exactly.
    """

    distance_m: float
    speed_m_s: float
    acceleration_m_s2: float
    jerk_m_s3: float

    @property
    def phases_s(self) -> tuple[float, float, float]:
        """Duration of one jerk phase, of the acceleration held between two, and of the cruise."""
        distance, speed = abs(self.distance_m), self.speed_m_s
        acceleration, jerk = self.acceleration_m_s2, self.jerk_m_s3
        jerk_s = min(acceleration / jerk, math.sqrt(speed / jerk))
        rise_s = rise_time(speed, acceleration, jerk)
        if distance >= speed * rise_s:
            return jerk_s, rise_s - 2.0 * jerk_s, distance / speed - rise_s
        if distance >= 2.0 * acceleration**3 / jerk**2:
            jerk_s = acceleration / jerk
            rise_s = 0.5 * jerk_s + math.sqrt(0.25 * jerk_s**2 + distance / acceleration)
            return jerk_s, max(rise_s - 2.0 * jerk_s, 0.0), 0.0
        return math.cbrt(0.5 * distance / jerk), 0.0, 0.0

    @property
    def duration_s(self) -> float:
        """Time until rest, s."""
        jerk_s, hold_s, cruise_s = self.phases_s
        return 4.0 * jerk_s + 2.0 * hold_s + cruise_s

    @property
    def peak_acceleration_m_s2(self) -> float:
        return self.jerk_m_s3 * self.phases_s[0]

    @property
    def peak_speed_m_s(self) -> float:
        jerk_s, hold_s, _cruise_s = self.phases_s
        return self.peak_acceleration_m_s2 * (jerk_s + hold_s)

    def setpoints(self, time_s: Floats) -> Floats:
        """Travel m, speed m/s and acceleration m/s^2 at times (n,) since its start, (n, 3)."""
        duration = self.duration_s
        since_start = np.clip(time_s, 0.0, duration)
        late = since_start > 0.5 * duration
        mirrored_s = np.where(late, duration - since_start, since_start)
        travel, speed, acceleration = self._first_half(mirrored_s)
        travel = np.where(late, abs(self.distance_m) - travel, travel)
        acceleration = np.where(late, -acceleration, acceleration)
        sign = math.copysign(1.0, self.distance_m)
        return sign * np.column_stack((travel, speed, acceleration))

    def _first_half(self, time_s: Floats) -> tuple[Floats, Floats, Floats]:
        """Travel, speed and acceleration of the rise and the cruise, at times (n,) from rest."""
        jerk_s, hold_s, _cruise_s = self.phases_s
        travel, speed, acceleration = (np.zeros_like(time_s) for _ in range(3))
        start, x, v, a = 0.0, 0.0, 0.0, 0.0
        up = self.jerk_m_s3
        for jerk, length in ((up, jerk_s), (0.0, hold_s), (-up, jerk_s), (0.0, math.inf)):
            inside = time_s >= start
            t = time_s[inside] - start
            travel[inside] = x + t * (v + t * (a / 2.0 + t * jerk / 6.0))
            speed[inside] = v + t * (a + t * jerk / 2.0)
            acceleration[inside] = a + t * jerk
            if math.isinf(length):
                break
            x += length * (v + length * (a / 2.0 + length * jerk / 6.0))
            v += length * (a + length * jerk / 2.0)
            a = a + length * jerk if jerk >= 0.0 else 0.0
            start += length
        return travel, speed, acceleration
