"""Motions at 1 kHz, written as speeds: jerk-limited moves, tests, production."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STEP_S = 1e-3


def move(distance_m: float, speed_m_s: float, accel_m_s2: float, jerk_s: float = 0.03) -> Array:
    """Speeds (n,) of a seven-segment move: a trapezoid smeared over `jerk_s`."""
    length = abs(distance_m)
    peak = min(speed_m_s, np.sqrt(length * accel_m_s2))
    ramp = max(peak / accel_m_s2, 2 * STEP_S)
    total = length / peak + ramp
    t = np.arange(0.0, total + STEP_S, STEP_S)
    trapezoid = np.interp(t, [0.0, ramp, max(total - ramp, ramp), total], [0.0, peak, peak, 0.0])
    width = max(round(jerk_s / STEP_S), 1)
    smooth = np.convolve(trapezoid, np.ones(width) / width)
    return smooth * distance_m / (smooth.sum() * STEP_S)


def rest(duration_s: float) -> Array:
    return np.zeros(round(duration_s / STEP_S))


class Route:
    """Moves one after another; knows where it is."""

    def __init__(self, start_m: float) -> None:
        self.start_m = start_m
        self.here_m = start_m
        self.speeds: list[Array] = []

    def add(self, speeds: Array) -> "Route":
        self.speeds.append(speeds)
        self.here_m += float(speeds.sum()) * STEP_S
        return self

    def to(
        self, target_m: float, speed_m_s: float, accel_m_s2: float = 4.0, dwell_s: float = 0.2
    ) -> "Route":
        if abs(target_m - self.here_m) > 1e-9:
            self.add(move(target_m - self.here_m, speed_m_s, accel_m_s2))
        return self.add(rest(dwell_s))

    @property
    def duration_s(self) -> float:
        return sum(len(each) for each in self.speeds) * STEP_S

    def positions(self) -> Array:
        return self.start_m + np.r_[0.0, np.cumsum(np.concatenate(self.speeds)) * STEP_S]


def production(rng: np.random.Generator, duration_s: float, stroke_m: float = 0.8) -> Array:
    """Random work: rapids, feeds both ways, short fittings, pauses."""
    route = Route(rng.uniform(0.2, 0.6) * stroke_m)
    while route.duration_s < duration_s:
        low, high = 0.06 * stroke_m, 0.94 * stroke_m
        kind = rng.choice(4, p=[0.45, 0.25, 0.2, 0.1])
        accel = float(rng.choice([2.0, 3.5, 5.0]))
        if kind == 0:
            route.to(rng.uniform(low, high), rng.uniform(0.3, 0.6), accel, rng.uniform(0.1, 0.5))
        elif kind == 1:
            for _ in range(int(rng.integers(1, 4))):
                feed = float(np.exp(rng.uniform(np.log(0.008), np.log(0.15))))
                reach = min(rng.uniform(0.02, 0.25), feed * 3.0)
                way = 1.0 if route.here_m + reach < high else -1.0
                way = (
                    rng.choice([-1.0, 1.0])
                    if low < route.here_m - reach < high - 2 * reach
                    else way
                )
                route.to(
                    np.clip(route.here_m + way * reach, low, high),
                    feed,
                    accel,
                    rng.uniform(0.0, 0.2),
                )
        elif kind == 2:
            for _ in range(int(rng.integers(2, 6))):
                target = route.here_m + rng.choice([-1.0, 1.0]) * rng.uniform(0.002, 0.03)
                route.to(
                    np.clip(target, low, high),
                    rng.uniform(0.03, 0.2),
                    accel,
                    rng.uniform(0.05, 0.3),
                )
        else:
            route.add(rest(rng.uniform(0.5, 1.5)))
    return route.positions()[: round(duration_s / STEP_S)]


def part_programme(
    rng: np.random.Generator,
    duration_s: float,
    stroke_m: float = 0.8,
    pauses: tuple[tuple[float, float], ...] = (),
) -> Array:
    """One part made again and again: places, speeds and rests of its own; pauses (at_s, for_s)."""
    span = rng.uniform(0.3, 0.88) * stroke_m
    low = rng.uniform(0.06 * stroke_m, 0.94 * stroke_m - span)
    accel, rapid = float(rng.choice([2.0, 3.5, 5.0])), float(rng.uniform(0.3, 0.6))
    moves = []
    for _ in range(int(rng.integers(4, 9))):
        place = low + rng.uniform(0.0, span)
        moves.append((place, rapid * rng.uniform(0.7, 1.0), rng.uniform(0.1, 0.6)))
        for _ in range(int(rng.integers(1, 4))):
            feed = float(np.exp(rng.uniform(np.log(0.01), np.log(0.15))))
            reach = rng.choice([-1.0, 1.0]) * min(rng.uniform(0.01, 0.2), feed * 3.0)
            place = float(np.clip(place + reach, low, low + span))
            moves.append((place, feed, rng.uniform(0.05, 0.3)))
    route, left = Route(low + 0.5 * span), sorted(pauses)
    while route.duration_s < duration_s:
        for place, speed, dwell in moves:
            route.to(place, speed, accel, dwell)
            if left and route.duration_s >= left[0][0]:
                route.add(rest(left.pop(0)[1]))
            if route.duration_s >= duration_s:
                break
    return route.positions()[: round(duration_s / STEP_S)]


def commissioning(stroke_m: float = 0.8) -> Array:
    """All that a healthy, cold axis is asked once: speeds, places, accelerations (85 s)."""
    route = Route(0.1 * stroke_m).add(rest(1.0))
    for accel in (2.0, 5.0):
        for place in (0.12, 0.5, 0.88):
            route.to(place * stroke_m, 0.4, accel, 0.3)
            for way in (1, -1, 1, -1):
                route.to((place + (0.05 if way > 0 else -0.05)) * stroke_m, 0.3, accel, 0.1)
    for speed in (0.005, 0.02, 0.05, 0.1):
        for place in (0.12, 0.5, 0.85):
            reach = min(speed * 1.2, 0.06)
            route.to(place * stroke_m, 0.4, 4.0, 0.2)
            route.to(place * stroke_m + reach, speed, 4.0, 0.15).to(
                place * stroke_m, speed, 4.0, 0.15
            )
    for speed in (0.15, 0.3, 0.5, 0.6):
        route.to(0.94 * stroke_m, speed, 4.0, 0.3).to(0.06 * stroke_m, speed, 4.0, 0.3)
    return route.add(rest(0.5)).positions()


def jogs(rng: np.random.Generator, duration_s: float, at_m: float = 0.4) -> Array:
    """Tens of micrometres now and then, otherwise still."""
    route = Route(at_m)
    while route.duration_s < duration_s:
        step = float(rng.choice([-1.0, 1.0]) * rng.uniform(10e-6, 60e-6))
        route.to(
            float(np.clip(route.here_m + step, at_m - 1e-4, at_m + 1e-4)),
            0.005,
            1.0,
            rng.uniform(0.3, 2.0),
        )
    return route.positions()[: round(duration_s / STEP_S)]


def standstill(duration_s: float, at_m: float = 0.4) -> Array:
    return np.full(round(duration_s / STEP_S), at_m)
