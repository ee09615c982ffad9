"""Conditioning of uniformly sampled channels: low-pass, differences, decimation, noise.

Pure functions of series at one sampling period. All filters run forwards and backwards, so that
nothing is delayed.
"""

import math
from collections.abc import Iterable, Iterator

import numpy as np
from scipy import ndimage, signal

from ...messages.channels import ANGLE, TABLE_POSITION
from ...messages.samples import Floats, SampleFrame

CUTOFF_SHARE = 0.2
"""Of the sampling rate; a low-pass above it has no samples to work with."""
_DECIMATION_ORDER = 8
_DECIMATION_RIPPLE_DB = 0.05
_DECIMATION_PASS = 0.8
"""Chebyshev filter before decimation: the one of MATLAB's and scipy's `decimate`."""


def with_angle(
    frames: Iterable[SampleFrame] | SampleFrame, ratio_m_per_rad: float
) -> Iterator[SampleFrame]:
    """Frames with a motor angle; x / R_t stands in where there is no rotary encoder."""
    for frame in [frames] if isinstance(frames, SampleFrame) else frames:
        if ANGLE in frame.channels or TABLE_POSITION not in frame.channels:
            yield frame
        else:
            channels = dict(frame.channels)
            channels[ANGLE] = channels.pop(TABLE_POSITION) / ratio_m_per_rad
            yield SampleFrame(frame.time_s, channels)


def central_difference(values: Floats, period_s: float) -> Floats:
    """(x_{k-2} - 8 x_{k-1} + 8 x_{k+1} - x_{k+2}) / 12 T, (n,); shorter at the ends.

    It is right to (w T)^4 / 30. The difference of two neighbours, right to (w T)^2 / 6 only, makes
    the accelerations of a machine's moves too small by half a per mille, and an inertia too great.
    """
    rate = np.asarray(np.gradient(values, period_s), dtype=np.float64)
    outer, inner = values[4:] - values[:-4], values[3:-1] - values[1:-3]
    rate[2:-2] = (8.0 * inner - outer) / (12.0 * period_s)
    return rate


def low_pass(values: Floats, cutoff_hz: float, order: int, period_s: float) -> Floats:
    """Butterworth low-pass, forwards and backwards: zero phase, (n,)."""
    filtered: Floats = signal.sosfiltfilt(_low_pass_sos(cutoff_hz, order, period_s), values)
    return filtered


def decimate(values: Floats, factor: int) -> Floats:
    """Zero-phase Chebyshev low-pass, then every `factor`th row, (n,) or (n, p)."""
    filtered: Floats = signal.decimate(values, factor, axis=0, zero_phase=True)
    return filtered


def anti_alias(values: Floats, factor: int) -> Floats:
    """Zero-phase Chebyshev low-pass of `decimate` alone, (n,): all rows are kept."""
    filtered: Floats = signal.sosfiltfilt(_decimation_sos(factor), values)
    return filtered


def white_noise_rms(values: Floats) -> float:
    """Standard deviation of the white noise on a smooth series (n,).

    From fifth differences, which a motion of limited jerk leaves at 0 except where the jerk jumps;
    their median absolute value stands for sqrt(252) sigma, sqrt(sum of binomial(5, k)^2).
    """
    fifth = np.diff(values, 5)
    return float(np.median(np.abs(fifth)) / 0.6745 / math.sqrt(252.0)) if fifth.size else 0.0


def mean_of_held(values: Floats, samples: float) -> Floats:
    """Mean torque around each sample of a drive that holds its torque for a period, (n,).

    The commands shifted later by `samples`, a spline between them, and the mean over a period:
    1 - (w T)^2 / 24, which the second difference has.
    """
    shifted: Floats = ndimage.shift(values, samples, order=3, mode="nearest")
    shifted[1:-1] += np.diff(shifted, 2) / 24.0
    return shifted


def _low_pass_sos(cutoff_hz: float, order: int, period_s: float) -> Floats:
    half_rate_hz = 0.5 / period_s
    if cutoff_hz >= half_rate_hz:
        raise ValueError(
            f"cutoff_hz: {cutoff_hz:g} Hz is not below half of the sampling rate, "
            f"{half_rate_hz:g} Hz"
        )
    sos: Floats = signal.butter(order, cutoff_hz / half_rate_hz, output="sos")
    return sos


def _decimation_sos(factor: int) -> Floats:
    sos: Floats = signal.cheby1(
        _DECIMATION_ORDER, _DECIMATION_RIPPLE_DB, _DECIMATION_PASS / factor, output="sos"
    )
    return sos
