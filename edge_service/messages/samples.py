"""Samples of one axis at the native rate of its drive: channels, units, quality, waveforms."""

import math
import operator
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from importlib.resources import files
from typing import Annotated

import numpy as np
import numpy.typing as npt
from pydantic import ConfigDict, Field


@dataclass(frozen=True, slots=True)
class Channel:
    """One measured quantity: its column name, unit and meaning."""

    name: str
    unit: str
    description: str


@dataclass(frozen=True, slots=True)
class ColumnMap:
    """One column of a recording: SI value = `scale` * (column - `minus`) + `offset`.

    With a `direction` the column has no sign of its own, such as a supply current, and takes that
    of the direction in which the other column changes, or changed last.
    """

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)

    column: str
    scale: float = 1.0
    offset: float = 0.0
    minus: Annotated[str, Field(exclude_if=operator.not_)] = ""
    direction: Annotated[str, Field(exclude_if=operator.not_)] = ""

    @property
    def names(self) -> tuple[str, ...]:
        """Every column that it needs."""
        return tuple(filter(None, (self.column, self.minus, self.direction)))


TIME = "time_s"
TORQUE = "torque_command_nm"
ANGLE = "motor_angle_rad"
MOTOR_SPEED = "motor_speed_rad_s"
TABLE_POSITION = "table_position_m"
TABLE_SPEED = "table_speed_m_s"
SETPOINT = "position_setpoint_m"
TEMPERATURE = "temperature_c"
EXTERNAL_FORCE = "external_force_n"

CHANNELS: dict[str, Channel] = {
    channel.name: channel
    for channel in (
        Channel(TORQUE, "N m", "torque command at the motor shaft"),
        Channel(ANGLE, "rad", "rotary encoder, multi-turn"),
        Channel(MOTOR_SPEED, "rad/s", "speed as the drive derives it"),
        Channel(TABLE_POSITION, "m", "linear encoder"),
        Channel(TABLE_SPEED, "m/s", "table speed"),
        Channel(SETPOINT, "m", "commanded table position"),
        Channel(TEMPERATURE, "degC", "nut or housing temperature"),
        Channel(EXTERNAL_FORCE, "N", "measured external force on the table"),
    )
}
"""Every known channel except `time_s`, in the order in which they are written."""

POSITION_CHANNELS = (ANGLE, TABLE_POSITION)


def _plain(text: str) -> str:
    return re.sub(r"[\s.,·⋅*×'−-]", "", text.casefold().replace("μ", "u"))


_UNITS = tomllib.loads((files(__package__) / "units.toml").read_text("utf-8"))
SI = {unit: (line[0], si) for si, units in _UNITS.items() for unit, line in units.items()}
"""Unit -> factor to SI, SI unit. Degrees Celsius, shares, counts and volts are their own."""
_SPELLED = [(_plain(text), u) for us in _UNITS.values() for u in us for text in (u, *us[u][1:])]


def units_spelled(text: str) -> list[str]:
    """Units that may be written so, as they are called here: `nm` is a length, and N m, too."""
    able = [unit for spelled, unit in _SPELLED if spelled == _plain(text)]
    return sorted(able, key=lambda unit: unit.replace(" ", "") != re.sub(r"\W", "", text))


def factor_to(unit: str, wanted: str, lead_m: float) -> float | None:
    """Factor from `unit` to the SI unit `wanted`; None where they measure different things.

    Travel of the table and turning of the screw are linked by the lead, 2 pi / lead rad per m.
    """
    factor, si_unit = SI[unit]
    turning = 2.0 * math.pi / lead_m
    links = {("m", "rad"): turning, ("m/s", "rad/s"): turning}
    links |= {(turned, moved): 1.0 / turning for moved, turned in links}
    link = 1.0 if si_unit == wanted else links.get((si_unit, wanted))
    return None if link is None else factor * link


Floats = npt.NDArray[np.float64]
Booleans = npt.NDArray[np.bool_]
Integers = npt.NDArray[np.int64]
Qualities = npt.NDArray[np.uint8]
"""One code of `Quality` per sample, shape (n,)."""

_UNCERTAIN_FROM, _BAD_FROM = 64, 128


class Quality(IntEnum):
    """Code of one sample. A bad sample's value is NaN: nobody can read it by mistake."""

    GOOD = 0

    SOURCE_UNCERTAIN = 64  # the device itself says so
    LATE_READ = 65  # the read took so long that its time is doubtful
    OVERFLOW = 66  # the device's queue ran over: samples before this one are lost
    NO_SOURCE_TIME = 67  # the device gave no time; that of its arrival stands in

    NO_VALUE = 128  # nothing has been received yet, or no longer
    NO_REPLY = 129  # the device did not answer in time, or hung up
    DEVICE_EXCEPTION = 130  # the device refused with an exception
    MALFORMED = 131  # a reply that contradicts the protocol or the request
    NOT_A_NUMBER = 132  # NaN, infinite or no number at all
    OUT_OF_RANGE = 133  # outside what the configuration calls possible
    SOURCE_BAD = 134  # the device itself says so
    STALE = 135  # the device repeats old values
    WRONG_CONSTANT = 136  # a value that never changes reads otherwise: wrong map or word order

    @property
    def level(self) -> str:
        """Use of the sample to a reader: `good`, `uncertain` or `bad`."""
        if self < _UNCERTAIN_FROM:
            return "good"
        return "uncertain" if self < _BAD_FROM else "bad"


def is_bad(codes: Qualities) -> Booleans:
    """Mask of the samples that must not be read, shape (n,)."""
    return np.asarray(codes >= _BAD_FROM)


def is_uncertain(codes: Qualities) -> Booleans:
    """Mask of the samples that may be read with doubt only, shape (n,)."""
    return np.asarray((codes >= _UNCERTAIN_FROM) & (codes < _BAD_FROM))


@dataclass(frozen=True, slots=True, eq=False)
class Waveform:
    """Consecutive values of one sensor at a rate of its own."""

    sensor: str  # its name, e.g. `nut_acceleration`
    unit: str  # of the values, e.g. `m/s^2`
    start_s: float  # time of the first value on the axis' clock, s
    period_s: float  # between two values, s
    values: Floats  # shape (n,); NaN is a missing value

    def __len__(self) -> int:
        return len(self.values)

    @property
    def end_s(self) -> float:
        """Time at which the value after the last one is due, s."""
        return self.start_s + len(self) * self.period_s

    @property
    def time_s(self) -> Floats:
        """Times of the values, s, shape (n,)."""
        return self.start_s + self.period_s * np.arange(len(self), dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class SampleFrame:
    """A run of consecutive samples of one axis."""

    time_s: Floats  # the axis' own clock, s, shape (n,)
    # channel name -> values in SI units, shape (n,) each; NaN is a missing value. Times may repeat,
    # jump or run backwards: judging that is the downsampler's work
    channels: Mapping[str, Floats]
    # channel name -> code of `Quality` per sample, shape (n,); a channel without is good where it
    # has a number
    quality: Mapping[str, Qualities] = field(default_factory=dict)
    # what faster sensors of the axis measured meanwhile, on the same clock
    waveforms: tuple[Waveform, ...] = ()

    def __post_init__(self) -> None:
        for name, values in self.channels.items():
            if values.shape != self.time_s.shape:
                raise ValueError(
                    f"channel {name}: shape {values.shape}, time has {self.time_s.shape}"
                )
        for name, codes in self.quality.items():
            if name not in self.channels or codes.shape != self.time_s.shape:
                raise ValueError(f"quality of {name}: no channel of that name and shape")

    def __len__(self) -> int:
        return int(self.time_s.shape[0])

    def part(self, rows: slice | Booleans | Integers) -> "SampleFrame":
        """Some of the samples, without waveforms; quality where some is not good."""
        return SampleFrame(
            self.time_s[rows],
            {name: values[rows] for name, values in self.channels.items()},
            {name: codes[rows] for name, codes in self.quality.items() if codes[rows].any()},
        )
