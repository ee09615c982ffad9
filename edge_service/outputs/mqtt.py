"""Messages of a spool to an MQTT broker: in order, at least once, however long it is away."""

import asyncio
import ssl
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import aiomqtt

from ..cancellation import heed_cancellation
from .spool import Message, Spool

BATCH = 64
"""Messages that may wait for their acknowledgement at once."""
BACKOFF_FIRST_S, BACKOFF_CAP_S = 0.5, 5.0


class MqttError(Exception):
    """Settings that cannot work; the text is one line."""


@dataclass(frozen=True, slots=True)
class MqttSettings:
    """Where the broker is.

    Attributes:
        host, port: of the broker.
        client_id: ours; the broker knows us again by it.
        presence: topic on which `true` or `false` is retained: whether we are there.
        user, password: None without.
        ca_certificate: file of the authority that signed the broker's certificate; None is no TLS.
        timeout_s: for a connection and for each acknowledgement.
    """

    host: str
    port: int
    client_id: str
    presence: str
    user: str | None = None
    password: str | None = None
    ca_certificate: Path | None = None
    timeout_s: float = 5.0


class MqttDelivery:
    """Empties a spool into a broker.

    Every message is published with quality of service 1 and stays on disk until the broker has
    acknowledged it. One that was acknowledged just before a connection broke may come twice: its
    `sequence` and `boot_epoch` tell.

    Args:
        on_change: called with "" when the broker is there, else with what is wrong.

    Raises:
        MqttError: a certificate that cannot be read.
    """

    def __init__(
        self, settings: MqttSettings, spool: Spool, on_change: Callable[[str], None]
    ) -> None:
        self._settings = settings
        self._spool = spool
        self._on_change = on_change
        self.delivered = 0
        """Messages that the broker has acknowledged."""
        self.connections = 0
        """Times that the broker was reached."""
        self._connections_before = 0
        self._tls = _tls(settings.ca_certificate)

    async def run(self) -> None:
        """Deliver until cancelled."""
        tries = 0
        while True:
            try:
                await self._connected()
            except aiomqtt.MqttError as error:
                tries = 1 if self.connections > self._connections_before else tries + 1
                self._connections_before = self.connections
                self._on_change(f"{self._settings.host}:{self._settings.port}: {error}")
            await asyncio.sleep(min(BACKOFF_CAP_S, BACKOFF_FIRST_S * 2.0 ** min(tries - 1, 10)))

    async def _connected(self) -> None:
        """Deliver as long as the connection lasts. Raises the library's error."""
        settings = self._settings
        client = aiomqtt.Client(
            settings.host,
            settings.port,
            identifier=settings.client_id,
            username=settings.user,
            password=settings.password,
            tls_context=self._tls,
            timeout=settings.timeout_s,
            will=aiomqtt.Will(settings.presence, "false", qos=1, retain=True),
        )
        async with client:
            self.connections += 1
            self._on_change("")
            await client.publish(settings.presence, "true", qos=1, retain=True)
            while True:
                heed_cancellation()
                await self._spool.wait()
                await self._deliver(client, self._spool.oldest(BATCH))

    async def _deliver(self, client: aiomqtt.Client, batch: list[Message]) -> None:
        """Publish a batch; what is acknowledged leaves the spool even if the rest fails."""
        results = await asyncio.gather(
            *(client.publish(each.topic, each.payload, qos=1) for each in batch),
            return_exceptions=True,
        )
        taken = [m for m, result in zip(batch, results, strict=True) if result is None]
        self._spool.remove(taken)
        self.delivered += len(taken)
        for result in results:
            if isinstance(result, BaseException):
                raise result


def _tls(ca_certificate: Path | None) -> ssl.SSLContext | None:
    if ca_certificate is None:
        return None
    try:
        return ssl.create_default_context(cafile=str(ca_certificate))
    except (OSError, ssl.SSLError) as error:
        raise MqttError(
            f"mqtt.ca_certificate: {ca_certificate}: cannot be used ({error})"
        ) from None
