"""Cross spectra of reference, input and output, summed by the place at which they were taken."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import signal

from ...messages.samples import ANGLE, SETPOINT, TORQUE, Booleans, Floats
from ...recordings.conditioning import UniformRun

Complexes = npt.NDArray[np.complex128]

REPEATED = 1e-3
"""A reference repeats itself if it differs by less than this share of itself from a period ago."""
_SMOOTHING = 20.0
"""Frequencies whose noise is averaged, times the averages that each has."""
_LEAST_AVERAGES = 0.5
_UU, _YY, _RR, _RU, _RY, _ANGLE, _ANGLE2 = range(7)
_TINY = float(np.finfo(np.float64).tiny)


@dataclass(slots=True, eq=False)
class PlaceSpectra:
    """Sums over the segments of one place.

    Attributes:
        sums: by the constants above, (7, n).
        segments: how many; whole periods if `periodic`, else half-overlapped Hann windows.
    """

    sums: Complexes
    segments: int = 0

    def add(self, reference: Complexes, source: Complexes, sink: Complexes, angle: Floats) -> None:
        """Add the transforms (n,) of one segment with its angles (m,)."""
        power = np.abs(reference) ** 2
        self.sums += np.stack(
            (
                np.abs(source) ** 2,
                np.abs(sink) ** 2,
                power,
                np.conj(reference) * source,
                np.conj(reference) * sink,
                power * float(np.mean(angle)),
                power * float(np.mean(angle**2)),
            )
        )
        self.segments += 1

    @property
    def place_rad(self) -> Floats:
        """Mean angle at which a frequency was excited, (n,); a sweep passes each at another."""
        place: Floats = self.sums[_ANGLE].real / np.maximum(self.sums[_RR].real, _TINY)
        return place

    @property
    def spread_rad(self) -> Floats:
        """Standard deviation of that angle, (n,)."""
        square = self.sums[_ANGLE2].real / np.maximum(self.sums[_RR].real, _TINY)
        spread: Floats = np.sqrt(np.maximum(square - self.place_rad**2, 0.0))
        return spread

    @property
    def response(self) -> Complexes:
        """S_ry / S_ru, (n,); 0 where there is no input."""
        below = self.sums[_RU]
        ratio: Complexes = np.where(below == 0.0, 0.0, self.sums[_RY] / np.where(below, below, 1.0))
        return ratio

    @property
    def power(self) -> Floats:
        """Power of the reference, per segment, (n,)."""
        return np.asarray(self.sums[_RR].real / self.segments, dtype=np.float64)

    def coherence(self) -> Floats:
        """The lesser of how much of input and of output the reference explains, (n,)."""
        reference = np.maximum(self.sums[_RR].real, _TINY)
        shares = [
            np.abs(self.sums[cross]) ** 2 / np.maximum(reference * self.sums[own].real, _TINY)
            for cross, own in ((_RU, _UU), (_RY, _YY))
        ]
        coherence: Floats = np.clip(np.minimum(*shares), 0.0, 1.0)
        return coherence

    def relative_error(self, averages: float, used: Booleans) -> Floats:
        """Standard deviation of `response` over its magnitude, (n,).

        What the reference does not explain of input and output is their noise. It changes slowly
        over frequency, so neighbours are averaged; what it stands against does not: beside an
        antiresonance the output is lost in it. Of n averages the fit has taken one.
        """
        kernel = np.ones(2 * math.ceil(_SMOOTHING / averages) + 1)
        weight = np.maximum(np.convolve(used.astype(np.float64), kernel, mode="same"), 1.0)
        variance = np.zeros(len(used))
        for cross, own in ((_RU, _UU), (_RY, _YY)):
            power = self.sums[_RR].real
            explained = np.abs(self.sums[cross]) ** 2 / np.maximum(power, _TINY)
            noise = np.where(used, np.maximum(self.sums[own].real - explained, 0.0), 0.0)
            noise = np.convolve(noise, kernel, mode="same") / weight
            variance += noise / np.maximum(explained, _TINY)
        error: Floats = np.sqrt(0.5 * variance / max(averages - 1.0, _LEAST_AVERAGES))
        return error


class SegmentSpectra:
    """Sums over the segments of all runs, one for each revolution of the motor.

    If any segment is a whole period of a repeated reference, only such segments count.
    """

    def __init__(self, resolution_hz: float) -> None:
        self.resolution_hz = resolution_hz
        self.period_s = math.nan
        self.size = 0
        self.periodic = False
        self._places: dict[int, PlaceSpectra] = {}

    @property
    def segments(self) -> int:
        """Number of segments."""
        return sum(place.segments for place in self._places.values())

    @property
    def frequency_hz(self) -> Floats:
        """(n,)."""
        return np.fft.rfftfreq(self.size, self.period_s).astype(np.float64)

    def add(self, run: UniformRun) -> None:
        """Add one run; one too short for a segment adds nothing.

        Raises ValueError: it has another sampling rate than the runs before.
        """
        size = round(1.0 / (self.resolution_hz * run.period_s))
        series = {"u": _rate(run, TORQUE), "y": _rate(run, ANGLE), "angle": run.channels[ANGLE][1:]}
        series["r"] = _rate(run, SETPOINT) if SETPOINT in run.channels else series["u"]
        if len(series["u"]) < size:
            return
        if self.segments and abs(run.period_s - self.period_s) > 1e-3 * self.period_s:
            raise ValueError("recordings have different sampling rates; analyse them separately")
        self.period_s, self.size = run.period_s, size
        for start, repeated in _cut(series["r"], size):
            if repeated and not self.periodic:
                self.periodic = True
                self._places.clear()
            if repeated or not self.periodic:
                where = slice(start, start + size)
                window = signal.windows.hann(size, sym=False) if not repeated else np.ones(size)
                reference, source, sink = (
                    np.fft.rfft((series[name][where] - np.mean(series[name][where])) * window)
                    for name in ("r", "u", "y")
                )
                angle = series["angle"][where]
                place = int(np.mean(angle) // (2.0 * math.pi))
                empty = np.zeros((7, len(reference)), dtype=np.complex128)
                spectra = self._places.setdefault(place, PlaceSpectra(empty))
                spectra.add(reference, source, sink, angle)

    def along(self, count: int) -> list[PlaceSpectra]:
        """Sums at up to `count` places in order, each with about as many segments."""
        ordered = [self._places[key] for key in sorted(self._places)]
        before = np.cumsum([place.segments for place in ordered]) - 0.5 * ordered[0].segments
        group = np.minimum((before * count / self.segments).astype(int), count - 1)
        found = []
        for each in sorted(set(group.tolist())):
            parts = [place for place, own in zip(ordered, group, strict=True) if own == each]
            sums = np.sum([part.sums for part in parts], axis=0)
            found.append(PlaceSpectra(sums, sum(part.segments for part in parts)))
        return found


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


def _rate(run: UniformRun, name: str) -> Floats:
    """A torque as it is; a position by its first differences, which leak less, (n - 1,)."""
    values: Floats = run.channels[name]
    if name == TORQUE:
        return values[1:]
    return np.asarray(np.diff(values) / run.period_s, dtype=np.float64)
