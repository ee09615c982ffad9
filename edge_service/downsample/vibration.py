"""A fast sensor reduced to features, tied to the turning of the screw. Pure.

Orders are read by the Fourier integral over the angle itself, c(o) = 2 / Theta int a w exp(-i o
theta) d theta with a Hann window w over the turned angle Theta: no resampling, hence no aliasing,
at any course of the speed.
"""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..messages.channels import ANGLE
from ..messages.features import VibrationColumn
from ..messages.samples import Floats, SampleFrame
from ..messages.waveform import Waveform
from ..models.machine import Machine

MOST_SENSORS = 4
"""Sensors of one axis; their names come from the bus."""
PATIENCE_S = 0.5
"""Longest wait for the angle of an interval, which comes another way than the signal."""
_GAP = 1.5
"""Periods without a value that part a signal."""
_CLOSE = 0.5
"""Periods after which the next value may follow at the earliest."""
_ANGLES_S = 10.0
"""So far the angle may be ahead of a signal."""
_SIDES = np.concatenate([np.linspace(-2.8, -1.0, 7), np.linspace(1.0, 2.8, 7)])
"""Evaluation points of an order's surroundings, in units of how far its own peak reaches."""


@dataclass(frozen=True, slots=True)
class OrderPeak:
    """Strength of a signal at an order, per revolution of the screw.

    Attributes:
        order: where the peak is, near the nominal one: balls slip.
        amplitude: in the sensor's unit.
        floor: typical amplitude beside it; a peak that is not well above it is none.
    """

    order: float
    amplitude: float
    floor: float


@dataclass(frozen=True, slots=True)
class VibrationFeatures:
    """One interval of one sensor of one axis.

    Attributes:
        sensor, unit: of the signal.
        time_s: end of the interval on the axis' clock, s.
        duration_s: its length, s.
        rms, peak, kurtosis: of the signal without its mean; a Gaussian one has a kurtosis of 3.
        bands: name -> rms of the part of the signal in that band of frequencies.
        orders: name -> peak of the signal; None where the screw turned too little or turned round.
        envelope_orders: the same of the envelope of the highest band: what taps again and again.
    """

    sensor: str
    unit: str
    time_s: float
    duration_s: float
    rms: float
    peak: float
    kurtosis: float | None
    bands: Mapping[str, float]
    orders: Mapping[str, OrderPeak | None]
    envelope_orders: Mapping[str, OrderPeak | None]

    def columns(self) -> tuple[VibrationColumn, ...]:
        """Columns of `features/1`, `SENSOR.WHAT`; what is not known has none."""
        values = {"rms": self.rms, "peak": self.peak}
        values |= {f"{name}_rms": value for name, value in self.bands.items()}
        for kind, peaks in (("", self.orders), ("envelope_", self.envelope_orders)):
            for name, each in peaks.items():
                if each is not None:
                    values[f"{kind}{name}"] = each.amplitude
                    values[f"{kind}{name}_floor"] = each.floor
        found = [VibrationColumn(f"{self.sensor}.{k}", v, self.unit) for k, v in values.items()]
        if self.kurtosis is not None:
            found.append(VibrationColumn(f"{self.sensor}.kurtosis", self.kurtosis, ""))
        return tuple(found)


@dataclass(frozen=True, slots=True)
class VibrationSettings:
    """Settings for the reduction of a signal.

    Attributes:
        interval_s: length of an interval, s.
        bands_hz: name -> lower and upper frequency.
        orders: name -> nominal order.
        slip: share of an order by which its peak may lie beside it.
        least_turns: orders need at least so many revolutions of the screw.
    """

    interval_s: float = 1.0
    bands_hz: Mapping[str, tuple[float, float]] = field(
        default_factory=lambda: {"low": (10.0, 1000.0), "high": (1000.0, 5000.0)}
    )
    orders: Mapping[str, float] = field(default_factory=lambda: {"screw": 1.0})
    slip: float = 0.02
    least_turns: float = 3.0


def orders_of(machine: Machine) -> Mapping[str, float]:
    """Order of the screw, and of the ball passes where the machine file knows the balls."""
    balls = machine.ball_pass_orders
    passes = {} if balls is None else {"nut": balls.on_nut, "screw_track": balls.on_screw}
    return {"screw": 1.0} | {f"ball_pass_{name}": order for name, order in passes.items()}


class AxisVibration:
    """Fast sensors of one axis, reduced to columns of its feature blocks."""

    def __init__(self, settings: VibrationSettings) -> None:
        self._settings = settings
        self._sensors: dict[str, VibrationReducer] = {}
        self._waiting: dict[str, tuple[VibrationColumn, ...]] = {}

    @property
    def gaps(self) -> int:
        """Times that a signal broke off."""
        return sum(sensor.gaps for sensor in self._sensors.values())

    def follow(self, frame: SampleFrame) -> None:
        """Take in the angle of the screw, for all sensors."""
        if ANGLE in frame.channels:
            for sensor in self._sensors.values():
                sensor.follow(frame.time_s, frame.channels[ANGLE])

    def push(self, wave: Waveform) -> bool:
        """Take in a piece of a signal; False if it is of one sensor too many."""
        if wave.sensor not in self._sensors:
            if len(self._sensors) >= MOST_SENSORS:
                return False
            self._sensors[wave.sensor] = VibrationReducer(self._settings)
        for features in self._sensors[wave.sensor].push(wave):
            self._waiting[wave.sensor] = features.columns()
        return True

    def take(self) -> tuple[VibrationColumn, ...]:
        """Columns of the intervals that were completed since the last call."""
        columns = tuple(each for sensor in self._waiting.values() for each in sensor)
        self._waiting.clear()
        return columns


class VibrationReducer:
    """Features of one sensor of one axis, one set per whole interval without a gap."""

    def __init__(self, settings: VibrationSettings) -> None:
        self._settings = settings
        self._pieces: list[Waveform] = []
        self._angles: deque[tuple[Floats, Floats]] = deque()
        self.gaps = 0
        """Interruptions of the signal; the interval of each is left out."""

    def follow(self, time_s: Floats, angle_rad: Floats) -> None:
        """Take in the angle of the screw, (n,) each, in the order of time."""
        known = np.isfinite(time_s) & np.isfinite(angle_rad)
        if not known.any():
            return
        if self._angles and time_s[known][0] < self._angles[-1][0][-1]:
            self._angles.clear()  # a new clock
        self._angles.append((time_s[known], angle_rad[known]))
        oldest_s = self._angles[-1][0][-1] - self._settings.interval_s - _ANGLES_S
        while self._angles[0][0][-1] < oldest_s:
            self._angles.popleft()

    def push(self, wave: Waveform) -> list[VibrationFeatures]:
        """Take in the next piece; returns the intervals that it completes."""
        if self._pieces and not self._follows(wave):
            self.gaps += 1
            self._pieces = []
        self._pieces.append(wave)
        features = []
        while (cut := self._whole_interval()) is not None:
            features.append(self._reduce(cut))
            self._forget(cut.end_s)
        return features

    def _follows(self, wave: Waveform) -> bool:
        last = self._pieces[-1]
        step_s = wave.start_s - (last.end_s - last.period_s)
        return wave.period_s == last.period_s and _CLOSE < step_s / last.period_s < _GAP

    def _whole_interval(self) -> Waveform | None:
        """Values of the first interval of the grid that is complete; None if none is."""
        first = self._pieces[0]
        interval_s, period_s = self._settings.interval_s, first.period_s
        number = math.ceil(first.start_s / interval_s - 1e-6)
        start, count = round(number * interval_s / period_s), round(interval_s / period_s)
        offset = round(first.start_s / period_s)
        end_s = (start + count) * period_s
        if self._pieces[-1].end_s < end_s - 0.5 * period_s:
            return None
        if not self._angle_has_come(end_s) and self._pieces[-1].end_s < end_s + PATIENCE_S:
            return None
        values = np.concatenate([piece.values for piece in self._pieces])
        cut = values[start - offset : start - offset + count]
        return Waveform(first.sensor, first.unit, start * period_s, period_s, cut)

    def _angle_has_come(self, end_s: float) -> bool:
        if not self._angles:
            return False
        times = self._angles[-1][0]
        step_s = float(times[-1] - times[0]) / max(len(times) - 1, 1)
        return float(times[-1]) >= end_s - 2.0 * step_s

    def _forget(self, end_s: float) -> None:
        last = self._pieces[-1]
        values = np.concatenate([piece.values for piece in self._pieces])
        gone = round((end_s - self._pieces[0].start_s) / last.period_s)
        rest = Waveform(last.sensor, last.unit, end_s, last.period_s, values[gone:])
        self._pieces = [rest]
        while len(self._angles) > 1 and self._angles[1][0][0] < end_s:
            self._angles.popleft()

    def _reduce(self, wave: Waveform) -> VibrationFeatures:
        values = np.nan_to_num(wave.values - np.nanmean(wave.values))
        power = float(np.mean(values**2))
        peak = float(np.max(np.abs(values)))
        angle = self._angle_at(wave.time_s)
        highest = max(self._settings.bands_hz.values(), default=None)
        envelope = None if highest is None else _envelope(values, wave.period_s, highest)
        return VibrationFeatures(
            sensor=wave.sensor,
            unit=wave.unit,
            time_s=wave.end_s,
            duration_s=wave.end_s - wave.start_s,
            rms=math.sqrt(power),
            peak=peak,
            kurtosis=float(np.mean(values**4)) / power**2 if power > 0.0 else None,
            bands=_band_rms(values, wave.period_s, self._settings.bands_hz),
            orders=self._orders(values, angle),
            envelope_orders={} if envelope is None else self._orders(envelope, angle),
        )

    def _angle_at(self, time_s: Floats) -> Floats | None:
        """Angle of the screw at each value; None where it is not known throughout."""
        if not self._angles:
            return None
        known_s = np.concatenate([times for times, _ in self._angles])
        known_rad = np.concatenate([angles for _, angles in self._angles])
        steps = np.diff(known_s)
        if not steps.size or (steps <= 0.0).any():
            return None
        slack_s = 2.0 * float(np.median(steps))
        if known_s[0] > time_s[0] + slack_s or known_s[-1] < time_s[-1] - slack_s:
            return None
        angle: Floats = np.interp(time_s, known_s, known_rad)
        return angle

    def _orders(self, values: Floats, angle: Floats | None) -> dict[str, OrderPeak | None]:
        """Peaks at the orders asked for, where the screw turned far enough in one direction."""
        settings = self._settings
        unknown = dict.fromkeys(settings.orders)
        if angle is None:
            return unknown
        turned = abs(float(angle[-1] - angle[0]))
        both_ways = float(np.sum(np.abs(np.diff(angle)))) > 1.01 * turned
        if both_ways or turned < 2.0 * math.pi * settings.least_turns:
            return unknown
        return {name: self._peak(values, angle, order) for name, order in settings.orders.items()}

    def _peak(self, values: Floats, angle: Floats, order: float) -> OrderPeak:
        turns = abs(float(angle[-1] - angle[0])) / (2.0 * math.pi)
        reach = max(self._settings.slip * order, 0.5 / turns)
        count = 2 * math.ceil(reach * turns * 4.0) + 1
        near = np.linspace(order - reach, order + reach, count)
        amplitudes = _amplitudes(values, angle, near)
        best = int(np.argmax(amplitudes))
        beside = order + max(0.1 * order, 2.5 / turns) * _SIDES
        floor = float(np.median(_amplitudes(values, angle, np.abs(beside))))
        return OrderPeak(order=float(near[best]), amplitude=float(amplitudes[best]), floor=floor)


def _amplitudes(values: Floats, angle: Floats, orders: Floats) -> Floats:
    """Amplitude of a signal at each order, by the integral over the angle; (m,)."""
    turned = np.abs(angle - angle[0])
    window = 1.0 - np.cos(2.0 * math.pi * turned / turned[-1])
    weighted = values * window * np.gradient(turned)
    waves = np.exp(-1j * np.outer(orders, turned))
    return np.asarray(2.0 / turned[-1] * np.abs(waves @ weighted))


def _band_rms(
    values: Floats, period_s: float, bands_hz: Mapping[str, tuple[float, float]]
) -> dict[str, float]:
    """Rms of the part of a signal in each band, by Parseval's theorem."""
    spectrum = np.abs(np.fft.rfft(values)) ** 2
    frequency = np.fft.rfftfreq(len(values), period_s)
    spectrum[1 : (len(values) + 1) // 2] *= 2.0
    return {
        name: math.sqrt(float(np.sum(spectrum[(frequency >= low) & (frequency < high)])))
        / len(values)
        for name, (low, high) in bands_hz.items()
    }


def _envelope(values: Floats, period_s: float, band_hz: tuple[float, float]) -> Floats:
    """Magnitude of the analytic signal of a band, without its mean."""
    spectrum = np.fft.fft(values)
    frequency = np.fft.fftfreq(len(values), period_s)
    inside = (frequency >= band_hz[0]) & (frequency < band_hz[1])
    envelope = np.abs(np.fft.ifft(np.where(inside, 2.0 * spectrum, 0.0)))
    return np.asarray(envelope - envelope.mean())
