"""Vibration: what is periodic in time, and in nothing that the axis is told to do.

Its cause is no entry of the library: a limit cycle, chatter, a filter, the machine next door. A
line or a band of the spectrum counts where white noise stands out as much in one recording of a
hundred (AR(0.9) in rows with pauses in three). What stands out as clearly of the motion's own
spectrum follows the motion, and what the angle tells as well turns with the screw.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage, stats

from ...messages.samples import Booleans, Floats, Integers
from ...models.machine import Machine
from ...regression import FALSE_ALARMS
from ..result import SUREST, VIBRATION, NamedEffect, ParameterValue, Shrink
from ..session.session import CHANNEL_UNITS, Rows, Session, rms
from .noise import ordinary_rms, passed_at, stated_tolerance, structure_of_gap

_WIDTHS = (1, 3, 9, 27, 81)
"""Of a band, in steps of the spectrum; of lines up to the second."""
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
    """Line or band of the spectrum of one channel."""

    channel: str
    frequency_hz: float
    p_value: float  # chance of one as prominent in noise
    part: Floats  # of the gap, (n,)
    size: Floats  # its amplitude at the rows of the channel, in its unit, (n,)

    @property
    def is_there(self) -> Booleans:
        """Rows at which it is about as strong as it gets, (n,)."""
        return self.size > _AS_STRONG * float(self.size.max())

    @property
    def amplitude(self) -> float:
        """Amplitude while it is there."""
        return rms(self.size[self.is_there])

    def taken_from(self, session: Session) -> Session:
        """The session as it would be without it."""

        def calm(other: Session) -> Session:
            other = session.beside(other)
            rows = other.channels[self.channel]
            channels = {**other.channels, self.channel: replace(rows, gap=rows.gap - self.part)}
            return replace(other, channels=channels, beside=calm)

        return calm(Session.of_runs(session.runs, session.baseline, session.modelled))

    def as_cause(self, before: Session, after: Session) -> NamedEffect:
        """A named cause without an entry, by the session with it and without it."""
        rows = before.channels[self.channel]
        from_s, *_, to_s = rows.variables["time_s"][self.is_there].tolist()
        values = {"frequency_hz": (self.frequency_hz, "Hz"), "from_s": (from_s, "s")}
        values |= {"to_s": (to_s, "s"), "amplitude": (self.amplitude, CHANNEL_UNITS[self.channel])}
        here = 1.0 - after.channels[self.channel].rms / rows.rms
        return NamedEffect(
            name=VIBRATION,
            channel=self.channel,
            probability=min(1.0 - self.p_value, SUREST),
            tied=(VIBRATION,),
            shrink=Shrink(estimate=0.0, low=0.0, high=max(here, 0.0)),
            parameters={n: ParameterValue(value=v, unit=u) for n, (v, u) in values.items()},
            entries=(),
        )


def strongest_vibration(session: Session, machine: Machine) -> Vibration | None:
    """The vibration that matters most; None where there is none."""
    structure, strongest, most = structure_of_gap(session), None, 1.0
    for channel, rows in session.channels.items():
        rest = rows.gap - structure[channel]
        each = _strongest(session, channel, rest)
        if each is not None:
            floor = session.healthy_floor.get(channel, ordinary_rms(rest - each.part))
            tolerated = stated_tolerance(machine, {channel: floor}, session.torque_rms_nm)[channel]
            if rms(each.part) / tolerated > most:
                strongest, most = each, rms(each.part) / tolerated
    return strongest


def _places(rows: Rows) -> Integers:
    """Place of each row on an even grid of time, (n,)."""
    time_s = rows.variables["time_s"]
    return np.asarray(np.round((time_s - time_s[0]) / np.median(np.diff(time_s))), dtype=np.int64)


def hidden_vibration(rows: Rows) -> str:
    """Reason why a channel has no spectrum; empty where it has one."""
    place = _places(rows)
    if np.any(np.diff(place) < 1):
        return "rows are not evenly in order"
    is_usual = _LEAST_ROWS < int(place[-1]) + 1 < _MOST_ROWS
    return "" if is_usual else f"{len(place)} rows, expected {_LEAST_ROWS} to {_MOST_ROWS}"


def _strongest(session: Session, channel: str, rest: Floats) -> Vibration | None:
    """Strongest vibration of a residual (n,); None where nothing stands out but the motion."""
    rows, low_pass = session.channels[channel], session.runs[0].low_pass
    if hidden_vibration(rows):
        return None
    time_s, place = rows.variables["time_s"], _places(rows)
    count = int(place[-1]) + 1
    step_hz = 1.0 / (count * float(np.median(np.diff(time_s))))
    passed_hz = math.inf if len(low_pass.taps) == 1 else low_pass.cutoff_hz
    raised, floor = _spectrum(place, rest, count)
    band = _greatest_band(raised, floor, int(min(passed_hz / step_hz, _MOST_OF_RATE * count)))
    if band is None or band[3] < _turning(rows, rest, session.baseline.ratio_m_per_rad):
        return None
    middle, width, p_value, _ = band
    steps = slice(max(middle - width // 2, 0), middle + width // 2 + 1)
    motion = _commanded(session, channel)
    forms = (motion, np.abs(motion), np.sign(motion), np.gradient(motion))
    asked = max(_spectrum(place, form, count)[0][steps].mean() for form in forms)
    if asked > _FOLLOWS * raised[steps].mean():
        return None
    tried_hz = (middle + np.linspace(-1.0, 1.0, 41)) * step_hz
    waves = np.exp(-2j * math.pi * np.outer(tried_hz, time_s))
    best = int(np.argmax(np.abs(waves @ rest)))
    grid = np.zeros((2, count), np.complex128)  # with what was recorded of it
    grid[:, place] = 2.0 * rest * waves[best], np.ones(len(rest))
    reach = 2 * count if width <= _WIDTHS[1] else 2 * count // width
    slow, there = ndimage.uniform_filter1d(grid, reach, mode="constant")[:, place]
    slow /= there
    passed = float(passed_at(tried_hz[best:][:1], low_pass)[0])
    part = (slow / waves[best]).real
    return Vibration(channel, float(tried_hz[best]), p_value, part, np.abs(slow) / passed)


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


def _spectrum(place: Integers, values: Floats, count: int) -> tuple[Floats, Floats]:
    """Energy of values (n,) at places of a grid, over the floor around it, and the floor, (k,)."""
    grid = np.bincount(place, values - values.mean(), minlength=count)
    energy = np.abs(np.fft.rfft(grid)) ** 2 * 2.0 / len(values)
    middles = np.unique(np.geomspace(_LEAST_PERIODS, len(energy) - 1, 80).astype(np.int64))
    levels = [np.median(energy[int(k / _AROUND) : int(k * _AROUND) + 1]) for k in middles]
    log = np.interp(np.arange(len(energy)), middles, np.log(np.maximum(levels, 1e-300)))
    floor = np.asarray(np.exp(log) / math.log(2.0))
    return energy / floor, floor


def _greatest_band(
    raised: Floats, floor: Floats, highest: int
) -> tuple[int, int, float, float] | None:
    """Middle, width, p-value and energy beyond the floor of the narrowest band that has most.

    The mean of a band over its floor has Snedecor's F distribution, for noise is exponential in
    each step; the p-value is that of the most prominent of all bands up to a `highest` step.
    """
    middles = np.arange(_LEAST_PERIODS, len(raised))
    around = np.minimum(_AROUND * middles, len(raised)) - middles / _AROUND
    found = []
    for width in _WIDTHS:
        mean, energy = (
            ndimage.uniform_filter1d(each, width, mode="constant")[_LEAST_PERIODS:]
            for each in (raised, (raised - 1.0) * floor)
        )
        chance = stats.f.sf(mean, 2 * width, 2.0 * _OF_MEDIAN * around)
        usable = (width <= middles / _LEAST_QUALITY) & (middles <= highest)
        chance = np.where(usable, chance * len(middles) * len(_WIDTHS), 1.0)
        k = int(np.argmax(np.where(chance < FALSE_ALARMS, energy, -math.inf)))
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
