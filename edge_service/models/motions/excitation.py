"""Small vibrations on top of a slow feed, for the frequency response of an axis.

The feed never turns back, so the dry friction stays constant and drops out of the response
(Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., 2012, ch. 5).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...messages.samples import Floats
from .segments import Move

Complexes = NDArray[np.complex128]

_OVERSAMPLING = 16
_CREST_OVERSAMPLING = 4
_SWEEPS = 150
_CLIP_FIRST, _CLIP_LAST = 0.75, 0.97
_STEEPEST, _SHARPEST = 15.0 / 8.0, 10.0 / math.sqrt(3.0)  # |s'|, |s''| of 6u^5 - 15u^4 + 10u^3


@dataclass(frozen=True, slots=True)
class Chirp:
    """A logarithmic sweep, x = X(f) sin(phi), phi' = 2 pi f, f = low (high / low)^(t / T).

    The acceleration amplitude is flat above the corner, and the speed amplitude below it::

        X(f) = A / ((2 pi)^2 f sqrt(f^2 + corner^2))
    """

    low_hz: float
    high_hz: float
    corner_hz: float
    acceleration_m_s2: float  # A; the speed amplitude is A / (2 pi corner)
    duration_s: float

    @property
    def growth_per_s(self) -> float:
        """r = f' / f, 1/s."""
        return math.log(self.high_hz / self.low_hz) / self.duration_s

    @property
    def peaks(self) -> tuple[float, float, float]:
        """Bounds of travel m, speed m/s, acceleration m/s^2.

        With the amplitude's own change: |X'| <= 2 r X, |X''| <= 4.5 r^2 X, phi'' = r phi'.
        """
        acceleration, corner = self.acceleration_m_s2, self.corner_hz
        slowness = self.growth_per_s / (2.0 * math.pi * self.low_hz)
        travel = acceleration / (4.0 * math.pi**2 * self.low_hz * math.hypot(self.low_hz, corner))
        speed = acceleration / (2.0 * math.pi * corner) * (1.0 + 2.0 * slowness)
        return travel, speed, acceleration * (1.0 + 5.0 * slowness + 4.5 * slowness**2)

    def frequency_hz(self, time_s: Floats) -> Floats:
        """Frequency at times (n,), Hz."""
        return self.low_hz * np.exp(self.growth_per_s * time_s)

    def motion(self, time_s: Floats) -> Floats:
        """Travel m, speed m/s, acceleration m/s^2 at times (n,) since its start, (n, 3)."""
        r, f = self.growth_per_s, self.frequency_hz(time_s)
        share = f**2 / (f**2 + self.corner_hz**2)
        amplitude = self.acceleration_m_s2 * np.sqrt(share) / (2.0 * math.pi * f) ** 2
        change = -r * (1.0 + share)
        slope = amplitude * change
        curvature = amplitude * (change**2 - 2.0 * r**2 * share * (1.0 - share))
        omega = 2.0 * math.pi * f
        phase = (omega - 2.0 * math.pi * self.low_hz) / r
        sine, cosine = np.sin(phase), np.cos(phase)
        speed = slope * sine + amplitude * omega * cosine
        acceleration = (curvature - amplitude * omega**2) * sine
        acceleration += (2.0 * slope + r * amplitude) * omega * cosine
        return np.column_stack((amplitude * sine, speed, acceleration))


@dataclass(frozen=True, slots=True, eq=False)
class Multisine:
    """Lines of equal acceleration amplitude, x'' = sum of A cos(2 pi f t + phase), periodic."""

    harmonics: Floats  # f times the period, increasing whole numbers from 1, (n_lines,)
    phases_rad: Floats  # (n_lines,)
    acceleration_m_s2: float  # A of each line
    period_s: float  # after which it repeats
    duration_s: float

    @property
    def lines_hz(self) -> Floats:
        """Frequencies of the lines, Hz, (n_lines,)."""
        return self.harmonics / self.period_s

    @property
    def peaks(self) -> tuple[float, float, float]:
        """Bounds of travel m, speed m/s, acceleration m/s^2.

        A trigonometric polynomial of degree n is at most its largest sample over N equal steps of
        the period, over cos(pi n / N) (Ehlich and Zeller, 1964).
        """
        omega = 2.0 * math.pi * self.lines_hz
        lines = self.acceleration_m_s2 * np.exp(1j * self.phases_rad)
        factor = 1.0 / math.cos(math.pi / _OVERSAMPLING)
        travel, speed, acceleration = (
            factor * float(np.abs(_one_period(self.harmonics, each, _OVERSAMPLING)).max())
            for each in (-lines / omega**2, -1j * lines / omega, lines)
        )
        return travel, speed, acceleration

    def motion(self, time_s: Floats) -> Floats:
        """Travel m, speed m/s, acceleration m/s^2 at times (n,) since its start, (n, 3)."""
        omega = 2.0 * math.pi * self.lines_hz
        angle = np.outer(time_s, omega) + self.phases_rad
        cosine = np.cos(angle)
        return self.acceleration_m_s2 * np.column_stack(
            (-cosine @ omega**-2, np.sin(angle) @ (1.0 / omega), cosine.sum(axis=1))
        )


Wave = Chirp | Multisine
"""A vibration about a position."""


def low_crest_phases(harmonics: Floats, random: np.random.Generator) -> Floats:
    """Phases of equal lines with a low peak, rad, (n_lines,), from a random start.

    Clipping in time and restoring the lines in frequency, by turns (Van der Ouderaa, Schoukens and
    Renneboog, IEEE Trans. Instrum. Meas. 37, 1988); the best of all turns.
    """
    index = harmonics.astype(np.int64)
    phases: Floats = random.uniform(-math.pi, math.pi, len(index))
    best, lowest = phases, math.inf
    for clip in np.linspace(_CLIP_FIRST, _CLIP_LAST, _SWEEPS):
        signal = _one_period(harmonics, np.exp(1j * phases), _CREST_OVERSAMPLING)
        peak = float(np.abs(signal).max())
        if peak < lowest:
            best, lowest = phases, peak
        phases = np.angle(np.fft.rfft(np.clip(signal, -clip * peak, clip * peak))[index])
    return best


def _one_period(harmonics: Floats, lines: Complexes, oversampling: int) -> Floats:
    """Sum of Re(line exp(i h u)) over one period, `oversampling` times the highest h, (n,)."""
    count = oversampling * int(harmonics[-1])
    spectrum = np.zeros(count // 2 + 1, np.complex128)
    spectrum[harmonics.astype(np.int64)] = 0.5 * count * lines
    return np.fft.irfft(spectrum, count)


@dataclass(frozen=True, slots=True)
class Shaken:
    """A move with a wave in its cruise, faded in and out over `fade_s`.

    The cruise is as long as the wave or longer, and faster than the wave, so it never turns back.
    """

    carrier: Move
    wave: Wave
    fade_s: float

    @property
    def duration_s(self) -> float:
        """Time until rest, s."""
        return self.carrier.duration_s

    @property
    def distance_m(self) -> float:
        """Signed travel from start to end, m: that of the carrier."""
        return self.carrier.distance_m

    @property
    def wave_starts_s(self) -> float:
        """Begin of the cruise and of the wave, s."""
        jerk_s, hold_s, _cruise_s = self.carrier.phases_s
        return 2.0 * jerk_s + hold_s

    @property
    def peak_speed_m_s(self) -> float:
        """Bound of the speed's magnitude, m/s."""
        return self.carrier.peak_speed_m_s + faded_peaks(self.wave, self.fade_s)[0]

    @property
    def peak_acceleration_m_s2(self) -> float:
        """Bound of the acceleration's magnitude, m/s^2."""
        shaking = faded_peaks(self.wave, self.fade_s)[1]
        return max(self.carrier.peak_acceleration_m_s2, shaking)

    def setpoints(self, time_s: Floats) -> Floats:
        """Travel m, speed m/s and acceleration m/s^2 at times (n,) since its start, (n, 3)."""
        setpoints = self.carrier.setpoints(time_s)
        since = time_s - self.wave_starts_s
        inside = (since >= 0.0) & (since <= self.wave.duration_s)
        setpoints[inside] += self._faded(since[inside])
        return setpoints

    def _faded(self, time_s: Floats) -> Floats:
        """The wave times its window w, by the product rule, at times (n,) since its start."""
        x, v, a = self.wave.motion(time_s).T
        left_s = self.wave.duration_s - time_s
        fading_out = left_s < time_s
        u = np.minimum(np.minimum(time_s, left_s) / self.fade_s, 1.0)
        window = u**3 * (10.0 + u * (6.0 * u - 15.0))
        slope = 30.0 * (u * (1.0 - u)) ** 2 / self.fade_s * np.where(fading_out, -1.0, 1.0)
        curvature = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / self.fade_s**2
        acceleration = window * a + 2.0 * slope * v + curvature * x
        return np.column_stack((window * x, window * v + slope * x, acceleration))


def faded_peaks(wave: Wave, fade_s: float) -> tuple[float, float]:
    """Bounds of speed m/s and acceleration m/s^2 of a wave that is faded in and out."""
    travel, speed, acceleration = wave.peaks
    steep, sharp = _STEEPEST / fade_s, _SHARPEST / fade_s**2
    return speed + steep * travel, acceleration + 2.0 * steep * speed + sharp * travel
