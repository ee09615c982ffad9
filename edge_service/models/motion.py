"""Commanded motion: jerk-limited moves and dwells, strung together by named motions."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..messages.samples import Floats
from .controller import MAX_TORQUE_NM
from .machine import Machine

DEFAULT_STROKE_M = 0.8
DEFAULT_SPEED_RAD_S = 628.0  # 6000 rpm, Table A.4
DEFAULT_SPEED_M_S = 0.5
DEFAULT_ACCELERATION_M_S2 = 4.0
DEFAULT_JERK_M_S3 = 200.0
STROKE_MARGIN = 0.05
"""Share of the stroke that a motion leaves free at either end."""


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """Where and how fast an axis may go; all in m and s, all rates greater than 0."""

    low_m: float
    high_m: float
    speed_m_s: float = DEFAULT_SPEED_M_S
    acceleration_m_s2: float = DEFAULT_ACCELERATION_M_S2
    jerk_m_s3: float = DEFAULT_JERK_M_S3

    @property
    def span_m(self) -> float:
        """Length of the usable stroke, m."""
        return self.high_m - self.low_m


def motion_limits(machine: Machine) -> MotionLimits:
    """Limits from the machine file's axis table, and the defaults above for what it lacks.

    The acceleration leaves half of the torque limit to friction, forces and control.
    """
    axis, ratio = machine.axis, machine.transmission_ratio_m_per_rad
    max_torque = axis.max_torque_nm or MAX_TORQUE_NM
    strongest = 0.5 * max_torque * ratio / machine.model.inertia_kg_m2.value
    stroke = axis.stroke_m or DEFAULT_STROKE_M
    return MotionLimits(
        low_m=STROKE_MARGIN * stroke,
        high_m=(1.0 - STROKE_MARGIN) * stroke,
        speed_m_s=min(DEFAULT_SPEED_M_S, (axis.max_speed_rad_s or DEFAULT_SPEED_RAD_S) * ratio),
        acceleration_m_s2=min(axis.max_acceleration_m_s2 or DEFAULT_ACCELERATION_M_S2, strongest),
    )


class Segment(Protocol):
    """A piece of motion that starts and ends at rest."""

    @property
    def duration_s(self) -> float:
        """Time until rest, s."""

    @property
    def distance_m(self) -> float:
        """Signed travel from start to end, m."""

    def setpoints(self, time_s: Floats) -> Floats:
        """Travel m, speed m/s and acceleration m/s^2 at times (n,) since its start, (n, 3)."""


@dataclass(frozen=True, slots=True)
class Dwell:
    """Standing still."""

    duration_s: float

    @property
    def distance_m(self) -> float:
        """No travel."""
        return 0.0

    def setpoints(self, time_s: Floats) -> Floats:
        """Zeros, shape (n, 3)."""
        return np.zeros((len(time_s), 3))


@dataclass(frozen=True, slots=True)
class Move:
    """A point-to-point move of seven phases: jerk, hold, jerk; cruise; and the same backwards.

    Rest-to-rest double S in closed form (Biagiotti and Melchiorri, Trajectory Planning for
    Automatic Machines and Robots, 2008, section 3.4). A distance too short for the given speed or
    acceleration lowers what is reached. The second half mirrors the first in time, so the end is
    exact.
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
        rise_s = max(speed / acceleration + jerk_s, 2.0 * jerk_s)
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

    def setpoints(self, time_s: Floats) -> Floats:
        """Travel m, speed m/s and acceleration m/s^2 at times (n,) since its start, (n, 3)."""
        duration = self.duration_s
        since_start = np.clip(time_s, 0.0, duration)
        late = since_start > 0.5 * duration
        travel, speed, acceleration = self._first_half(
            np.where(late, duration - since_start, since_start)
        )
        length = abs(self.distance_m)
        sign = math.copysign(1.0, self.distance_m)
        return sign * np.column_stack(
            (
                np.where(late, length - travel, travel),
                speed,
                np.where(late, -acceleration, acceleration),
            )
        )

    def _first_half(self, time_s: Floats) -> tuple[Floats, Floats, Floats]:
        """Travel, speed and acceleration of the rise and the cruise, at times (n,) from rest."""
        jerk_s, hold_s, _cruise_s = self.phases_s
        travel, speed, acceleration = (np.zeros_like(time_s) for _ in range(3))
        start, x, v, a = 0.0, 0.0, 0.0, 0.0
        for jerk, length in (
            (self.jerk_m_s3, jerk_s),
            (0.0, hold_s),
            (-self.jerk_m_s3, jerk_s),
            (0.0, math.inf),
        ):
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


def production(limits: MotionLimits, random: np.random.Generator) -> Iterator[Segment]:
    """Endless production-like motion: rapids, feeds and short steps with dwells between.

    Feeds run at 2 to 20 % of the rapid speed over 2 to 20 % of the stroke.
    """
    position = limits.low_m
    while True:
        kind = random.choice(3, p=(0.5, 0.35, 0.15))
        speed = limits.speed_m_s
        if kind == 0:
            target = random.uniform(limits.low_m, limits.high_m)
            speed *= random.uniform(0.6, 1.0)
        else:
            length, share = (0.02, 0.2) if kind == 1 else (0.001, 0.01), (0.02, 0.2)
            step = limits.span_m * math.exp(random.uniform(*np.log(length)))
            step *= random.choice((-1.0, 1.0))
            inside = limits.low_m <= position + step <= limits.high_m
            target = position + (step if inside else -step)
            speed *= math.exp(random.uniform(*np.log(share)))
        move = Move(target - position, speed, limits.acceleration_m_s2, limits.jerk_m_s3)
        position = target
        yield move
        yield Dwell(random.uniform(0.1, 0.6))


MotionSource = Callable[[MotionLimits, np.random.Generator], Iterator[Segment]]

MOTIONS: dict[str, MotionSource] = {"production": production}
"""Named motions; each starts at `limits.low_m` at rest and is fixed by its random generator."""


class Setpoints:
    """Samples segments at a fixed rate; the same numbers however they are asked for.

    Every segment takes a whole number of samples, so each starts on a sample. When the segments
    end, the axis stands still.
    """

    def __init__(self, segments: Iterator[Segment], start_m: float, rate_hz: float) -> None:
        self._segments = segments
        self._origin_m = start_m
        self._rate_hz = rate_hz
        self._segment: Segment = Dwell(0.0)
        self._taken = 0
        self._count = 0

    def take(self, count: int) -> Floats:
        """The next `count` setpoints: position m, speed m/s, acceleration m/s^2, (count, 3)."""
        parts = []
        while count > 0:
            if self._taken == self._count:
                self._next_segment()
                continue
            run = min(count, self._count - self._taken)
            index = np.arange(self._taken, self._taken + run)
            part = self._segment.setpoints(index / self._rate_hz)
            part[:, 0] += self._origin_m
            parts.append(part)
            self._taken += run
            count -= run
        return np.concatenate(parts) if parts else np.empty((0, 3))

    def _next_segment(self) -> None:
        self._origin_m += self._segment.distance_m
        self._segment = next(self._segments, Dwell(1.0))
        self._taken = 0
        self._count = math.ceil(self._segment.duration_s * self._rate_hz)
