"""Command to a simulated axis: a motion by its name, to its end or for a while."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..models.motions.registry import (
    MOTIONS,
    Dwell,
    MotionError,
    MotionLimits,
    Move,
    Segment,
    Setpoints,
)
from ..models.motions.route import samples_of

ENDLESS_DURATION_S = 60.0
"""Duration of an endless motion unless one is given."""
_HOME_REST_S = 0.2
_AT_HOME_M = 1e-9  # sums of distances are not exact


@dataclass(frozen=True, slots=True, eq=False)
class CommandedMotion:
    """One motion from home on: its name, its setpoints and how many of them are wanted."""

    name: str
    setpoints: Setpoints
    count: int


@dataclass(frozen=True, slots=True)
class MotionWish:
    """A named motion; its own duration unless one is given."""

    name: str
    duration_s: float | None = None

    @classmethod
    def parse(cls, text: str, duration_s: float | None = None) -> "MotionWish":
        """NAME or NAME:duration_s=SECONDS; `duration_s` where the text says none.

        Raises:
            MotionError: one line; no such motion, or no such duration.

        >>> MotionWish.parse("warmup:duration_s=300")
        MotionWish(name='warmup', duration_s=300.0)
        """
        name, _, rest = text.partition(":")
        if name not in MOTIONS:
            raise MotionError(f"motion: {name!r} is not one of {', '.join(sorted(MOTIONS))}")
        if rest:
            if duration_s is not None:
                raise MotionError(f"motion {name}: has two durations; expected one")
            duration_s = _duration(name, rest)
        if duration_s is not None and not 0.0 < duration_s < math.inf:
            raise MotionError(f"duration: expected a time above 0 s, got {duration_s:g} s")
        return cls(name, duration_s)

    def cut_off(
        self, limits: MotionLimits, rate_hz: float, random: np.random.Generator
    ) -> CommandedMotion:
        """The motion to its end, or for the duration and then no longer, even within a move.

        Raises:
            MotionError: the axis does not allow it.
        """
        segments: Iterable[Segment] = MOTIONS[self.name](limits, random)
        duration_s = self._bounded_s(limits)
        if duration_s is None:
            segments = tuple(segments)
            count = sum(samples_of(segment, rate_hz) for segment in segments)
        else:
            count = max(round(duration_s * rate_hz), 1)
        return CommandedMotion(self.name, Setpoints(iter(segments), limits.low_m, rate_hz), count)

    def and_home(
        self, limits: MotionLimits, rate_hz: float, random: np.random.Generator
    ) -> CommandedMotion:
        """The motion in whole moves, and then the way home, so that another can follow.

        Raises:
            MotionError: the axis does not allow it, or it takes longer than the duration.
        """
        plan = MOTIONS[self.name].plan(limits, random, duration_s=self._bounded_s(limits))
        segments = list(plan.segments)
        away_m = sum(segment.distance_m for segment in segments)
        if abs(away_m) > _AT_HOME_M:
            rapid = (limits.rapid_m_s, limits.acceleration_m_s2, limits.jerk_m_s3)
            segments += [Move(-away_m, *rapid), Dwell(_HOME_REST_S)]
        count = sum(samples_of(segment, rate_hz) for segment in segments)
        return CommandedMotion(self.name, Setpoints(iter(segments), limits.low_m, rate_hz), count)

    def _bounded_s(self, limits: MotionLimits) -> float | None:
        """The duration, s; None for a motion that runs to its own end."""
        if self.duration_s is None and MOTIONS[self.name].duration_s(limits) is None:
            return ENDLESS_DURATION_S
        return self.duration_s


def _duration(name: str, text: str) -> float:
    key, _, number = text.partition("=")
    if key.strip() != "duration_s":
        raise MotionError(f"motion {name}: {text!r}, expected duration_s=SECONDS")
    try:
        return float(number)
    except ValueError:
        raise MotionError(f"motion {name}: duration_s: {number!r} is no number") from None
