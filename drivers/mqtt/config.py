"""User configuration of an MQTT source: broker, topic, and what its JSON means."""

from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator, model_validator

from edge_service.config_tables import BrokerAccess

from ..base import DriverConfig
from ..signals import SignalConfig, check_channels
from .members import check_member

TimeUnit = Literal["s", "ms", "us", "ns", "iso"]


class MemberConfig(SignalConfig):
    """One channel of a map.

    Attributes:
        member: its place in a message, `data.torque`, `values.*.torque` or `vals.id=101.val`.
    """

    channel: str
    member: str

    @field_validator("member")
    @classmethod
    def _is_a_place(cls, value: str) -> str:
        return check_member(value)


class MqttSourceConfig(BrokerAccess, DriverConfig):
    """Settings of the MQTT driver. Without `signals` the JSON is that of Industrial Edge's capture.

    Attributes:
        topic: filter of the topic that one capture or device sends on.
        client_id: the broker knows us again by it; must be ours alone.
        keep_session: the broker keeps what comes while we are away.
        timeout_s: for each answer of the broker.
        largest_mb: of a message; a larger one is skipped.
        axis_number: the controller's number of the axis, in place of the machine file's.
        time: member with the time of a message or of each sample; that of arrival without.
        time_unit: of it; `iso` is a text such as 2026-01-31T12:00:00.000Z.
        period_s: between the samples of one message, where it holds one time for all.
        signals: the map.
    """

    topic: str = Field(min_length=1, max_length=1000)
    client_id: str | None = Field(None, min_length=1, max_length=200)
    keep_session: bool = True
    timeout_s: float = Field(5.0, gt=0.0, le=60.0)
    largest_mb: float = Field(4.0, gt=0.0, le=64.0)
    axis_number: int | None = Field(None, ge=1)
    time: str | None = None
    time_unit: TimeUnit = "s"
    period_s: float | None = Field(None, gt=0.0, le=3600.0)
    signals: tuple[MemberConfig, ...] = ()

    @field_validator("topic")
    @classmethod
    def _is_a_filter(cls, value: str) -> str:
        levels = value.split("/")
        wild = [level for level in levels if "+" in level or "#" in level]
        if any(level not in ("+", "#") for level in wild) or "#" in levels[:-1] or "\0" in value:
            raise ValueError(f"{value!r}: + and # stand for whole levels, and # for the last ones")
        return value

    @field_validator("time")
    @classmethod
    def _is_a_place(cls, value: str | None) -> str | None:
        return None if value is None else check_member(value)

    @model_validator(mode="after")
    def _check_map(self) -> "MqttSourceConfig":
        if self.signals:
            check_channels("signals", self.signals)
            if self.axis_number is not None:
                raise ValueError("axis_number: without meaning beside signals")
        for key in ("time", "period_s"):
            if getattr(self, key) is not None and not self.signals:
                raise ValueError(f"{key}: is for a map, and there are no signals")
        return self

    @property
    def address(self) -> Path:
        """Broker and topic, for messages."""
        return Path(f"{self.host}:{self.port}/{self.topic}")
