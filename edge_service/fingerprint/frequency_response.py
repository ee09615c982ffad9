"""Frequency response of the axis from chirp or multisine recordings.

The torque of a controlled axis holds its own noise fed back. With the commanded motion r recorded,
H = S_ry / S_ru is free of that bias (joint input-output method); without it H1 = S_uy / S_uu, which
noise on the input pulls down (Bendat and Piersol, Random Data, 2010, sections 6.1 and 9.2).
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import signal

from ..messages.channels import ANGLE, SETPOINT, TABLE_POSITION, TORQUE
from ..messages.samples import Floats, SampleFrame
from .uniform import UniformRun, uniform_runs

Complexes = npt.NDArray[np.complex128]

OVERLAP = 0.5
_WINDOW_AVERAGES = 0.95
"""Share of the half-overlapped Hann segments that are independent (Welch, 1967)."""


@dataclass(frozen=True, slots=True, eq=False)
class FrequencyResponse:
    """A response over frequency; only frequencies with excitation are in it.

    Attributes:
        frequency_hz: (n,).
        response: output over input, complex, (n,).
        relative_error: standard deviation of the response over its magnitude, (n,).
        coherence: share of the output's power that the reference explains, 0 to 1, (n,).
        averages: independent segments behind each value.
        unit: of the response.
        period_s: of the samples.
        hold: whether the response is that to a held torque, corrected for a rigid axis.
        resolution_hz: distance of the bins over which the window has smoothed; 0 is not at all.
    """

    frequency_hz: Floats
    response: Complexes
    relative_error: Floats
    coherence: Floats
    averages: float
    unit: str
    period_s: float
    hold: bool
    resolution_hz: float

    def within(self, low_hz: float, high_hz: float) -> "FrequencyResponse":
        """The part between two frequencies, both included."""
        keep = (self.frequency_hz >= low_hz) & (self.frequency_hz <= high_hz)
        return replace(
            self,
            frequency_hz=self.frequency_hz[keep],
            response=self.response[keep],
            relative_error=self.relative_error[keep],
            coherence=self.coherence[keep],
        )


@dataclass(frozen=True, slots=True)
class ResponseSettings:
    """How a response is estimated.

    Attributes:
        resolution_hz: distance of its frequencies.
        least_coherence: frequencies with less are left out.
        hold: the torque is held between samples, as that of a drive is.
    """

    resolution_hz: float = 1.0
    least_coherence: float = 0.5
    hold: bool = True

    def __post_init__(self) -> None:
        if not (math.isfinite(self.resolution_hz) and self.resolution_hz > 0.0):
            raise ValueError(f"resolution_hz must be greater than 0, got {self.resolution_hz:g}")


def drive_response(
    recordings: Iterable[SampleFrame], settings: ResponseSettings | None = None
) -> FrequencyResponse:
    """Motor speed over torque, rad/(s N m), from the differences of the angle.

    Raises:
        ValueError: one line; a channel is missing, or no run is long enough for the resolution.
    """
    return _response(recordings, TORQUE, ANGLE, settings or ResponseSettings())


def transmission_response(
    recordings: Iterable[SampleFrame], settings: ResponseSettings | None = None
) -> FrequencyResponse:
    """Table speed over motor speed, m/rad: R_t well below the table's resonance.

    Raises:
        ValueError: like `drive_response`.
    """
    return _response(recordings, ANGLE, TABLE_POSITION, settings or ResponseSettings())


def _response(
    recordings: Iterable[SampleFrame], source: str, sink: str, settings: ResponseSettings
) -> FrequencyResponse:
    spectra = _Spectra()
    for frame in recordings:
        for run in uniform_runs(frame, (source, sink), optional=(SETPOINT,)):
            spectra.add(run, source, sink, settings.resolution_hz)
    if spectra.segments == 0:
        raise ValueError(
            f"no unbroken run of {1.0 / settings.resolution_hz:g} s, which a resolution of "
            f"{settings.resolution_hz:g} Hz needs"
        )
    response = spectra.source_sink / spectra.source_source
    if source == TORQUE:
        response *= sampling_correction(spectra.frequency_hz, spectra.period_s, settings.hold)
    coherence = spectra.coherence()
    averages = max(_WINDOW_AVERAGES * spectra.segments, 1.0)
    error = np.sqrt((1.0 - coherence) / (2.0 * np.maximum(coherence, 1e-12) * averages))
    keep = (coherence >= settings.least_coherence) & (spectra.frequency_hz > 0.0)
    return FrequencyResponse(
        spectra.frequency_hz[keep],
        response[keep],
        error[keep],
        coherence[keep],
        averages,
        "rad/(s N m)" if source == TORQUE else "m/rad",
        spectra.period_s,
        settings.hold and source == TORQUE,
        float(spectra.frequency_hz[1]),
    )


class _Spectra:
    """Cross spectra summed over the segments of all runs."""

    def __init__(self) -> None:
        self.segments = 0
        self.frequency_hz: Floats = np.empty(0)
        self.period_s = math.nan
        self._sums: dict[str, Complexes] = {}

    def add(self, run: UniformRun, source: str, sink: str, resolution_hz: float) -> None:
        """Add one run; one too short for a segment adds nothing."""
        size = round(1.0 / (resolution_hz * run.period_s))
        series = {"u": _rate(run, source), "y": _rate(run, sink)}
        series["r"] = _rate(run, SETPOINT) if SETPOINT in run.channels else series["u"]
        if len(series["u"]) < size:
            return
        if self.segments and abs(run.period_s - self.period_s) > 1e-3 * self.period_s:
            raise ValueError("recordings with different sampling rates; give them apart")
        self.period_s = run.period_s
        count = 1 + int((len(series["u"]) - size) // (size * (1.0 - OVERLAP)))
        for a, b in ("uu", "yy", "rr", "uy", "ru", "ry"):
            self.frequency_hz, spectrum = signal.csd(
                series[a], series[b], 1.0 / run.period_s, nperseg=size, noverlap=size // 2
            )
            self._sums[a + b] = self._sums.get(a + b, 0.0) + count * spectrum
        self.segments += count

    @property
    def source_sink(self) -> Complexes:
        """S_ry, (n,)."""
        return self._sums["ry"]

    @property
    def source_source(self) -> Complexes:
        """S_ru, (n,)."""
        return self._sums["ru"]

    def coherence(self) -> Floats:
        """The lesser of how much of input and of output the reference explains, (n,)."""
        sums = self._sums
        reference = np.maximum(np.abs(sums["rr"]), np.finfo(float).tiny)
        shares = [
            np.abs(sums["r" + name]) ** 2
            / np.maximum(reference * np.abs(sums[name * 2]), np.finfo(float).tiny)
            for name in ("u", "y")
        ]
        coherence: Floats = np.clip(np.minimum(*shares), 0.0, 1.0)
        return coherence


def _rate(run: UniformRun, name: str) -> Floats:
    """A torque as it is; a position by its first differences, which leak less, (n - 1,)."""
    values: Floats = run.channels[name]
    if name == TORQUE:
        return values[1:]
    return np.asarray(np.diff(values) / run.period_s, dtype=np.float64)


def sampling_correction(frequency_hz: Floats, period_s: float, hold: bool) -> Complexes:
    """What turns differences of the angle over sampled torque into speed over torque, (n,).

    First differences stand for the speed by (1 - z^-1) / (s T). Where the torque is held between
    samples, those of an inertia J follow it by T (z + 1) / (2 J z (z - 1)) exactly, and not by
    1 / (J s): the ratio of the two. What is not rigid is sampled otherwise, which a fit has to
    know.
    """
    s = 2j * math.pi * np.maximum(frequency_hz, 1e-9)
    z = np.exp(s * period_s)
    if hold:
        held: Complexes = 2.0 * z * (z - 1.0) / (s * period_s * (z + 1.0))
        return held
    difference: Complexes = s * period_s / (1.0 - 1.0 / z)
    return difference
