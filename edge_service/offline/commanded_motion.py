"""Command to a simulated axis: a motion by its name, to its end or for a while."""

import math
from dataclasses import dataclass

import numpy as np

from ..models.motions.registry import MOTIONS, Dwell, MotionError, MotionLimits, Move, Setpoints
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


def parse_motion(text: str, duration_s: float | None = None) -> tuple[str, float | None]:
    """Name and duration of NAME or NAME:duration_s=SECONDS; `duration_s` where it says none.

    Raises MotionError: no such motion, or no such duration.

    >>> parse_motion("warmup:duration_s=300")
    ('warmup', 300.0)
    """
    name, _, rest = text.partition(":")
    if name not in MOTIONS:
        raise MotionError(f"motion: {name!r} is not one of {', '.join(sorted(MOTIONS))}")
    if rest:
        key, _, number = rest.partition("=")
        if duration_s is not None:
            raise MotionError(f"motion {name}: has two durations; expected one")
        if key.strip() != "duration_s":
            raise MotionError(f"motion {name}: {rest!r}, expected duration_s=SECONDS")
        try:
            duration_s = float(number)
        except ValueError:
            raise MotionError(f"motion {name}: duration_s: {number!r} is no number") from None
    if duration_s is not None and not 0.0 < duration_s < math.inf:
        raise MotionError(f"duration: expected a time above 0 s, got {duration_s:g} s")
    return name, duration_s


def commanded_motion(
    name: str,
    duration_s: float | None,
    limits: MotionLimits,
    rate_hz: float,
    random: np.random.Generator,
    *,
    returns: bool = False,
) -> CommandedMotion:
    """The motion to its end, or for a duration and then no longer, even within a move.

    Args:
        returns: in whole moves, and then the way home, so that another can follow.

    Raises MotionError: the axis does not allow it, or it takes longer than the duration.
    """
    motion = MOTIONS[name]
    if duration_s is None and motion.duration_s(limits) is None:
        duration_s = ENDLESS_DURATION_S
    if duration_s is not None and not returns:
        count = max(round(duration_s * rate_hz), 1)
        setpoints = Setpoints(motion(limits, random), limits.low_m, rate_hz)
        return CommandedMotion(name, setpoints, count)
    if returns:
        segments = list(motion.plan(limits, random, duration_s=duration_s).segments)
        away_m = sum(segment.distance_m for segment in segments)
        if abs(away_m) > _AT_HOME_M:
            rapid = (limits.rapid_m_s, limits.acceleration_m_s2, limits.jerk_m_s3)
            segments += [Move(-away_m, *rapid), Dwell(_HOME_REST_S)]
    else:
        segments = list(motion(limits, random))
    count = sum(samples_of(segment, rate_hz) for segment in segments)
    return CommandedMotion(name, Setpoints(iter(segments), limits.low_m, rate_hz), count)
