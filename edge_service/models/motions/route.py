"""Segments strung together within the limits of an axis, and sampled."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from .excitation import Shaken
from .limits import MotionError, MotionLimits
from .segments import Dwell, Move

Segment = Move | Dwell | Shaken

_ON_THE_STROKE_M = 1e-9  # sums of distances are not exact


@dataclass(frozen=True, slots=True)
class Plan:
    """A finite motion."""

    segments: tuple[Segment, ...]  # in order; the first starts at rest at `MotionLimits.low_m`
    left_out: tuple[str, ...] = ()  # what the axis does not allow, one line each

    @property
    def duration_s(self) -> float:
        """Time until rest, s."""
        return sum(segment.duration_s for segment in self.segments)


class Route:
    """Collects the segments of one motion, from `limits.low_m` on.

    With `clip` what the axis does not allow is left out, instead of refusing the whole motion.
    """

    def __init__(self, name: str, limits: MotionLimits, *, clip: bool = False) -> None:
        self.name = name
        self.limits = limits
        self.position_m = limits.low_m
        self.segments: list[Segment] = []
        self.left_out: list[str] = []
        self._clip = clip

    def accepts(self, what: str, **asked: float) -> bool:
        """Return whether the axis allows a part that asks for as much; it is left out if not.

        Raises MotionError: the axis does not allow it, and nothing may be left out.
        """
        excess = self.limits.excess(**asked)
        if excess is None:
            return True
        line = f"{self.name}, {what}: {excess}"
        if not self._clip:
            raise MotionError(f"{line}; `motion --clip` leaves it out")
        self.left_out.append(line)
        return False

    def go_to(self, target_m: float) -> None:
        """An ordinary move to a position."""
        self.move(target_m - self.position_m, self.limits.rapid_m_s)
        self.position_m = target_m

    def move(
        self,
        distance_m: float,
        speed_m_s: float,
        acceleration_m_s2: float | None = None,
        jerk_m_s3: float | None = None,
    ) -> None:
        """A move by a signed distance; acceleration and jerk are those allowed unless given."""
        if distance_m != 0.0:
            limits = self.limits
            acceleration = acceleration_m_s2 or limits.acceleration_m_s2
            self.add(Move(distance_m, speed_m_s, acceleration, jerk_m_s3 or limits.jerk_m_s3))

    def rest(self, duration_s: float) -> None:
        """Stand still."""
        self.add(Dwell(duration_s))

    def add(self, segment: Segment) -> None:
        """Append a segment. Raises MotionError: it breaks a limit or leaves the stroke."""
        limits = self.limits
        excess = limits.excess(
            speed_m_s=segment.peak_speed_m_s, acceleration_m_s2=segment.peak_acceleration_m_s2
        )
        end_m = self.position_m + segment.distance_m
        if not limits.low_m - _ON_THE_STROKE_M <= end_m <= limits.high_m + _ON_THE_STROKE_M:
            excess = (
                f"stroke: asks for {1e3 * end_m:.4g} mm, the axis allows "
                f"{1e3 * limits.low_m:.4g} to {1e3 * limits.high_m:.4g} mm"
            )
        if excess is not None:
            raise MotionError(f"{self.name}: {excess}")
        self.position_m = end_m
        self.segments.append(segment)

    def finish(self) -> Plan:
        """The plan; back at the start, at rest.

        Raises MotionError: nothing is left of the motion.
        """
        if not self.segments:
            raise MotionError(f"{self.name}: nothing is left of it; {self.left_out[0]}")
        self.go_to(self.limits.low_m)
        return Plan(tuple(self.segments), tuple(self.left_out))


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
                self._origin_m += self._segment.distance_m
                self._segment = next(self._segments, Dwell(1.0))
                self._taken = 0
                self._count = samples_of(self._segment, self._rate_hz)
                continue
            run = min(count, self._count - self._taken)
            index = np.arange(self._taken, self._taken + run)
            part = self._segment.setpoints(index / self._rate_hz)
            part[:, 0] += self._origin_m
            parts.append(part)
            self._taken += run
            count -= run
        return np.concatenate(parts) if parts else np.empty((0, 3))


def samples_of(segment: Segment, rate_hz: float) -> int:
    """Whole number of samples that a segment takes."""
    return math.ceil(segment.duration_s * rate_hz)
