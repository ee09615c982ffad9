"""Test motions: what a diagnosis may ask an axis to do."""

import numpy as np
from numpy.typing import NDArray

from .motions import STEP_S, Route, production, rest

Array = NDArray[np.float64]
TABLE_5_1_M_S = (0.005, 0.01, 0.02, 0.04, 0.05, 0.1, 0.2, 0.4, 0.5, 1.0)
PLACES = (0.2, 0.5, 0.8)  # shares of the stroke


def staircase(route: Route, stroke_m: float) -> Route:
    """Table 5.1: ten speeds both ways, the slow ones at three places."""
    for place in PLACES:
        route.to(place * stroke_m, 0.4)
        for speed in TABLE_5_1_M_S[:6]:
            reach = max(min(1.3 * speed, 0.09), 0.006)
            route.to(place * stroke_m + reach, speed, 4.0, 0.15).to(
                place * stroke_m, speed, 4.0, 0.15
            )
    for speed in TABLE_5_1_M_S[6:]:
        route.to(0.05 * stroke_m, 0.4, 4.0, 0.2)
        route.to(0.95 * stroke_m, speed, 5.0, 0.2).to(0.05 * stroke_m, speed, 5.0, 0.2)
    return route


def reversals(route: Route, stroke_m: float) -> Route:
    """20 um, 200 um and 2 mm back and forth at three places."""
    for place in PLACES:
        route.to(place * stroke_m, 0.3, 3.0, 0.3)
        for size, speed in ((20e-6, 0.001), (200e-6, 0.003), (2e-3, 0.01)):
            for _ in range(2):
                route.to(place * stroke_m + size, speed, 0.5, 0.1).to(
                    place * stroke_m, speed, 0.5, 0.1
                )
    return route


def stands(route: Route, stroke_m: float) -> Route:
    """Two seconds of rest after either direction."""
    for start, end in ((0.4, 0.5), (0.6, 0.5)):
        route.to(start * stroke_m, 0.3).to(end * stroke_m, 0.05, 2.0, 2.0)
    return route


def accelerations(route: Route, stroke_m: float) -> Route:
    """The same speed reached gently and hard."""
    for accel in (1.5, 6.0):
        for place in (0.25, 0.75, 0.25, 0.75):
            route.to(place * stroke_m, 0.3, accel, 0.2)
    return route


def cruises(route: Route, stroke_m: float) -> Route:
    """More than twenty turns at one speed, both ways."""
    for speed in (0.1, 0.25, 0.6):
        route.to(0.05 * stroke_m, 0.4).to(0.95 * stroke_m, speed, 4.0, 0.2).to(
            0.05 * stroke_m, speed, 4.0, 0.2
        )
    return route


def chirp(route: Route, duration_s: float = 10.0) -> Route:
    """A sweep from 4 to 120 Hz at constant acceleration."""
    t = np.arange(round(duration_s / STEP_S)) * STEP_S
    hz = 4.0 * (120.0 / 4.0) ** (t / duration_s)
    phase = 2 * np.pi * np.cumsum(hz) * STEP_S
    window = np.clip(np.minimum(t, duration_s - t) / 0.3, 0.0, 1.0)
    speed = window * 1.5 / (2 * np.pi * hz) * np.sin(phase)
    return route.add(speed - window * speed.sum() / window.sum()).add(rest(0.3))


def full(rng: np.random.Generator, stroke_m: float) -> Array:
    route = Route(0.3 * stroke_m).add(rest(1.0))
    for part in (stands, reversals, staircase, accelerations, cruises):
        part(route, stroke_m)
    chirp(route)
    route.to(0.5 * stroke_m, 0.3)
    path = route.positions()
    work = production(rng, max(190.0 - route.duration_s, 20.0), stroke_m)
    bridge = Route(float(path[-1])).to(float(work[0]), 0.3).positions()
    return np.concatenate([path, bridge, work])


def stepped(rng: np.random.Generator, stroke_m: float) -> Array:
    del rng
    return staircase(Route(0.3 * stroke_m).add(rest(0.5)), stroke_m).positions()
