"""A measured value of a device and the channel that it becomes: unit, sign and bounds declared."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict, field_validator, model_validator

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
    """Settings of one signal. Value in `unit` = `scale` * raw + `offset`.

    Attributes:
        channel: the channel that it becomes.
        unit: of the scaled value; the channel's own unless given.
        scale: a negative one turns the sign.
        low, high: of the scaled value; outside it is bad, as no such value is possible.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    channel: str | None = None
    unit: str | None = None
    scale: float = 1.0
    offset: float = 0.0
    low: float | None = None
    high: float | None = None

    @field_validator("channel")
    @classmethod
    def _known_channel(cls, value: str | None) -> str | None:
        if value is not None and value not in CHANNELS:
            raise ValueError(f"no channel {value!r}; expected one of {', '.join(CHANNELS)}")
        return value

    @field_validator("unit")
    @classmethod
    def _known_unit(cls, value: str | None) -> str | None:
        if value is not None and value not in SI:
            raise ValueError(f"unknown unit {value!r}; expected one of {', '.join(SI)}")
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
