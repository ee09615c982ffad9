"""A connection to a broker, and what a user sets of the JSON that comes over it."""

import asyncio
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal, Self

import aiomqtt
from aiomqtt.exceptions import MqttConnectError
from paho.mqtt.reasoncodes import ReasonCode
from pydantic import Field, field_validator, model_validator

from edge_service.broker import ANSWER_S, BrokerConfig
from edge_service.retry import heed_cancellation

from ..base import DriverConfig, DriverMisconfiguredError, DriverUnavailableError
from ..signals import SignalConfig, check_channels

KEEPALIVE_S = 10
"""A broker that says nothing for half as long again is lost."""
GOODBYE_S = 1.0
MOST_WAITING = 1000
"""Messages that wait to be read; further ones are dropped, and the count of samples tells it."""
_REFUSED = {132: "url", 133: "url", 134: "password", 135: "url", 138: "url"}
"""Reason of a refusal that trying again does not change -> the key to look at."""
_REFUSED_FROM = 128
_DEEPEST = 32


def check_member(member: str) -> str:
    """The place itself. Raises ValueError if it is none."""
    parts = member.split(".")
    if not all(parts) or len(parts) > _DEEPEST:
        raise ValueError(f"{member!r}: expected names with dots between, such as data.torque")
    return member


class MemberConfig(SignalConfig):
    """One channel of a map."""

    channel: str
    member: str  # its place in a message, `data.torque`, `values.*.torque` or `vals.id=101.val`

    _is_a_place = field_validator("member")(check_member)


class MqttSourceConfig(BrokerConfig, DriverConfig):
    """Settings of the MQTT driver; `deploy/drivers/mqtt.toml` tells of each."""

    topic: str = Field(min_length=1, max_length=1000)
    time: str | None = None
    time_unit: Literal["s", "ms", "us", "ns", "iso"] = "s"
    period_s: float | None = Field(None, gt=0.0, le=3600.0)
    signals: tuple[MemberConfig, ...] = ()  # the map

    @field_validator("topic")
    @classmethod
    def _is_a_filter(cls, value: str) -> str:
        levels = value.split("/")
        wild = [level for level in levels if "+" in level or "#" in level]
        if any(level not in ("+", "#") for level in wild) or "#" in levels[:-1] or "\0" in value:
            raise ValueError(f"{value!r}: + and # stand for whole levels, and # for the last ones")
        return value

    @model_validator(mode="after")
    def _check_map(self) -> Self:
        if self.signals:
            check_channels("signals", self.signals)
        for key in ("time", "period_s"):
            if getattr(self, key) is not None and not self.signals:
                raise ValueError(f"{key}: is for a map, and there are no signals")
        if self.time is not None:
            check_member(self.time)
        return self

    @property
    def address(self) -> Path:
        """Broker and topic, for messages."""
        return Path(f"{self.where}/{self.topic}")


class MqttLink:
    """One connection of one client.

    Args:
        client_id: ours, for which the broker keeps subscription and messages while we are away;
            with None it keeps nothing.
    """

    def __init__(self, config: MqttSourceConfig, client_id: str | None) -> None:
        self._config, self._client_id = config, client_id
        self._client: aiomqtt.Client | None = None
        self._entering: asyncio.Future[Any] | None = None
        self._is_subscribed = self._ended = False

    @property
    def connected(self) -> bool:
        """Return whether messages come: subscribed, and no loss has been noticed."""
        held = self._client is not None and not self._client._disconnected.done()
        return held and self._is_subscribed

    async def connect(self) -> None:
        """Connect. Raises DriverUnavailableError and DriverMisconfiguredError."""
        # samples without a time that a broker had kept would pass for new ones
        is_undated = bool(self._config.signals) and self._config.time is None
        try:
            client = self._client = self._config.client(
                self._client_id,
                keepalive=KEEPALIVE_S,
                clean_session=self._client_id is None or is_undated,
                max_queued_incoming_messages=MOST_WAITING,
            )
            client._client.connect_timeout = ANSWER_S
            self._entering = asyncio.ensure_future(client.__aenter__())
            await asyncio.shield(self._entering)  # the library's thread goes on when cancelled
        except (aiomqtt.MqttError, ValueError) as error:
            await self.close()
            raise self._told(error) from None
        heed_cancellation()

    async def subscribe(self, topic: str) -> None:
        """Ask for messages, each at least once. Raises like `connect`."""
        try:
            granted = await self._require().subscribe(topic, qos=1)
        except aiomqtt.MqttError as error:
            raise self._told(error) from None
        heed_cancellation()
        if any(_code(each) >= _REFUSED_FROM for each in granted):
            raise DriverMisconfiguredError("topic", f"{self._config.where}: refused {topic!r}")
        self._is_subscribed = True

    async def publish(self, topic: str, payload: bytes) -> None:
        """Send a message, at least once. Raises like `connect`."""
        try:
            await self._require().publish(topic, payload, qos=1)
        except aiomqtt.MqttError as error:
            raise self._told(error) from None
        heed_cancellation()

    async def next(self) -> aiomqtt.Message | None:
        """The next message; None after `close`. Raises DriverUnavailableError."""
        message: aiomqtt.Message | None = None
        with suppress(aiomqtt.MqttError):
            if not self._ended:
                message = await anext(self._require().messages)
        heed_cancellation()
        if message is None and not self._ended:
            raise DriverUnavailableError(f"{self._config.where}: the broker closed the connection")
        return message

    async def close(self) -> None:
        self._ended = True
        client, self._client = self._client, None
        if client is None or self._entering is None:
            return
        with suppress(aiomqtt.MqttError, ValueError):
            await self._entering
        first = client._disconnected
        if client._client.is_connected():
            with suppress(aiomqtt.MqttError, TimeoutError):
                async with asyncio.timeout(GOODBYE_S):
                    await client.__aexit__(None, None, None)
        client._client._sock_close()
        for ended in (first, client._disconnected):
            if ended.done() and not ended.cancelled():
                ended.exception()  # asyncio would complain of an error at which nobody looks

    def _require(self) -> aiomqtt.Client:
        if self._client is None:
            raise DriverUnavailableError(f"{self._config.where}: the connection is not open")
        return self._client

    def _told(self, error: Exception) -> Exception:
        where = self._config.where
        if isinstance(error, ValueError):
            return DriverMisconfiguredError("url", f"{where}: {error}")
        if "CERTIFICATE_VERIFY_FAILED" in str(error):
            return DriverMisconfiguredError("ca_certificate", f"{where}: {error}")
        key = _REFUSED.get(_code(getattr(error, "rc", 0)))
        if isinstance(error, MqttConnectError) and key is not None:
            return DriverMisconfiguredError(key, f"{where}: refused, {error.rc}")
        return DriverUnavailableError(f"{where}: {error}")


def _code(reason: Any) -> int:
    return int(reason.value) if isinstance(reason, ReasonCode) else int(reason or 0)
