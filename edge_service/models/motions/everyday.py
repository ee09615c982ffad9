"""Motions without an end: production and warm-up."""

import math
from collections.abc import Iterator

import numpy as np

from .limits import MotionLimits
from .segments import Dwell, Move, Segment

_WARMUP_REST_S = 0.1


def production(limits: MotionLimits, random: np.random.Generator) -> Iterator[Segment]:
    """Endless production-like motion: rapids, feeds and short steps with dwells between.

    Feeds run at 2 to 20 % of the rapid speed over 2 to 20 % of the stroke.
    """
    position = limits.low_m
    while True:
        kind = random.choice(3, p=(0.5, 0.35, 0.15))
        speed = limits.rapid_m_s
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


def warmup(limits: MotionLimits, random: np.random.Generator) -> Iterator[Segment]:
    """Endless rapids from end to end of the stroke, and back."""
    rapid = (limits.rapid_m_s, limits.acceleration_m_s2, limits.jerk_m_s3)
    while True:
        yield Move(limits.span_m, *rapid)
        yield Dwell(_WARMUP_REST_S)
        yield Move(-limits.span_m, *rapid)
        yield Dwell(_WARMUP_REST_S)
