"""Tests of the frequency response: a vibration on a slow feed through mid-stroke, both ways."""

import math
from dataclasses import replace

import numpy as np

from .excitation import Chirp, Multisine, Shaken, Wave, faded_peaks, low_crest_phases
from .route import Route
from .segments import Move, rise_time

LOWEST_HZ, HIGHEST_HZ = 5.0, 300.0
CHIRP_S = 20.0
MULTISINE_PERIOD_S = 1.0
MULTISINE_PERIODS = 10
FADE_S = 0.5

_FEED_M_S = 0.02
_SHAKEN_M_S2 = 2.0
_SHARE_OF_FEED = 0.8
"""Greatest speed of the vibration: below the feed, so the axis never turns back."""
_STROKE_SHARE = 0.9
_REST_S = 0.5


def chirp(route: Route, random: np.random.Generator) -> None:
    """A logarithmic sweep from 5 to 300 Hz in 20 s, each way."""
    corner_hz = _SHAKEN_M_S2 / (2.0 * math.pi * _SHARE_OF_FEED * _FEED_M_S)
    for way in (1.0, -1.0):
        _shake(route, way, Chirp(LOWEST_HZ, HIGHEST_HZ, corner_hz, _SHAKEN_M_S2, CHIRP_S))


def multisine(route: Route, random: np.random.Generator) -> None:
    """Every whole hertz from 5 to 300 Hz at equal acceleration, ten periods of 1 s, each way.

    Each way has phases of its own; the periods lie between two fades of 0.5 s.
    """
    first, last = LOWEST_HZ * MULTISINE_PERIOD_S, HIGHEST_HZ * MULTISINE_PERIOD_S
    harmonics = np.arange(round(first), round(last) + 1, dtype=np.float64)
    duration_s = MULTISINE_PERIODS * MULTISINE_PERIOD_S + 2.0 * FADE_S
    for way in (1.0, -1.0):
        phases = low_crest_phases(harmonics, random)
        _shake(route, way, Multisine(harmonics, phases, 1.0, MULTISINE_PERIOD_S, duration_s))


def _shake(route: Route, way: float, wave: Wave) -> None:
    """One way through mid-stroke, with the wave as strong as feed, acceleration and torque allow.

    The feed is slower where the stroke is short.
    """
    limits = route.limits
    feed = min(
        _FEED_M_S,
        limits.rapid_m_s / (1.0 + _SHARE_OF_FEED),
        _STROKE_SHARE * limits.span_m / wave.duration_s,
    )
    rise_s = rise_time(feed, limits.acceleration_m_s2, limits.jerk_m_s3)
    length = feed * (rise_s + wave.duration_s)
    if not route.accepts("feed", speed_m_s=feed, length_m=length):
        return
    speed, acceleration = faded_peaks(wave, FADE_S)
    share = min(_SHAKEN_M_S2, limits.acceleration_m_s2) / acceleration
    share = min(_SHARE_OF_FEED * feed / speed, share)
    wave = replace(wave, acceleration_m_s2=share * wave.acceleration_m_s2)
    route.go_to(limits.low_m + 0.5 * (limits.span_m - way * length))
    route.rest(_REST_S)
    carrier = Move(way * length, feed, limits.acceleration_m_s2, limits.jerk_m_s3)
    route.add(Shaken(carrier, wave, FADE_S))
    route.rest(_REST_S)
