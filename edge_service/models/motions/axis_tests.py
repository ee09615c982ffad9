"""Tests of an axis made of moves and dwells (5.2.1)."""

import math

import numpy as np

from .limits import MotionLimits
from .route import Route
from .segments import rise_time

FRICTION_SPEEDS_RPM = (15.0, 30.0, 60.0, 120.0, 150.0, 300.0, 600.0, 1200.0, 1500.0, 3000.0)
"""Table 5.1: speeds of the screw; at the test bench's lead of 20 mm 5 mm/s to 1 m/s."""
STATIONS = 3
"""Positions along the stroke: what varies along it is told from what varies with speed."""
SETTLE_S = 0.1
"""Cruise before a measurement: ten time constants of a position loop of 15 Hz."""
_SHORT_REST_S = 0.2

_FRICTION_CRUISE_S = 2.0

SIGNATURE_SPEEDS_RPM = (120.0, 300.0, 600.0)
SIGNATURE_REVOLUTIONS = 20
MOST_SIGNATURE_REVOLUTIONS = 40

ACCELERATION_SHARES = (0.25, 0.5, 1.0)
ACCELERATION_SECTIONS = 5
_LEAST_HOLD_S = 0.02

REVERSALS_M = (20e-6, 60e-6, 200e-6, 600e-6, 2e-3)
_REVERSAL_APPROACH_M = 5e-3
_REVERSAL_REST_S = 0.3
_GENTLE_M_S, _GENTLE_M_S2, _GENTLE_M_S3 = 5e-3, 0.2, 20.0  # slow against the position loop

STANDSTILL_S = 2.0
_STANDSTILL_APPROACH_M = 10e-3
_STANDSTILL_M_S = 20e-3


def friction(route: Route, random: np.random.Generator) -> None:
    """Constant speeds of Table 5.1, both ways, over whole revolutions of the screw.

    Each speed is run at three positions where three such runs fit beside one another.
    """
    limits = route.limits
    for rpm in FRICTION_SPEEDS_RPM:
        speed = rpm / 60.0 * limits.lead_m
        if not _accepts_revolutions(route, rpm, 1):
            continue
        wanted = max(math.ceil(_FRICTION_CRUISE_S * rpm / 60.0 - 1e-9), 1)
        revolutions = min(wanted, revolutions_within(limits, speed))
        length = run_length(limits, speed, revolutions)
        for centre_m in _stations(limits, STATIONS if STATIONS * length <= limits.span_m else 1):
            _back_and_forth(route, centre_m, length, speed)


def signature(route: Route, random: np.random.Generator) -> None:
    """Constant speeds over as many whole revolutions as the stroke holds, 20 to 40."""
    limits = route.limits
    for rpm in SIGNATURE_SPEEDS_RPM:
        if _accepts_revolutions(route, rpm, SIGNATURE_REVOLUTIONS):
            speed = rpm / 60.0 * limits.lead_m
            turns = min(revolutions_within(limits, speed), MOST_SIGNATURE_REVOLUTIONS)
            length = run_length(limits, speed, turns)
            _back_and_forth(route, limits.low_m + 0.5 * limits.span_m, length, speed)


def acceleration(route: Route, random: np.random.Generator) -> None:
    """Constant acceleration and deceleration in each section of the stroke, both ways."""
    limits = route.limits
    section_m = limits.span_m / ACCELERATION_SECTIONS
    for share in ACCELERATION_SHARES:
        level = share * limits.acceleration_m_s2
        jerk_s = level / limits.jerk_m_s3
        reached = level * (jerk_s + _LEAST_HOLD_S)
        least_m = reached * (2.0 * jerk_s + _LEAST_HOLD_S)
        if not route.accepts(
            f"{level:.3g} m/s2 held for {_LEAST_HOLD_S:g} s in {ACCELERATION_SECTIONS} sections",
            speed_m_s=reached,
            acceleration_m_s2=level,
            length_m=ACCELERATION_SECTIONS * least_m,
        ):
            continue
        edges = limits.low_m + section_m * np.arange(ACCELERATION_SECTIONS + 1)
        route.go_to(limits.low_m)
        for target in (*edges[1:], *edges[-2::-1]):
            route.rest(_SHORT_REST_S)
            route.move(float(target) - route.position_m, max(limits.rapid_m_s, reached), level)
    if route.segments:
        route.rest(_SHORT_REST_S)


def reversals(route: Route, random: np.random.Generator) -> None:
    """Steps back and forth of 20 um to 2 mm after an approach from either side."""
    if not route.accepts("approaches", length_m=2.0 * STATIONS * _REVERSAL_APPROACH_M):
        return
    for station_m in _stations(route.limits, STATIONS):
        for way in (1.0, -1.0):
            route.go_to(station_m - way * _REVERSAL_APPROACH_M)
            _gentle_move(route, way * _REVERSAL_APPROACH_M)
            for step_m in REVERSALS_M:
                _gentle_move(route, -way * step_m)
                _gentle_move(route, way * step_m)


def standstill(route: Route, random: np.random.Generator) -> None:
    """Two seconds of rest after an approach from either side.

    The torque at rest lies within the friction of either side of what a tilt or a load holds, so
    the pair tells a constant load from friction that depends on the direction.
    """
    if not route.accepts("approaches", length_m=2.0 * STATIONS * _STANDSTILL_APPROACH_M):
        return
    speed = min(_STANDSTILL_M_S, route.limits.rapid_m_s)
    for station_m in _stations(route.limits, STATIONS):
        for way in (1.0, -1.0):
            route.go_to(station_m - way * _STANDSTILL_APPROACH_M)
            route.move(station_m - route.position_m, speed)
            route.rest(STANDSTILL_S)


def run_length(limits: MotionLimits, speed_m_s: float, revolutions: int) -> float:
    """Travel of a move whose cruise settles and then turns the screw `revolutions` times, m."""
    rise_s = rise_time(speed_m_s, limits.acceleration_m_s2, limits.jerk_m_s3)
    return speed_m_s * (rise_s + SETTLE_S) + revolutions * limits.lead_m


def revolutions_within(limits: MotionLimits, speed_m_s: float) -> int:
    """Whole revolutions of settled cruise that the stroke holds."""
    free_m = limits.span_m - run_length(limits, speed_m_s, 0)
    return math.floor(free_m / limits.lead_m + 1e-9)


def _accepts_revolutions(route: Route, rpm: float, revolutions: int) -> bool:
    limits = route.limits
    speed = rpm / 60.0 * limits.lead_m
    rise_s = rise_time(speed, limits.acceleration_m_s2, limits.jerk_m_s3)
    return route.accepts(
        f"{rpm:g} r/min over {revolutions} rev",
        speed_m_s=speed,
        acceleration_m_s2=min(limits.acceleration_m_s2, 2.0 * speed / rise_s),
        length_m=run_length(limits, speed, revolutions),
    )


def _stations(limits: MotionLimits, count: int) -> list[float]:
    """Middles of `count` equal parts of the stroke, m."""
    return [limits.low_m + (i + 0.5) / count * limits.span_m for i in range(count)]


def _back_and_forth(route: Route, centre_m: float, length_m: float, speed_m_s: float) -> None:
    route.go_to(max(centre_m - 0.5 * length_m, route.limits.low_m))
    route.rest(_SHORT_REST_S)
    for way in (1.0, -1.0):
        route.move(way * length_m, speed_m_s)
        route.rest(_SHORT_REST_S)


def _gentle_move(route: Route, distance_m: float) -> None:
    limits = route.limits
    route.move(
        distance_m,
        min(_GENTLE_M_S, limits.rapid_m_s),
        min(_GENTLE_M_S2, limits.acceleration_m_s2),
        min(_GENTLE_M_S3, limits.jerk_m_s3),
    )
    route.rest(_REVERSAL_REST_S)
