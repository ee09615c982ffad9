"""Frequency response of the axis from chirp or multisine recordings.

The torque of a controlled axis holds its own noise fed back. With the commanded motion r recorded,
H = S_ry / S_ru is free of that bias (joint input-output method); without it H1 = S_uy / S_uu, which
noise on the input pulls down (Bendat and Piersol, Random Data, 2010, sections 6.1 and 9.2).

Where the commanded motion repeats itself with the length of a segment, as a multisine does, whole
periods are taken without a window: each frequency then stands for itself, whereas a Hann window
mixes neighbours whose phases stay the same, and no average removes that (Pintelon and Schoukens,
System Identification, 2012, section 2.2). Everything else is averaged over Hann windows.

The resonance moves with the position of the nut (5.3.9). `drive_responses_along` parts a recording
by position, so that a fit can tell a resonance that has moved from one that is damped.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from ...messages.samples import ANGLE, SETPOINT, TORQUE, Booleans, Floats, SampleFrame
from ...recordings.conditioning import uniform_runs
from .segment_spectra import Complexes, SegmentSpectra

RESOLUTION_HZ = 1.0
LEAST_COHERENCE = 0.5
_WINDOW_AVERAGES = 0.95
"""Share of the half-overlapped Hann segments that are independent (Welch, 1967)."""
_EXCITED = 0.05
"""A place with less of the greatest power at a frequency does not show that frequency."""


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
        period_s: of the samples, between which the torque was held, corrected for a rigid axis; 0
            where it is continuous.
        resolution_hz: distance of the bins over which a Hann window has smoothed; 0 is not at all.
        place_rad, spread_rad: mean and standard deviation of the motor's angle at which each
            frequency was excited, (n,); empty where nobody knows.
    """

    frequency_hz: Floats
    response: Complexes
    relative_error: Floats
    coherence: Floats
    averages: float
    unit: str
    period_s: float
    resolution_hz: float
    place_rad: Floats = field(default_factory=lambda: np.empty(0))
    spread_rad: Floats = field(default_factory=lambda: np.empty(0))

    def within(self, low_hz: float, high_hz: float) -> "FrequencyResponse":
        """The part between two frequencies, both included."""
        return self._part((self.frequency_hz >= low_hz) & (self.frequency_hz <= high_hz))

    def coherent(self, least: float) -> "FrequencyResponse":
        """The frequencies with at least so much coherence."""
        return self._part(self.coherence >= least)

    def every(self, step: int) -> "FrequencyResponse":
        """Every `step`th frequency."""
        return self._part(np.arange(len(self.frequency_hz)) % step == 0)

    def _part(self, keep: Booleans) -> "FrequencyResponse":
        known = len(self.place_rad) > 0
        return replace(
            self,
            frequency_hz=self.frequency_hz[keep],
            response=self.response[keep],
            relative_error=self.relative_error[keep],
            coherence=self.coherence[keep],
            place_rad=self.place_rad[keep] if known else self.place_rad,
            spread_rad=self.spread_rad[keep] if known else self.spread_rad,
        )


def drive_response(recordings: Iterable[SampleFrame]) -> FrequencyResponse:
    """Motor speed over torque, rad/(s N m), from the differences of the angle.

    Raises ValueError: a channel is missing, or no run is long enough for the resolution.
    """
    return drive_responses_along(recordings, 1)[0]


def drive_responses_along(
    recordings: Iterable[SampleFrame], places: int = 4
) -> list[FrequencyResponse]:
    """`drive_response` at several places of the travel, each with as many segments, in order."""
    spectra = SegmentSpectra(RESOLUTION_HZ)
    for frame in recordings:
        for run in uniform_runs(frame, (TORQUE, ANGLE), optional=(SETPOINT,)):
            spectra.add(run)
    if spectra.segments == 0:
        raise ValueError(
            f"no unbroken run of {1.0 / RESOLUTION_HZ:g} s, which a resolution of "
            f"{RESOLUTION_HZ:g} Hz needs"
        )
    frequency, period_s = spectra.frequency_hz, spectra.period_s
    correction = sampling_correction(frequency, period_s)
    parts = spectra.along(places)
    strongest = np.max([part.power for part in parts], axis=0)
    found = []
    for part in parts:
        coherence = part.coherence()
        excited = part.power > _EXCITED * strongest
        keep = excited & (coherence >= LEAST_COHERENCE) & (frequency > 0.0)
        averages = (1.0 if spectra.periodic else _WINDOW_AVERAGES) * part.segments
        found.append(
            FrequencyResponse(
                frequency_hz=frequency[keep],
                response=(part.response * correction)[keep],
                relative_error=part.relative_error(averages, keep)[keep],
                coherence=coherence[keep],
                averages=averages,
                unit="rad/(s N m)",
                period_s=period_s,
                resolution_hz=0.0 if spectra.periodic else float(frequency[1]),
                place_rad=part.place_rad[keep],
                spread_rad=part.spread_rad[keep],
            )
        )
    return found


def sampling_correction(frequency_hz: Floats, period_s: float) -> Complexes:
    """Factor from differences of the angle over held torque to speed over torque, (n,).

    First differences stand for the speed by (1 - z^-1) / (s T), and those of an inertia J follow a
    held torque by T (z + 1) / (2 J z (z - 1)) exactly, and not by 1 / (J s): the ratio of the two.
    What is not rigid is sampled otherwise, which a fit has to know.
    """
    s = 2j * math.pi * np.maximum(frequency_hz, 1e-9)
    z = np.exp(s * period_s)
    held: Complexes = 2.0 * z * (z - 1.0) / (s * period_s * (z + 1.0))
    return held
