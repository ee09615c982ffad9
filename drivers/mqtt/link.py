"""A connection to a broker. Every failure of the library leaves as one of the two driver errors."""

import asyncio
from contextlib import suppress
from typing import Any

import aiomqtt
from aiomqtt.exceptions import MqttConnectError
from paho.mqtt.reasoncodes import ReasonCode

from edge_service.broker_tls import BrokerTlsError, broker_tls
from edge_service.cancellation import heed_cancellation

from ..base import DriverMisconfiguredError, DriverUnavailableError
from .config import MqttSourceConfig
from .inbox import Inbox

KEEPALIVE_S = 10
"""A broker that says nothing for half as long again is lost."""
GOODBYE_S = 1.0
_REFUSED = {132: "port", 133: "client_id", 134: "password", 135: "user", 138: "user"}
"""Reason of a refusal that trying again does not change -> the key to look at."""
_REFUSED_FROM = 128


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
        self.inbox = Inbox(round(1e6 * config.largest_mb))
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
        self.inbox.put_nowait(None)
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
        config = self._config
        files = config.ca_certificate, config.client_certificate, config.client_key
        try:
            tls = broker_tls(*files)
        except BrokerTlsError as error:
            raise DriverMisconfiguredError(error.key, error.problem) from None
        client = aiomqtt.Client(
            config.host,
            config.port,
            identifier=self._client_id,
            username=config.user,
            password=config.plain_password,
            tls_context=tls,
            timeout=config.timeout_s,
            keepalive=KEEPALIVE_S,
            clean_session=not self._keep_session,
            queue_type=lambda maxsize: self.inbox,  # type: ignore[arg-type]
        )
        client._client.connect_timeout = config.timeout_s
        return client

    def _told(self, error: Exception) -> Exception:
        """The driver error that the library's is."""
        if isinstance(error, ValueError):
            return DriverMisconfiguredError("host", f"{self._config.host!r}: {error}")
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
