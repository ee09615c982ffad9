"""A measured value of a device and the channel that it becomes: unit, sign and bounds declared."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationInfo, field_validator, model_validator

from edge_service.messages.samples import (
    ANGLE,
    CHANNELS,
    SI,
    TABLE_POSITION,
    TORQUE,
    Quality,
    factor_to,
)
from edge_service.models.machine import Machine

from .base import DriverMisconfiguredError

JOINT_CHANNELS = (TORQUE, ANGLE, TABLE_POSITION)
"""A row without one of these that its driver reads is a hole; they must be read together."""


class SignalConfig(BaseModel):
    """Settings of one signal. Value in `unit` = `scale` * raw + `offset`."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    channel: str | None = None  # that it becomes
    unit: str | None = None  # of the scaled value; the channel's own unless given
    scale: float = 1.0  # a negative one turns the sign
    offset: float = 0.0
    low: float | None = None  # of the scaled value; none below is possible, and so it is bad
    high: float | None = None  # of the scaled value; none above is possible

    @field_validator("channel", "unit")
    @classmethod
    def _is_known(cls, value: str | None, info: ValidationInfo) -> str | None:
        known = CHANNELS if info.field_name == "channel" else SI
        if value is not None and value not in known:
            words = f"unknown {info.field_name} {value!r}"
            raise ValueError(f"{words}; expected one of {', '.join(known)}")
        return value

    @model_validator(mode="after")
    def _sane(self) -> "SignalConfig":
        if self.scale == 0.0:
            raise ValueError("scale must not be 0")
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise ValueError(f"low {self.low:g} must lie below high {self.high:g}")
        return self

    @property
    def declared_unit(self) -> str:
        """The unit of the scaled value: as given, or the channel's own."""
        return self.unit or (CHANNELS[self.channel].unit if self.channel else "")


@cache
def ends(kind: str) -> tuple[float, float]:
    """Least and greatest number of a type, such as `int16` or `float32`."""
    info = np.finfo(kind) if kind.startswith("float") else np.iinfo(kind)
    return float(info.min), float(info.max)


class Sentinels:
    """Finds numbers that end their type's range, far from those before: they stand for none."""

    def __init__(self) -> None:
        self._before: dict[str, float] = {}

    def has(self, channel: str, raw: float, kind: str) -> bool:
        (low, high), before = ends(kind), self._before.get(channel, math.nan)
        if raw in (low, high) and raw != 0.0 and not abs(raw - before) <= high / 256.0:
            return True
        self._before[channel] = raw
        return False


def check_channels(key: str, signals: Sequence[SignalConfig]) -> None:
    """Raise ValueError if a channel is there twice, or none that makes rows."""
    channels = [each.channel for each in signals if each.channel is not None]
    for channel in channels:
        if channels.count(channel) > 1:
            raise ValueError(f"{key}: {channel} appears more than once")
    if not set(channels) & set(JOINT_CHANNELS):
        raise ValueError(f"{key}: expected one of {', '.join(JOINT_CHANNELS)}")


@dataclass(frozen=True, slots=True)
class Scaling:
    """Conversion of a raw number to the channel in SI units, and back."""

    factor: float
    offset: float
    low: float
    high: float

    @classmethod
    def of(cls, config: SignalConfig, machine: Machine, key: str) -> "Scaling":
        """The scaling that a signal declares; `key` is its place in the configuration.

        Raises DriverMisconfiguredError: the unit does not measure what the channel means.
        """
        assert config.channel is not None
        wanted = CHANNELS[config.channel].unit
        unit = config.declared_unit
        to_si = factor_to(unit, wanted, machine.axis.lead_m)
        if to_si is None:
            raise DriverMisconfiguredError(
                f"{key}.unit", f"{unit!r} is no unit of {config.channel}, which is in {wanted!r}"
            )
        low = -math.inf if config.low is None else to_si * config.low
        high = math.inf if config.high is None else to_si * config.high
        return cls(to_si * config.scale, to_si * config.offset, low, high)

    def si(self, raw: float) -> tuple[float, Quality]:
        """Value in SI units and its quality; NaN where it is bad."""
        value = self.factor * raw + self.offset
        if not math.isfinite(value):
            return math.nan, Quality.NOT_A_NUMBER
        if not self.low <= value <= self.high:
            return math.nan, Quality.OUT_OF_RANGE
        return value, Quality.GOOD

    def raw(self, value: float) -> float:
        """Raw value that a device would report for a value in SI units."""
        return (value - self.offset) / self.factor


def scalings(signals: Sequence[SignalConfig], machine: Machine, key: str) -> dict[str, Scaling]:
    """Those of the signals that become channels, in the channels' order. Raises as `of`."""
    at = {signal.channel: number for number, signal in enumerate(signals)}
    return {
        name: Scaling.of(signals[at[name]], machine, f"{key}[{at[name]}]")
        for name in CHANNELS
        if name in at
    }
