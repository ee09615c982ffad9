"""A simulated accelerometer on the nut: balls that pass, and a raceway that is damaged.

The passing balls give a tone at their order; a pit in the nut's raceway is struck by every ball and
makes the structure ring at its resonance, as in bearings (Harris and Kotzalas, Rolling Bearing
Analysis, 2006). Both grow with the speed.
"""

import math
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats, Waveform

SENSOR, UNIT = "nut_acceleration", "m/s^2"
REFERENCE_SPEED_RAD_S = 50.0
"""Screw speed at which the amplitudes are stated."""


@dataclass(frozen=True, slots=True)
class AccelerometerSettings:
    """Amplitudes in m/s^2 at REFERENCE_SPEED_RAD_S."""

    rate_hz: float = 10_000.0
    ball_pass_order: float = 9.56  # balls that pass a point of the nut per turn of the screw
    ball_pass: float = 0.5  # amplitude of the tone
    damage: float = 0.0  # first swing that one ball makes at the pit; 0 is a sound raceway
    noise: float = 0.2  # rms, at any speed
    resonance_hz: float = 3000.0  # of what rings
    damping_ratio: float = 0.04


class Accelerometer:
    """Follows the angle of the screw; any split of the angle gives equal values."""

    def __init__(self, settings: AccelerometerSettings, seed: int) -> None:
        self._settings = settings
        self._random = np.random.default_rng((seed, 2))
        # its impulse response is exp(-z w t) sin(w t) with a first swing of about 1
        omega = 2.0 * math.pi * settings.resonance_hz / settings.rate_hz
        radius = math.exp(-settings.damping_ratio * omega)
        numerator = np.array([0.0, radius * math.sin(omega)])
        denominator = np.array([1.0, -2.0 * radius * math.cos(omega), radius**2])
        self._filter = numerator, denominator
        self._state = np.zeros(2)
        self._sample = 0
        self._last: tuple[float, float] | None = None  # time and angle up to which it has come
        self._passed = 0.0

    def follow(self, time_s: Floats, angle_rad: Floats) -> Waveform:
        """The sensor's values up to the last time given; times and angles (n,) follow the last."""
        if self._last is None:
            self._last = (float(time_s[0]), float(angle_rad[0]))
            self._passed = self._balls(np.array([angle_rad[0]]))[0]
        knots_s = np.concatenate([[self._last[0]], time_s])
        knots_rad = np.concatenate([[self._last[1]], angle_rad])
        rate = self._settings.rate_hz
        end = math.floor(float(time_s[-1]) * rate + 1e-6) + 1
        self._sample = max(self._sample, math.ceil(knots_s[0] * rate - 1e-6))
        numbers = np.arange(self._sample, max(end, self._sample))
        sample_s = numbers / rate
        values = self._values(sample_s, knots_s, knots_rad)
        start_s = self._sample / rate
        self._sample += len(numbers)
        self._last = (float(time_s[-1]), float(angle_rad[-1]))
        return Waveform(SENSOR, UNIT, start_s, 1.0 / rate, values)

    def _values(self, sample_s: Floats, knots_s: Floats, knots_rad: Floats) -> Floats:
        from scipy.signal import lfilter  # 45 MB that an axis without this sensor does without

        settings = self._settings
        if len(sample_s) == 0:
            return np.empty(0)
        angle = np.interp(sample_s, knots_s, knots_rad)
        spans = np.diff(knots_s)
        speeds = np.divide(np.diff(knots_rad), spans, out=np.zeros_like(spans), where=spans > 0.0)
        where = np.clip(np.searchsorted(knots_s, sample_s, side="right") - 1, 0, len(speeds) - 1)
        share = np.abs(speeds[where]) / REFERENCE_SPEED_RAD_S
        tone = settings.ball_pass * share * np.sin(settings.ball_pass_order * angle)
        balls = self._balls(angle)
        struck = np.diff(np.concatenate([[self._passed], balls])) != 0.0
        self._passed = float(balls[-1])
        ringing, self._state = lfilter(
            *self._filter, settings.damage * share * struck, zi=self._state
        )
        noise = settings.noise * self._random.standard_normal(len(sample_s))
        return np.asarray(tone + ringing + noise, dtype=np.float64)

    def _balls(self, angle_rad: Floats) -> Floats:
        """Balls that have passed the pit."""
        return np.floor(self._settings.ball_pass_order * angle_rad / (2.0 * math.pi))
