"""Motor speed over torque of two masses with a spring, as a recording shows it (5.3.19-5.3.21)."""

import math
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from ...messages.samples import Floats
from .frequency_response import Complexes, FrequencyResponse, sampling_correction


class TwoMasses(NamedTuple):
    """Two masses with the spring that lies where the motor stands at `place_rad`.

    Attributes:
        inertia: J1 + J2 at the motor, kg m^2.
        antiresonance: w_a / 2 pi of the table against a motor that is held, Hz.
        damping: damping ratio of that, 1.
        ratio: w_r / w_a = sqrt((J1 + J2) / J1), 1.
        delay: of the torque path, s.
        viscous: D between motor and ground, N m s/rad.
        slope: relative change of the compliance per turn of the motor, 1/rad.
    """

    inertia: float
    antiresonance: float
    damping: float
    ratio: float
    delay: float
    viscous: float
    slope: float = 0.0

    def at(self, turned_rad: Floats) -> tuple[Floats, Floats, Floats]:
        """w_r in rad/s, its damping ratio, and 1 / w_a^2 - 1 / w_r^2 in s^2, in that shape.

        The compliance C is linear along the stroke (5.3.9): w ~ C^-1/2 and, with one damper, the
        damping ratio ~ C^1/2.
        """
        softness = np.maximum(1.0 + self.slope * turned_rad, 1e-3)
        notch = 2.0 * math.pi * self.antiresonance / np.sqrt(softness)
        damping = np.minimum(self.damping * self.ratio * np.sqrt(softness), 1.0 - 1e-6)
        return notch * self.ratio, damping, (1.0 - self.ratio**-2) / notch**2

    def flexible(self, s: Complexes, turned_rad: Floats) -> Complexes:
        """J times what the spring adds to 1 / (J s): s (1/w_a^2 - 1/w_r^2) / D(s); broadcast."""
        peak, damping, share = self.at(turned_rad)
        added: Complexes = share * s / ((s / peak) ** 2 + 2.0 * damping * s / peak + 1.0)
        return added

    def slowed(self, s: Complexes, flexible: Complexes) -> Complexes:
        """Factor that viscous friction applies to `flexible`: it brakes the spring too.

        With d = D / J and N / D(s) = 1 + s flexible, 1 / (J s D(s) / N + D) less 1 / (J s + D) is
        flexible / J over (1 + d/s) (1 + d/s N/D(s)).
        """
        drop = self.viscous / self.inertia / s
        factor: Complexes = 1.0 / ((1.0 + drop) * (1.0 + drop * (1.0 + s * flexible)))
        return factor

    def speed_over_torque(self, frequency_hz: Floats, turned_rad: float = 0.0) -> Complexes:
        """Without sampling, rad/(s N m), (n,): N / (J s D(s) + D N) exp(-s T)."""
        s = (2j * math.pi * frequency_hz).astype(np.complex128)
        flexible = self.flexible(s, np.array(turned_rad))
        rigid = 1.0 / (s + self.viscous / self.inertia)
        whole = rigid + flexible * self.slowed(s, flexible)
        response: Complexes = whole / self.inertia * np.exp(-s * self.delay)
        return response


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """View of a model in responses at n frequencies: sampled, windowed, and averaged over the way.

    A Hann window's power spectrum has a variance of a third of a bin squared, as the weights 1/6,
    2/3, 1/6 of neighbouring bins have; unless it is allowed for, a resonance seems to be damped
    more. So does one that moves with the nut: two places a standard deviation before and behind the
    mean one stand for the way.

    Attributes:
        s: at the frequencies, and behind them at those a bin below and above, (k n,), 1/s.
        differences: what turns the angle to a held torque into speed, (k n,).
        turned_rad: of the places from the middle one, (2, k n).
        period_s: of the samples; 0 where the torque is continuous.
    """

    s: Complexes
    differences: Complexes
    turned_rad: Floats
    period_s: float
    count: int

    @classmethod
    def of(cls, measured: FrequencyResponse, centre_rad: float) -> Self:
        """The sight of a measured response."""
        frequency, step = measured.frequency_hz, measured.resolution_hz
        parts = [frequency]
        if step > 0.0:
            parts += [np.maximum(frequency - step, 0.5 * frequency), frequency + step]
        s = (2j * math.pi * np.concatenate(parts)).astype(np.complex128)
        period_s = measured.period_s
        differences: Complexes = np.ones(len(s), dtype=np.complex128)
        if period_s > 0.0:
            corrected = sampling_correction(np.concatenate(parts), period_s)
            differences = corrected * (1.0 - np.exp(-s * period_s)) / period_s
        turned = np.zeros((2, len(frequency)))
        if len(measured.place_rad):
            turned += measured.place_rad - centre_rad
            turned += measured.spread_rad * np.array([[-1.0], [1.0]])
        return cls(s, differences, np.tile(turned, len(parts)), period_s, len(frequency))

    def response(self, model: TwoMasses) -> Complexes:
        """Response that a measurement without noise would give, rad/(s N m), (n,)."""
        flexible = model.flexible(self.s, self.turned_rad)
        seen = flexible if self.period_s == 0.0 else self._held(model)
        slowed = np.mean(seen * model.slowed(self.s, flexible), axis=0)
        rigid = 1.0 / (self.s + model.viscous / model.inertia)
        whole: Complexes = (rigid + slowed) / model.inertia * np.exp(-self.s * model.delay)
        if len(whole) == self.count:
            return whole
        at, below, above = whole.reshape(3, self.count)
        windowed: Complexes = (below + 4.0 * at + above) / 6.0
        return windowed

    def _held(self, model: TwoMasses) -> Complexes:
        """`flexible` as differences of the angle to a held torque show it, (2, k n)."""
        peak, damping, share = model.at(self.turned_rad)
        z = np.exp(self.s * self.period_s)
        decay = np.exp(-damping * peak * self.period_s)
        root = np.sqrt(1.0 - damping**2)
        turn = peak * root * self.period_s
        cosine, lag = np.cos(turn), damping / root * np.sin(turn)
        b1 = 1.0 - decay * (cosine + lag)
        b2 = decay**2 + decay * (lag - cosine)
        held = share * (b1 * z + b2) / ((z - 2.0 * decay * cosine) * z + decay**2)
        seen: Complexes = self.differences * held
        return seen
