"""Fast sensors reduced to features of `features/1`, tied to the turning of the screw. Pure.

Orders are read by the Fourier integral over the angle itself, c(o) = 2 / Theta int a w exp(-i o
theta) d theta with a Hann window w over the turned angle Theta: no resampling, hence no aliasing,
at any course of the speed.
"""

import math
from collections import deque
from collections.abc import Mapping

import numpy as np

from ..messages.features import VibrationColumn
from ..messages.samples import ANGLE, Floats, SampleFrame, Waveform
from ..models.machine import Machine

INTERVAL_S = 1.0
"""Length of an interval of a sensor."""
MOST_SENSORS = 4
"""Sensors of one axis; their names come from the bus."""
PATIENCE_S = 0.5
"""Longest wait for the angle of an interval, which comes another way than the signal."""
SLIP = 0.02
"""Share of an order by which its peak may lie beside it: balls slip."""
LEAST_TURNS = 3.0
"""Orders need at least so many revolutions of the screw."""
_GAP, _CLOSE = 1.5, 0.5
"""Periods without a value that part a signal, and after which the next may follow at the least."""
_ANGLES_S = 10.0
"""So far the angle may be ahead of a signal."""
_SIDES = np.concatenate([np.linspace(-2.8, -1.0, 7), np.linspace(1.0, 2.8, 7)])
"""Evaluation points of an order's surroundings, in units of how far its own peak reaches."""


def orders_of(machine: Machine) -> Mapping[str, float]:
    """Order of the screw, and of the ball passes where the machine file knows the balls."""
    balls = machine.ball_pass_orders
    passes = {} if balls is None else {"nut": balls.on_nut, "screw_track": balls.on_screw}
    return {"screw": 1.0} | {f"ball_pass_{name}": order for name, order in passes.items()}


class AxisVibration:
    """Fast sensors of one axis, reduced to columns of its feature blocks.

    Columns are `SENSOR.WHAT`: rms, peak and kurtosis of the signal without its mean (3 for a
    Gaussian one), the rms in each band, and the peak at each order with the floor beside it, of the
    signal and, as `envelope_ORDER`, of the envelope of the highest band, which shows what taps
    again and again. Orders are missing where the screw turned too little or turned round.

    Args:
        orders: name -> nominal order, per revolution of the screw.
        bands_hz: name -> lower and upper frequency.
    """

    def __init__(
        self, orders: Mapping[str, float], bands_hz: Mapping[str, tuple[float, float]]
    ) -> None:
        self._orders, self._bands_hz = orders, bands_hz
        self._pieces: dict[str, list[Waveform]] = {}
        self._angles: deque[tuple[Floats, Floats]] = deque()
        self._columns: dict[str, list[VibrationColumn]] = {}
        self.gaps = 0
        """Times that a signal broke off; the interval of each is left out."""

    def follow(self, frame: SampleFrame) -> None:
        """Take in the angle of the screw, in the order of time."""
        if ANGLE not in frame.channels or not self._pieces:
            return
        known = np.isfinite(frame.time_s) & np.isfinite(frame.channels[ANGLE])
        time_s, angle_rad = frame.time_s[known], frame.channels[ANGLE][known]
        if not len(time_s):
            return
        if self._angles and time_s[0] < self._angles[-1][0][-1]:
            self._angles.clear()  # a new clock
        self._angles.append((time_s, angle_rad))
        while self._angles[0][0][-1] < time_s[-1] - INTERVAL_S - _ANGLES_S:
            self._angles.popleft()

    def push(self, wave: Waveform) -> bool:
        """Take in the next piece of a signal; False if it is of one sensor too many."""
        if wave.sensor not in self._pieces and len(self._pieces) >= MOST_SENSORS:
            return False
        pieces = self._pieces.setdefault(wave.sensor, [])
        if pieces:
            step_s = wave.start_s - (pieces[-1].end_s - pieces[-1].period_s)
            steps = step_s / pieces[-1].period_s
            if wave.period_s != pieces[-1].period_s or not _CLOSE < steps < _GAP:
                self.gaps += 1
                pieces.clear()
        pieces.append(wave)
        while (cut := self._next_interval(pieces)) is not None:
            self._columns[wave.sensor] = self._reduce(cut)
        return True

    def take(self) -> tuple[VibrationColumn, ...]:
        """Columns of the newest intervals that were completed since the last call."""
        columns = tuple(each for sensor in self._columns.values() for each in sensor)
        self._columns.clear()
        return columns

    def _next_interval(self, pieces: list[Waveform]) -> Waveform | None:
        """Values of the first whole interval of the grid, which go with those before it."""
        first, last_s = pieces[0], pieces[-1].end_s
        period_s, count = first.period_s, round(INTERVAL_S / first.period_s)
        number = math.ceil(first.start_s / INTERVAL_S - 1e-6)
        start = round(number * INTERVAL_S / period_s) - round(first.start_s / period_s)
        end_s = first.start_s + (start + count) * period_s
        if last_s < end_s - 0.5 * period_s:
            return None
        if last_s < end_s + PATIENCE_S and not self._has_angle(end_s):
            return None
        values = np.concatenate([piece.values for piece in pieces])
        rest = values[start + count :]
        pieces[:] = [Waveform(first.sensor, first.unit, end_s, period_s, rest)]
        cut = values[start : start + count]
        return Waveform(first.sensor, first.unit, end_s - count * period_s, period_s, cut)

    def _has_angle(self, end_s: float) -> bool:
        if not self._angles:
            return False
        times = self._angles[-1][0]
        step_s = float(times[-1] - times[0]) / max(len(times) - 1, 1)
        return float(times[-1]) >= end_s - 2.0 * step_s

    def _reduce(self, wave: Waveform) -> list[VibrationColumn]:
        values = np.nan_to_num(wave.values - np.nanmean(wave.values))
        power = float(np.mean(values**2))
        found = {"rms": math.sqrt(power), "peak": float(np.max(np.abs(values)))}
        spectrum = np.abs(np.fft.rfft(values)) ** 2
        frequency = np.fft.rfftfreq(len(values), wave.period_s)
        spectrum[1 : (len(values) + 1) // 2] *= 2.0
        for name, (low, high) in self._bands_hz.items():  # Parseval's theorem
            inside = (frequency >= low) & (frequency < high)
            found[f"{name}_rms"] = math.sqrt(float(np.sum(spectrum[inside]))) / len(values)
        angle = self._angle_at(wave.time_s)
        if angle is not None:
            signals = {"": values}
            if self._bands_hz:
                highest = max(self._bands_hz.values())
                signals["envelope_"] = _envelope(values, wave.period_s, highest)
            for kind, signal in signals.items():
                for name, order in self._orders.items():
                    amplitude, floor = _peak(signal, angle, order)
                    found |= {f"{kind}{name}": amplitude, f"{kind}{name}_floor": floor}
        columns = [VibrationColumn(f"{wave.sensor}.{k}", v, wave.unit) for k, v in found.items()]
        if power > 0.0:
            kurtosis = float(np.mean(values**4)) / power**2
            columns.append(VibrationColumn(f"{wave.sensor}.kurtosis", kurtosis, ""))
        return columns

    def _angle_at(self, time_s: Floats) -> Floats | None:
        """Angle at each value; None where it is unknown, or turned too little or both ways."""
        if not self._angles:
            return None
        known_s = np.concatenate([times for times, _ in self._angles])
        steps = np.diff(known_s)
        if not steps.size or (steps <= 0.0).any():
            return None
        slack_s = 2.0 * float(np.median(steps))
        if known_s[0] > time_s[0] + slack_s or known_s[-1] < time_s[-1] - slack_s:
            return None
        known_rad = np.concatenate([angles for _, angles in self._angles])
        angle: Floats = np.interp(time_s, known_s, known_rad)
        turned = abs(float(angle[-1] - angle[0]))
        both_ways = float(np.sum(np.abs(np.diff(angle)))) > 1.01 * turned
        return None if both_ways or turned < 2.0 * math.pi * LEAST_TURNS else angle


def _peak(values: Floats, angle: Floats, order: float) -> tuple[float, float]:
    """Greatest amplitude near an order, and the typical one beside it."""
    turns = abs(float(angle[-1] - angle[0])) / (2.0 * math.pi)
    reach = max(SLIP * order, 0.5 / turns)
    near = np.linspace(order - reach, order + reach, 2 * math.ceil(reach * turns * 4.0) + 1)
    beside = np.abs(order + max(0.1 * order, 2.5 / turns) * _SIDES)
    turned = np.abs(angle - angle[0])
    window = 1.0 - np.cos(2.0 * math.pi * turned / turned[-1])
    weighted = values * window * np.gradient(turned)
    waves = np.exp(-1j * np.outer(np.concatenate([near, beside]), turned))
    amplitudes = 2.0 / turned[-1] * np.abs(waves @ weighted)
    return float(amplitudes[: len(near)].max()), float(np.median(amplitudes[len(near) :]))


def _envelope(values: Floats, period_s: float, band_hz: tuple[float, float]) -> Floats:
    """Magnitude of the analytic signal of a band, without its mean."""
    spectrum = np.fft.fft(values)
    frequency = np.fft.fftfreq(len(values), period_s)
    inside = (frequency >= band_hz[0]) & (frequency < band_hz[1])
    envelope = np.abs(np.fft.ifft(np.where(inside, 2.0 * spectrum, 0.0)))
    return np.asarray(envelope - envelope.mean())
