"""Two-mass fit of a measured drive response (the seed's second model, 5.3.19-5.3.21)."""

import math
from dataclasses import dataclass

import numpy as np

from ..messages.samples import Floats
from .frequency_response import Complexes, FrequencyResponse, sampling_correction
from .identified import Identified
from .profile import Unknown, fit_profiled

LEAST_ERROR = 0.01
"""A response is trusted to 1 % at best: friction and play bend it by that much."""
_BEYOND = 10.0
"""A resonance is searched up to this factor above the fastest frequency."""
_INERTIA, _NOTCH, _DAMPING, _RATIO, _DELAY = range(5)


@dataclass(frozen=True, slots=True, eq=False)
class TwoMassFit:
    """Inertias and resonance of the axis.

    Attributes:
        inertia: J1 + J2 at the motor, kg m^2.
        antiresonance: of the table against a motor that is held, w_a, Hz.
        resonance: of both against each other, w_r, Hz.
        antiresonance_damping, resonance_damping: damping ratios, 1.
        table_share: J2 / (J1 + J2) = 1 - (w_a / w_r)^2, 1.
        delay: of the torque path, s.
        reduced_chi2: 1 where the response scatters as its coherence says.
    """

    inertia: Identified
    antiresonance: Identified
    resonance: Identified
    antiresonance_damping: Identified
    resonance_damping: Identified
    table_share: Identified
    delay: Identified
    reduced_chi2: float
    _values: Floats

    def response(self, frequency_hz: Floats) -> Complexes:
        """The fitted motor speed over torque, without sampling, rad/(s N m), (n,)."""
        return _speed_over_torque(self._values, frequency_hz)


def fit_two_mass(measured: FrequencyResponse) -> TwoMassFit:
    """Fit omega / torque = 1 / (J s) N(s) / D(s) exp(-s T).

    N = s^2 / w_a^2 + 2 z s / w_a + 1 and D with w_r and z w_r / w_a, for one damper makes both. As
    J1 and J2 are not negative, w_r / w_a = sqrt((J1 + J2) / J1) is at least 1.

    Args:
        measured: of `drive_response`, within the frequencies to be fitted.

    Raises:
        ValueError: fewer than ten frequencies.
    """
    frequency = measured.frequency_hz
    if len(frequency) < 10:
        raise ValueError(f"{len(frequency)} coherent frequencies; a two-mass fit needs 10 or more")
    error = np.hypot(measured.relative_error, LEAST_ERROR)

    def residual(values: Floats) -> Floats:
        share = np.log(_windowed(values, measured) / measured.response) / error
        return np.concatenate((share.real, share.imag))

    fit = fit_profiled(residual, _unknowns(measured), _starts(measured))
    found = fit.parameters
    notch, damping, ratio = found["antiresonance"], found["damping"], found["ratio"]
    return TwoMassFit(
        inertia=found["inertia"],
        antiresonance=notch,
        resonance=_product(notch, ratio),
        antiresonance_damping=damping,
        resonance_damping=_product(damping, ratio),
        table_share=_table_share(ratio),
        delay=found["delay"],
        reduced_chi2=fit.reduced_chi2,
        _values=fit.values,
    )


def _unknowns(measured: FrequencyResponse) -> list[Unknown]:
    inertia = _low_frequency_inertia(measured)
    low_hz, high_hz = float(measured.frequency_hz[0]), float(measured.frequency_hz[-1])
    return [
        Unknown("inertia", inertia / 20.0, inertia * 20.0, "kg m^2", logarithmic=True),
        Unknown("antiresonance", low_hz, _BEYOND * high_hz, "Hz", logarithmic=True),
        Unknown("damping", 1e-3, 1.0, "1", logarithmic=True),
        Unknown("ratio", 1.0, 10.0, "1", floor=1.0),
        Unknown("delay", -5e-3, 2e-2, "s"),
    ]


def _starts(measured: FrequencyResponse) -> list[Floats]:
    """A notch where the response shows one, near the end of the band, and beyond it."""
    high_hz = float(measured.frequency_hz[-1])
    notches_hz = (_deepest_hz(measured), 0.5 * high_hz, high_hz, 0.5 * _BEYOND * high_hz)
    return [
        np.array([_low_frequency_inertia(measured), notch_hz, 0.05, ratio, 0.0])
        for notch_hz in notches_hz
        for ratio in (1.05, 1.5)
    ]


def _speed_over_torque(values: Floats, frequency_hz: Floats) -> Complexes:
    """1 / (J s) + s (1 / w_a^2 - 1 / w_r^2) / (J D), delayed: the same as 1 / (J s) N / D."""
    s = 2j * math.pi * frequency_hz
    peak, damping, share = _mode(values)
    flexible = share * s / ((s / peak) ** 2 + 2.0 * damping * s / peak + 1.0)
    response: Complexes = (1.0 / s + flexible) / values[_INERTIA] * np.exp(-s * values[_DELAY])
    return response


def _windowed(values: Floats, measured: FrequencyResponse) -> Complexes:
    """The model as a Hann window smooths it, (n,).

    The window's power spectrum has a variance of a third of a bin squared, as the weights 1/6, 2/3,
    1/6 of neighbouring bins have; unless it is allowed for, a resonance seems to be damped more.
    """
    frequency, step = measured.frequency_hz, measured.resolution_hz
    if step == 0.0:
        return _sampled(values, measured, frequency)
    below, above = np.maximum(frequency - step, 0.5 * frequency), frequency + step
    response: Complexes = (
        _sampled(values, measured, below)
        + 4.0 * _sampled(values, measured, frequency)
        + _sampled(values, measured, above)
    ) / 6.0
    return response


def _sampled(values: Floats, measured: FrequencyResponse, frequency_hz: Floats) -> Complexes:
    """The model as `drive_response` sees it: the flexible part's angle to a held torque, (n,).

    1 / D held over T is (b1 z + b2) / (z^2 + a1 z + a2) (Franklin, Powell and Workman, Digital
    Control of Dynamic Systems, 1998, table 4.3).
    """
    if not measured.hold:
        return _speed_over_torque(values, frequency_hz)
    s = 2j * math.pi * frequency_hz
    z = np.exp(s * measured.period_s)
    peak, damping, share = _mode(values)
    decay = math.exp(-damping * peak * measured.period_s)
    root = math.sqrt(max(1.0 - damping**2, 1e-12))
    turn = peak * root * measured.period_s
    lag = damping / root * math.sin(turn)
    b1 = 1.0 - decay * (math.cos(turn) + lag)
    b2 = decay**2 + decay * (lag - math.cos(turn))
    held = (b1 * z + b2) / (z**2 - 2.0 * decay * math.cos(turn) * z + decay**2)
    differenced = share * held * (1.0 - 1.0 / z) / measured.period_s
    flexible = differenced * sampling_correction(frequency_hz, measured.period_s, True)
    response: Complexes = (1.0 / s + flexible) / values[_INERTIA] * np.exp(-s * values[_DELAY])
    return response


def _mode(values: Floats) -> tuple[float, float, float]:
    """w_r in rad/s, its damping ratio, and 1 / w_a^2 - 1 / w_r^2 in s^2."""
    notch = 2.0 * math.pi * float(values[_NOTCH])
    ratio = float(values[_RATIO])
    damping = min(float(values[_DAMPING]) * ratio, 1.0 - 1e-6)
    return notch * ratio, damping, (1.0 - ratio**-2) / notch**2


def _low_frequency_inertia(measured: FrequencyResponse) -> float:
    """Inertia that the lowest quarter of the frequencies shows, kg m^2."""
    turning = 2.0 * math.pi * measured.frequency_hz * np.abs(measured.response)
    return float(np.median(1.0 / turning[: max(len(turning) // 4, 1)]))


def _deepest_hz(measured: FrequencyResponse) -> float:
    """Frequency where the response falls furthest below that of a rigid axis, Hz."""
    above_rigid = np.abs(measured.response) * measured.frequency_hz
    return float(measured.frequency_hz[np.argmin(above_rigid)])


def _product(first: Identified, second: Identified) -> Identified:
    """Product of two positive quantities in the unit of the first, with the bounds of both."""
    return Identified(
        first.value * second.value,
        first.low * second.low,
        first.high * second.high,
        first.unit,
        min(first.n_effective, second.n_effective),
        first.note or second.note,
    )


def _table_share(ratio: Identified) -> Identified:
    """J2 / (J1 + J2) = 1 - (w_r / w_a)^-2."""
    low, value, high = (1.0 - bound**-2 for bound in (ratio.low, ratio.value, ratio.high))
    return Identified(value, low, high, "1", ratio.n_effective, ratio.note)
