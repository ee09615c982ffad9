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
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, fields, replace

import numpy as np
import numpy.typing as npt
from scipy import signal

from ...messages.samples import ANGLE, SETPOINT, TORQUE, Booleans, Floats, SampleFrame
from ...recordings.conditioning import UniformRun, uniform_runs

Complexes = npt.NDArray[np.complex128]
RESOLUTION_HZ = 1.0
LEAST_COHERENCE = 0.5
REPEATED = 1e-3
"""A reference repeats itself if it differs by less than this share of itself from a period ago."""
_WINDOW_AVERAGES = 0.95
"""Share of the half-overlapped Hann segments that are independent (Welch, 1967)."""
_EXCITED = 0.05
"""A place with less of the greatest power at a frequency does not show that frequency."""
_SMOOTHING = 20.0
"""Frequencies whose noise is averaged, times the averages that each has."""
_LEAST_AVERAGES = 0.5
_UU, _YY, _RR, _RU, _RY, _ANGLE, _ANGLE2 = range(7)
_PAIRS = ((_RU, _UU), (_RY, _YY))
_TINY = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True, slots=True, eq=False)
class FrequencyResponse:
    """A response over frequency; only frequencies with excitation are in it."""

    frequency_hz: Floats  # (n,)
    response: Complexes  # output over input, complex, (n,)
    relative_error: Floats  # standard deviation of the response over its magnitude, (n,)
    coherence: Floats  # share of the output's power that the reference explains, 0 to 1, (n,)
    # of the samples, between which the torque was held, corrected for a rigid axis; 0 where it is
    # continuous
    period_s: float = 0.0
    # distance of the bins over which a Hann window has smoothed; 0 is not at all
    resolution_hz: float = 0.0
    # place_rad, spread_rad: mean and standard deviation of the motor's angle at which each
    # frequency was excited, (n,); empty where nobody knows
    place_rad: Floats = field(default_factory=lambda: np.empty(0))
    spread_rad: Floats = field(default_factory=lambda: np.empty(0))

    def within(self, low_hz: float, high_hz: float) -> "FrequencyResponse":
        """The part between two frequencies, both included."""
        return self._part((self.frequency_hz >= low_hz) & (self.frequency_hz <= high_hz))

    def coherent(self, least: float) -> "FrequencyResponse":
        return self._part(self.coherence >= least)

    def every(self, step: int) -> "FrequencyResponse":
        return self._part(np.arange(len(self.frequency_hz)) % step == 0)

    def _part(self, keep: Booleans) -> "FrequencyResponse":
        every = {each.name: getattr(self, each.name) for each in fields(self)}
        columns = {name: one for name, one in every.items() if np.ndim(one) and len(one)}
        return replace(self, **{name: column[keep] for name, column in columns.items()})


def drive_response(recordings: Iterable[SampleFrame]) -> FrequencyResponse:
    """Motor speed over torque, rad/(s N m), from the differences of the angle.

    Raises ValueError: a channel is missing, or no run is long enough for the resolution.
    """
    return drive_responses_along(recordings, 1)[0]


def drive_responses_along(
    recordings: Iterable[SampleFrame], places: int = 4
) -> list[FrequencyResponse]:
    """`drive_response` at several places of the travel, each with as many segments, in order."""
    spectra = _Spectra()
    for frame in recordings:
        for run in uniform_runs(frame, (TORQUE, ANGLE), optional=(SETPOINT,)):
            spectra.add(run)
    if not spectra.places:
        raise ValueError(
            f"no unbroken run of {1.0 / RESOLUTION_HZ:g} s, which a resolution of "
            f"{RESOLUTION_HZ:g} Hz needs"
        )
    parts = spectra.along(places)
    strongest = np.max([part.sums[_RR].real / part.segments for part in parts], axis=0)
    return [spectra.response(part, strongest) for part in parts]


@dataclass(slots=True, eq=False)
class _Place:
    """Sums over the segments of one place, by the constants above, (7, n), and their number."""

    sums: Complexes
    segments: int = 0


class _Spectra:
    """Cross spectra of reference, input and output, for each revolution of the motor.

    If any segment is a whole period of a repeated reference, only such segments count.
    """

    def __init__(self) -> None:
        self.places: dict[int, _Place] = {}
        self._period_s, self._size, self._periodic = math.nan, 0, False

    def add(self, run: UniformRun) -> None:
        """Add one run; one too short for a segment adds nothing.

        Positions come by their first differences, which leak less.
        Raises ValueError: it has another sampling rate than the runs before.
        """
        size = round(1.0 / (RESOLUTION_HZ * run.period_s))
        torque, angle = run.channels[TORQUE][1:], run.channels[ANGLE][1:]
        speed, reference = np.diff(run.channels[ANGLE]) / run.period_s, torque
        if SETPOINT in run.channels:
            reference = np.diff(run.channels[SETPOINT]) / run.period_s
        if len(torque) < size:
            return
        if self.places and abs(run.period_s - self._period_s) > 1e-3 * self._period_s:
            raise ValueError("recordings have different sampling rates; analyse them separately")
        self._period_s, self._size = run.period_s, size
        for start, repeated in _cut(reference, size):
            if repeated and not self._periodic:
                self._periodic = True
                self.places.clear()
            if repeated or not self._periodic:
                where = slice(start, start + size)
                window = np.ones(size) if repeated else signal.windows.hann(size, sym=False)
                r, u, y = (
                    np.fft.rfft((series[where] - np.mean(series[where])) * window)
                    for series in (reference, torque, speed)
                )
                self._add(r, u, y, angle[where])

    def _add(self, r: Complexes, u: Complexes, y: Complexes, angle: Floats) -> None:
        power = np.abs(r) ** 2
        number = int(np.mean(angle) // (2.0 * math.pi))
        place = self.places.setdefault(number, _Place(np.zeros((7, len(r)), np.complex128)))
        spectra = [np.abs(u) ** 2, np.abs(y) ** 2, power, np.conj(r) * u, np.conj(r) * y]
        angles = [power * float(np.mean(angle)), power * float(np.mean(angle**2))]
        place.sums += np.stack([*spectra, *angles])
        place.segments += 1

    def along(self, count: int) -> list[_Place]:
        """Sums at up to `count` places in order, each with about as many segments."""
        ordered = [self.places[key] for key in sorted(self.places)]
        ends = np.cumsum([place.segments for place in ordered])
        before = ends - 0.5 * ordered[0].segments
        group = np.minimum((before * count / int(ends[-1])).astype(int), count - 1)
        found = []
        for each in sorted(set(group.tolist())):
            parts = [place for place, own in zip(ordered, group, strict=True) if own == each]
            sums = np.sum([part.sums for part in parts], axis=0)
            found.append(_Place(sums, sum(part.segments for part in parts)))
        return found

    def response(self, part: _Place, strongest: Floats) -> FrequencyResponse:
        """Response of one place, S_ry / S_ru, at the frequencies that it shows.

        A sweep passes each frequency at another angle.

        Args:
            strongest: greatest power of the reference per segment of all places, (n,).
        """
        frequency = np.fft.rfftfreq(self._size, self._period_s).astype(np.float64)
        sums, power = part.sums, part.sums[_RR].real
        below, reference = sums[_RU], np.maximum(power, _TINY)
        ratio = np.where(below == 0.0, 0.0, sums[_RY] / np.where(below, below, 1.0))
        shares = [
            np.abs(sums[cross]) ** 2 / np.maximum(reference * sums[own].real, _TINY)
            for cross, own in _PAIRS
        ]
        coherence = np.clip(np.minimum(*shares), 0.0, 1.0)
        excited = power / part.segments > _EXCITED * strongest
        keep = excited & (coherence >= LEAST_COHERENCE) & (frequency > 0.0)
        averages = (1.0 if self._periodic else _WINDOW_AVERAGES) * part.segments
        place = sums[_ANGLE].real / reference
        spread = np.sqrt(np.maximum(sums[_ANGLE2].real / reference - place**2, 0.0))
        return FrequencyResponse(
            frequency_hz=frequency[keep],
            response=(ratio * sampling_correction(frequency, self._period_s))[keep],
            relative_error=_relative_error(sums, averages, keep)[keep],
            coherence=coherence[keep],
            period_s=self._period_s,
            resolution_hz=0.0 if self._periodic else float(frequency[1]),
            place_rad=place[keep],
            spread_rad=spread[keep],
        )


def _relative_error(sums: Complexes, averages: float, used: Booleans) -> Floats:
    """Standard deviation of a response over its magnitude, (n,).

    What the reference does not explain of input and output is their noise. It changes slowly
    over frequency, so neighbours are averaged; what it stands against does not: beside an
    antiresonance the output is lost in it. Of n averages the fit has taken one.
    """
    kernel = np.ones(2 * math.ceil(_SMOOTHING / averages) + 1)
    weight = np.maximum(np.convolve(used.astype(np.float64), kernel, mode="same"), 1.0)
    variance = np.zeros(len(used))
    for cross, own in _PAIRS:
        explained = np.abs(sums[cross]) ** 2 / np.maximum(sums[_RR].real, _TINY)
        noise = np.where(used, np.maximum(sums[own].real - explained, 0.0), 0.0)
        noise = np.convolve(noise, kernel, mode="same") / weight
        variance += noise / np.maximum(explained, _TINY)
    error: Floats = np.sqrt(0.5 * variance / max(averages - 1.0, _LEAST_AVERAGES))
    return error


def _cut(reference: Floats, size: int) -> Iterator[tuple[int, bool]]:
    """Starts of segments of `size`, and whether the one before or behind is the same."""
    start = 0
    while start + size <= len(reference):
        here = reference[start : start + size]
        limit = REPEATED * float(np.linalg.norm(here - np.mean(here)))
        beside = [
            reference[other : other + size]
            for other in (start - size, start + size)
            if 0 <= other <= len(reference) - size
        ]
        repeated = any(float(np.linalg.norm(here - each)) < limit for each in beside)
        yield start, repeated
        start += size if repeated else size // 2


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
