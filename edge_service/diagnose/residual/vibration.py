"""Vibration: what is periodic in time, and in nothing that the axis is told to do.

Its cause is no entry of the library: a limit cycle, chatter, a filter, the machine next door. A
line or a band of the spectrum counts where it stands out of the floor around it more than white
noise does in one recording of a hundred, over all frequencies and widths that are tried; noise that
wanders, AR(0.9), in rows with pauses does so in 3 of a hundred. What stands out
as clearly of the motion's own spectrum follows the motion, and what the angle tells as well turns
with the screw: neither is a vibration.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, stats

from ...messages.samples import Booleans, Floats, Integers
from ...models.machine import Machine
from ..session.session import CHANNEL_UNITS, Rows, Session, rms
from .noise import ordinary_rms, stated_tolerance
from .structure import passed_at, structure_of_gap

Complexes = NDArray[np.complex128]

FALSE_ALARMS = 0.01
"""Rate of lines and bands found in white noise, over all that are tried in a channel."""
_WIDTHS = (1, 3, 9, 27, 81)
"""Of a band, in steps of the spectrum."""
_WHOLE = 0.8
"""Part of the greatest band's energy from which on a narrower one is preferred."""
_LEAST_PERIODS, _LEAST_ROWS, _MOST_ROWS = 20, 512, 2**22
_MOST_OF_RATE = 0.4
"""Of the rate of the rows: up to a half of it frequencies are told apart."""
_AROUND = 1.5
"""Ratio of frequencies up to which the spectrum is the floor of the one between."""
_OF_MEDIAN, _LEAST_QUALITY = 0.48, 5.0
"""Efficiency of the median of exponential variables; frequency of a band over its width."""
_FOLLOWS = 0.25
"""Of the prominence in the gap: as prominent in the motion, it is the motion's."""
_STEPS_PER_TURN = 256
_AS_STRONG = 0.5
"""Part of the greatest amplitude with which it is there."""


@dataclass(frozen=True, slots=True, eq=False)
class Vibration:
    """Line or band of the spectrum of one channel.

    Attributes:
        p_value: chance of one as prominent in noise.
        time_s: of the rows of the channel, (n,).
        slow: its amplitude and phase at the rows, in the unit of the channel, complex, (n,).
        passed: part of it that the low-pass of the comparison lets pass.
    """

    channel: str
    frequency_hz: float
    p_value: float
    time_s: Floats
    slow: Complexes
    passed: float

    @property
    def part(self) -> Floats:
        """Its part of the gap, (n,)."""
        wave: Complexes = self.slow * np.exp(2j * math.pi * self.frequency_hz * self.time_s)
        return self.passed * wave.real

    @property
    def is_there(self) -> Booleans:
        """Rows at which it is about as strong as it gets, (n,)."""
        size = np.abs(self.slow)
        return size > _AS_STRONG * float(size.max())

    @property
    def amplitude(self) -> float:
        """Amplitude while it is there."""
        return rms(np.abs(self.slow[self.is_there]))

    @property
    def words(self) -> str:
        """Sentence on one that comes and goes beside a force that is named."""
        unit = CHANNEL_UNITS[self.channel]
        size = f"{self.frequency_hz:.3g} Hz with {self.amplitude:.3g} {unit}"
        return f"{self.channel}: it oscillates at {size} now and then, as a force of cutting does"

    def taken_from(self, session: Session) -> Session:
        """The session as it would be without it."""

        def calm(other: Session) -> Session:
            other = session.beside(other)
            rows = other.channels[self.channel]
            channels = {**other.channels, self.channel: replace(rows, gap=rows.gap - self.part)}
            return replace(other, channels=channels, beside=calm)

        return calm(Session.of_runs(session.runs, session.baseline, session.modelled))


def strongest_vibration(session: Session, machine: Machine) -> Vibration | None:
    """The vibration that matters most; None where there is none."""
    structure, strongest, most = structure_of_gap(session), None, 1.0
    for channel, rows in session.channels.items():
        rest, motion = rows.gap - structure[channel], _commanded(session, channel)
        each = _strongest(session, channel, rest, motion)
        if each is not None:
            floor = session.healthy_floor.get(channel, ordinary_rms(rest - each.part))
            tolerated = stated_tolerance(machine, {channel: floor}, session.torque_rms_nm)[channel]
            if rms(each.part) / tolerated > most:
                strongest, most = each, rms(each.part) / tolerated
    return strongest


def _commanded(session: Session, channel: str) -> Floats:
    """Speed that is commanded, or measured where no set point is known, at the rows, (n,)."""
    speeds = []
    for run, rows in zip(session.runs, session.rows[channel], strict=True):
        setpoint_m = run.setpoint_m
        if setpoint_m is not None:
            speeds.append(run.low_pass.at(np.diff(setpoint_m, prepend=setpoint_m[0]), rows))
        elif len(rows):
            return session.channels[channel].variables["motor_speed_rad_s"]
    return np.concatenate(speeds)


def _strongest(session: Session, channel: str, rest: Floats, motion: Floats) -> Vibration | None:
    """Strongest vibration of a residual (n,); None where nothing stands out but the motion."""
    rows = session.channels[channel]
    time_s = rows.variables["time_s"]
    period_s = float(np.median(np.diff(time_s)))
    place = np.round((time_s - time_s[0]) / period_s).astype(np.int64)
    count = int(place[-1]) + 1
    if not _LEAST_ROWS < count < _MOST_ROWS or np.any(np.diff(place) < 1):
        return None
    spectrum = _Spectrum.of(place, rest, count)
    low_pass, step_hz = session.runs[0].low_pass, 1.0 / (count * period_s)
    passed_hz = math.inf if len(low_pass.taps) == 1 else low_pass.cutoff_hz
    best = spectrum.strongest(int(min(passed_hz / step_hz, _MOST_OF_RATE * count)))
    if best is None:
        return None
    middle, width, p_value, energy = best
    forms = (motion, np.abs(motion), np.sign(motion), np.gradient(motion))
    asked = max(_Spectrum.of(place, form, count).prominence(middle, width) for form in forms)
    if asked > _FOLLOWS * spectrum.prominence(middle, width):
        return None
    if energy < _turning(rows, rest, session.baseline.ratio_m_per_rad):
        return None
    tried_hz = (middle + np.linspace(-1.0, 1.0, 41)) * step_hz
    waves = np.exp(-2j * math.pi * np.outer(tried_hz, time_s))
    frequency_hz = float(tried_hz[np.argmax(np.abs(waves @ rest))])
    turned = rest * np.exp(-2j * math.pi * frequency_hz * time_s)
    slow: Complexes = np.full(len(rest), 2.0 * turned.mean(), np.complex128)
    if width > _WIDTHS[1]:
        grids = (
            np.bincount(place, each, count) for each in (turned.real, turned.imag, turned.real**0)
        )
        real, imaginary, there = (
            ndimage.gaussian_filter1d(each, 0.5 * count / width, mode="constant")[place]
            for each in grids
        )
        slow = 2.0 * (real + 1j * imaginary) / there
    passed = float(passed_at(np.array([frequency_hz]), low_pass)[0])
    return Vibration(channel, frequency_hz, p_value, time_s, slow / passed, passed)


@dataclass(frozen=True, slots=True, eq=False)
class _Spectrum:
    """Energy of a series in each step of frequency, and the floor around it, (k,)."""

    energy: Floats
    floor: Floats

    @classmethod
    def of(cls, place: Integers, values: Floats, count: int) -> "_Spectrum":
        """Spectrum of values (n,) at places of a grid; what was not recorded is nothing."""
        grid = np.bincount(place, values - values.mean(), minlength=count)
        energy = np.abs(np.fft.rfft(grid)) ** 2 * 2.0 / len(values)
        middles = np.unique(np.geomspace(_LEAST_PERIODS, len(energy) - 1, 80).astype(np.int64))
        levels = [
            float(np.median(energy[int(k / _AROUND) : int(k * _AROUND) + 1])) for k in middles
        ]
        log = np.interp(np.arange(len(energy)), middles, np.log(np.maximum(levels, 1e-300)))
        return cls(energy, np.exp(log) / math.log(2.0))

    def prominence(self, middle: int, width: int) -> float:
        """Energy of a band over that of its floor."""
        band = slice(max(middle - width // 2, 0), middle + width // 2 + 1)
        return float(np.mean(self.energy[band] / self.floor[band]))

    def strongest(self, highest: int) -> tuple[int, int, float, float] | None:
        """Middle, width, p-value and energy beyond the floor of the narrowest band that has most.

        Args:
            highest: step up to which they are sought.

        The mean of a band over its floor has Snedecor's F distribution, for noise is exponential
        in each step; the p-value is that of the most prominent of all bands.
        """
        middles = np.arange(_LEAST_PERIODS, len(self.energy))
        around = np.minimum(_AROUND * middles, len(self.energy)) - middles / _AROUND
        raised, beyond = self.energy / self.floor, self.energy - self.floor
        found = []
        for width in _WIDTHS:
            mean, energy = (
                ndimage.uniform_filter1d(each, width, mode="constant")[_LEAST_PERIODS:]
                for each in (raised, beyond)
            )
            chance = stats.f.sf(mean, 2 * width, 2.0 * _OF_MEDIAN * around)
            usable = (width <= middles / _LEAST_QUALITY) & (middles <= highest)
            chance = np.where(usable, chance, 1.0)
            chance *= len(middles) * len(_WIDTHS)
            k = int(np.argmax(np.where(chance < FALSE_ALARMS, width * energy, -math.inf)))
            if chance[k] < FALSE_ALARMS:
                found.append((int(middles[k]), width, float(chance[k]), float(width * energy[k])))
        most = max((energy for *_, energy in found), default=0.0)
        return next((each for each in found if each[3] >= _WHOLE * most), None)


def _turning(rows: Rows, rest: Floats, ratio_m_per_rad: float) -> float:
    """Energy of the strongest wave over the angle, also of one that turns with the direction."""
    angle_rad = rows.variables["table_position_m"] / ratio_m_per_rad
    place = np.round((angle_rad - angle_rad.min()) * _STEPS_PER_TURN / (2.0 * math.pi))
    waves = [
        np.fft.rfft(np.bincount(place.astype(np.int64), values))
        for values in (rest, rest * np.sign(rows.variables["direction"]))
    ]
    return 2.0 * max(float(np.max(np.abs(each[1:]) ** 2)) for each in waves) / len(rest)
