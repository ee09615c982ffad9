"""Registry of the named motions, each within the limits of an axis."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from .axis_tests import acceleration, friction, reversals, signature, standstill
from .limits import MotionError, MotionLimits, motion_limits
from .route import Plan, Route, Segment, Setpoints
from .segments import Dwell, Move
from .shaking import chirp, multisine

__all__ = [
    "MOTIONS",
    "Dwell",
    "Motion",
    "MotionError",
    "MotionLimits",
    "Move",
    "Plan",
    "Segment",
    "Setpoints",
    "motion_limits",
    "production",
]

_WARMUP_REST_S = 0.1
_FULL_WARMUP_S = 120.0
_FULL_PRODUCTION_S = 60.0
_SLACK_S = 1e-6


@dataclass(frozen=True, slots=True)
class Motion:
    """A named motion; it starts at rest at `limits.low_m` and is fixed by its random generator.

    `draw` puts its segments on a route; a motion without end has a `source` of them instead.
    """

    name: str
    purpose: str  # one line
    draw: Callable[[Route, np.random.Generator], None] | None = None
    source: Callable[[MotionLimits, np.random.Generator], Iterator[Segment]] | None = None

    def __call__(self, limits: MotionLimits, random: np.random.Generator) -> Iterator[Segment]:
        """Its segments, without end if it has none; raises MotionError as `plan` does."""
        if self.source is not None:
            return self.source(limits, random)
        return iter(self.plan(limits, random).segments)

    def duration_s(self, limits: MotionLimits) -> float | None:
        """Its natural duration, s; None without end. Chance does not change it."""
        return None if self.draw is None else self.plan(limits).duration_s

    def plan(
        self,
        limits: MotionLimits,
        random: np.random.Generator | None = None,
        *,
        duration_s: float | None = None,
        clip: bool = False,
    ) -> Plan:
        """Its segments and, at the end, standing still until `duration_s`, if that is given.

        With `clip` what the axis does not allow is left out and named.

        Raises MotionError: the axis or the duration does not allow it.
        """
        random = random or np.random.default_rng(0)
        if self.draw is not None:
            route = Route(self.name, limits, clip=clip)
            self.draw(route, random)
            plan = route.finish()
            if duration_s is None:
                return plan
        elif duration_s is None:
            raise MotionError(f"{self.name}: does not end by itself; expected a duration")
        else:
            plan = self._within(duration_s, limits, random)
        left_s = duration_s - plan.duration_s
        if left_s < -_SLACK_S:
            raise MotionError(
                f"{self.name}: takes {plan.duration_s:.1f} s, "
                f"a duration of {duration_s:g} s would cut it"
            )
        return Plan((*plan.segments, Dwell(max(left_s, 0.0))), plan.left_out)

    def _within(self, duration_s: float, limits: MotionLimits, random: np.random.Generator) -> Plan:
        """Segments of a motion without end that are over within a duration."""
        segments: list[Segment] = []
        left_s = duration_s
        for segment in self(limits, random):
            if segment.duration_s > left_s:
                break
            segments.append(segment)
            left_s -= segment.duration_s
        if not segments:
            raise MotionError(f"{self.name}: its first move takes longer than {duration_s:g} s")
        return Plan(tuple(segments))


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


def full(route: Route, random: np.random.Generator) -> None:
    """The full protocol: each axis test, a warm-up, and the signature once more, warm.

    A cold and a warm pass tell growth from lead errors; production at the end is for checking.
    """
    for draw in (standstill, reversals, signature, friction, acceleration, chirp, multisine):
        draw(route, random)
    route.go_to(route.limits.low_m)
    _run_for(route, MOTIONS["warmup"], random, _FULL_WARMUP_S)
    signature(route, random)
    route.go_to(route.limits.low_m)
    _run_for(route, MOTIONS["production"], random, _FULL_PRODUCTION_S)


def _run_for(route: Route, motion: Motion, random: np.random.Generator, duration_s: float) -> None:
    for segment in motion.plan(route.limits, random, duration_s=duration_s).segments:
        route.add(segment)


_MOTIONS = (
    Motion("standstill", "rest after either approach: tilt against friction", standstill),
    Motion("reversals", "20 um to 2 mm at three positions: backlash, presliding", reversals),
    Motion("friction", "ten speeds of Table 5.1, both ways: friction curve", friction),
    Motion("signature", "20 revolutions and more, both ways: order spectrum", signature),
    Motion("acceleration", "three accelerations along the stroke: stiffness", acceleration),
    Motion("chirp", "5 to 300 Hz on a slow feed: frequency response", chirp),
    Motion("multisine", "every hertz from 5 to 300 Hz: frequency response", multisine),
    Motion("warmup", "rapids from end to end: a warm axis", source=warmup),
    Motion("production", "rapids, feeds, steps and dwells: everyday load", source=production),
    Motion("full", "all tests, a warm-up, the signature again, production", full),
)

MOTIONS: dict[str, Motion] = {motion.name: motion for motion in _MOTIONS}
"""Named motions, in the order in which an axis is tested."""
