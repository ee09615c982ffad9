"""A connection to a broker, and what a user sets of it and of the JSON that comes over it."""

import asyncio
import ssl
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal
from urllib.parse import unquote, urlsplit

import aiomqtt
from aiomqtt.exceptions import MqttConnectError
from paho.mqtt.reasoncodes import ReasonCode
from pydantic import Field, SecretStr, field_validator, model_validator

from edge_service.broker_tls import BrokerTlsError, broker_tls
from edge_service.messages.addresses import is_loopback
from edge_service.retry import heed_cancellation

from ..base import DriverConfig, DriverMisconfiguredError, DriverUnavailableError
from ..signals import SignalConfig, check_channels

KEEPALIVE_S = 10
"""A broker that says nothing for half as long again is lost."""
ANSWER_S = 5.0
GOODBYE_S = 1.0
MOST_WAITING = 1000
"""Messages that wait to be read; further ones are dropped, and the count of samples tells it."""
_PORTS = {"mqtt": 1883, "mqtts": 8883}
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
    """One channel of a map.

    Attributes:
        member: its place in a message, `data.torque`, `values.*.torque` or `vals.id=101.val`.
    """

    channel: str
    member: str

    _is_a_place = field_validator("member")(check_member)


class MqttSourceConfig(DriverConfig):
    """Settings of the MQTT driver. Without `signals` the JSON is that of Industrial Edge's capture.

    Attributes:
        url: of the broker, `mqtt://USER@HOST:PORT`, or `mqtts://` for TLS.
        password: of the user.
        password_file: that holds it.
        ca_certificate: of the authority that signed the broker's certificate; the system's without.
        client_certificate, client_key: ours, for a broker that asks for them.
        topic: filter of the topic that one capture or device sends on.
        time: member with the time of a message or of each sample; that of arrival without.
        time_unit: of it; `iso` is a text such as 2026-01-31T12:00:00.000Z.
        period_s: between the samples of one message, where it holds one time for all.
        signals: the map.
    """

    url: str
    password: SecretStr | None = None
    password_file: Path | None = None
    ca_certificate: Path | None = None
    client_certificate: Path | None = None
    client_key: Path | None = None
    topic: str = Field(min_length=1, max_length=1000)
    time: str | None = None
    time_unit: Literal["s", "ms", "us", "ns", "iso"] = "s"
    period_s: float | None = Field(None, gt=0.0, le=3600.0)
    signals: tuple[MemberConfig, ...] = ()

    @field_validator("url")
    @classmethod
    def _is_a_broker(cls, value: str) -> str:
        parts = urlsplit(value)
        if parts.scheme not in _PORTS or not parts.hostname or parts.path.strip("/"):
            raise ValueError("expected mqtt://HOST:PORT, or mqtts:// for TLS")
        if parts.password:
            raise ValueError("holds a password; expected it in password or password_file")
        _ = parts.port
        return value

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
    def _check(self) -> "MqttSourceConfig":
        if self.password is not None and self.user is None:
            raise ValueError("url: holds no user, and there is a password")
        if self.user is not None and not self.is_encrypted and not is_loopback(self.host):
            raise ValueError("url: a user needs mqtts://, or the password could be read")
        if (self.client_certificate is None) != (self.client_key is None):
            missing = "client_key" if self.client_key is None else "client_certificate"
            raise ValueError(f"{missing}: missing, the two go together")
        if self.ca_certificate is not None and not self.is_encrypted:
            raise ValueError("ca_certificate: is for mqtts://")
        if self.client_certificate is not None and self.ca_certificate is None:
            raise ValueError("client_certificate: needs ca_certificate")
        if self.signals:
            check_channels("signals", self.signals)
        for key in ("time", "period_s"):
            if getattr(self, key) is not None and not self.signals:
                raise ValueError(f"{key}: is for a map, and there are no signals")
        return self

    @property
    def host(self) -> str:
        """Host of the broker."""
        return urlsplit(self.url).hostname or ""

    @property
    def port(self) -> int:
        """Port of the broker: stated, or the usual one."""
        parts = urlsplit(self.url)
        return parts.port or _PORTS[parts.scheme]

    @property
    def user(self) -> str | None:
        """User at the broker."""
        user = urlsplit(self.url).username
        return None if user is None else unquote(user)

    @property
    def is_encrypted(self) -> bool:
        """TLS or none."""
        return urlsplit(self.url).scheme == "mqtts"

    @property
    def address(self) -> Path:
        """Broker and topic, for messages."""
        return Path(f"{self.host}:{self.port}/{self.topic}")


class MqttLink:
    """One connection of one client.

    Args:
        client_id: ours; None lets the library choose one.
        keep_session: the broker keeps subscription and messages while we are away.
    """

    def __init__(
        self, config: MqttSourceConfig, client_id: str | None, *, keep_session: bool
    ) -> None:
        self._config = config
        self._client_id, self._keep_session = client_id, keep_session
        self._client: aiomqtt.Client | None = None
        self._leaving: asyncio.Task[None] | None = None
        self._ended = False

    @property
    def connected(self) -> bool:
        """True while no loss of the connection has been noticed."""
        return self._client is not None and not self._client._disconnected.done()

    async def connect(self) -> None:
        """Connect. Raises DriverUnavailableError and DriverMisconfiguredError."""
        client = self._new_client()
        entering = asyncio.ensure_future(client.__aenter__())
        try:
            await asyncio.shield(entering)  # the library's thread goes on where it is cancelled
            heed_cancellation()
        except asyncio.CancelledError:
            self._leaving = asyncio.ensure_future(_leave(client, entering))
            raise
        except (aiomqtt.MqttError, ValueError) as error:
            await _leave(client, entering)
            raise self._told(error) from None
        self._client = client

    async def subscribe(self, topic: str) -> None:
        """Ask for messages, each at least once. Raises like `connect`."""
        try:
            granted = await self._require().subscribe(topic, qos=1)
        except aiomqtt.MqttError as error:
            raise self._told(error) from None
        heed_cancellation()
        if any(_code(each) >= _REFUSED_FROM for each in granted):
            raise DriverMisconfiguredError("topic", f"{self._where}: refused {topic!r}")

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
            raise DriverUnavailableError(f"{self._where}: the broker closed the connection")
        return message

    async def close(self) -> None:
        """Leave; safe twice."""
        self._ended = True
        client, self._client = self._client, None
        if self._leaving is not None:
            await self._leaving
        if client is not None:
            await _leave(client, None)

    @property
    def _where(self) -> str:
        return f"{self._config.host}:{self._config.port}"

    def _require(self) -> aiomqtt.Client:
        if self._client is None:
            raise DriverUnavailableError(f"{self._where}: the connection is not open")
        return self._client

    def _new_client(self) -> aiomqtt.Client:
        config, tls = self._config, None
        if config.is_encrypted:
            try:
                files = config.ca_certificate, config.client_certificate, config.client_key
                tls = broker_tls(*files) or ssl.create_default_context()
            except BrokerTlsError as error:
                raise DriverMisconfiguredError(error.key, error.problem) from None
        client = aiomqtt.Client(
            config.host,
            config.port,
            identifier=self._client_id,
            username=config.user,
            password=config.password.get_secret_value() if config.password else None,
            tls_context=tls,
            timeout=ANSWER_S,
            keepalive=KEEPALIVE_S,
            clean_session=not self._keep_session,
            max_queued_incoming_messages=MOST_WAITING,
        )
        client._client.connect_timeout = ANSWER_S
        return client

    def _told(self, error: Exception) -> Exception:
        """The driver error that the library's is."""
        if isinstance(error, ValueError):
            return DriverMisconfiguredError("url", f"{self._config.host!r}: {error}")
        if "CERTIFICATE_VERIFY_FAILED" in str(error):
            return DriverMisconfiguredError("ca_certificate", f"{self._where}: {error}")
        key = _REFUSED.get(_code(getattr(error, "rc", 0)))
        if isinstance(error, MqttConnectError) and key is not None:
            return DriverMisconfiguredError(key, f"{self._where}: refused, {error.rc}")
        return DriverUnavailableError(f"{self._where}: {error}")


def _code(reason: Any) -> int:
    return int(reason.value) if isinstance(reason, ReasonCode) else int(reason or 0)


async def _leave(client: aiomqtt.Client, entering: "asyncio.Future[Any] | None") -> None:
    """Say goodbye, or hang up if the broker does not listen; nothing is left open."""
    if entering is not None:
        with suppress(aiomqtt.MqttError, ValueError):
            await entering
    first = client._disconnected
    if client._client.is_connected():
        with suppress(aiomqtt.MqttError, TimeoutError):
            async with asyncio.timeout(GOODBYE_S):
                await client.__aexit__(None, None, None)
    client._client._sock_close()
    for ended in (first, client._disconnected):
        if ended.done() and not ended.cancelled():
            ended.exception()  # asyncio would complain of an error at which nobody looks
