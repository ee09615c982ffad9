"""Messages of a spool to an MQTT broker: in order, at least once, however long it is away."""

import asyncio
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

import aiomqtt
from pydantic import SecretStr

from ...broker_tls import BrokerTlsError, broker_tls
from ...cancellation import heed_cancellation
from ...clock import now_ns
from ..spool.message import DeadLetter, Message, SpoolError
from ..spool.spool import Spool
from .packet import Packet, PayloadForm
from .suspicion import Suspicion

log = logging.getLogger(__name__)
BATCH = 64
"""Messages that may wait for their acknowledgement at once."""
BACKOFF_FIRST_S, BACKOFF_CAP_S = 0.5, 5.0
_STEP_TIMEOUTS = 3.0
"""Longest step, in times that an answer may take: a connection waits for two."""
_T = TypeVar("_T")


class Life(Protocol):
    """Sign of life, for whoever looks."""

    def beat(self, quiet_s: float = 0.0) -> None:
        """Say that there may be silence for so long now."""

    async def patiently(self, waited: Awaitable[_T]) -> _T:
        """Wait for the disk, which may hang."""


class _Unseen:
    """Life at which nobody looks."""

    def beat(self, quiet_s: float = 0.0) -> None:
        pass

    async def patiently(self, waited: Awaitable[_T]) -> _T:
        return await waited


class MqttError(Exception):
    """Settings that cannot work; the text is one line."""


@dataclass(frozen=True, slots=True)
class MqttSettings:
    """Settings of the connection to the broker.

    Attributes:
        host, port: of the broker.
        client_id: ours; the broker knows us again by it.
        user, password: None without.
        ca_certificate: file of the authority that signed the broker's certificate; None is no TLS.
        client_certificate, client_key: files of ours, for a broker that asks for them.
        timeout_s: for a connection and for each acknowledgement.
    """

    host: str
    port: int
    client_id: str
    user: str | None = None
    password: SecretStr | None = None
    ca_certificate: Path | None = None
    client_certificate: Path | None = None
    client_key: Path | None = None
    timeout_s: float = 5.0

    @property
    def plain_password(self) -> str | None:
        """The password itself."""
        return None if self.password is None else self.password.get_secret_value()


class MqttDelivery:
    """Empties a spool into a broker.

    A message stays on disk until the broker has it. One that it got just before a connection broke
    may come twice: its `sequence` and `boot_epoch` tell. One at which connections break while the
    broker takes others is a dead letter.

    Args:
        form: packets for a message, and for our coming and going.
        on_change: called with "" when the broker is there, else with what is wrong.
        sleep: pauses.

    Raises:
        MqttError: a certificate that cannot be read.
    """

    def __init__(
        self,
        settings: MqttSettings,
        form: PayloadForm,
        spool: Spool,
        on_change: Callable[[str], None],
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self._settings = settings
        self._form = form
        self._spool = spool
        self._on_change = on_change
        self._sleep = sleep
        self.delivered = 0
        """Messages that the broker has."""
        self.connections = 0
        """Times that the broker was reached."""
        self.waits = False
        """True while it is connected and waits for a message."""
        self._life: Life = _Unseen()
        self._suspicion = Suspicion()
        self._sent: Message | None = None  # the first of what is on its way
        self._delivered_before = 0
        self._late_until = 0
        self._turn = asyncio.Lock()
        files = settings.ca_certificate, settings.client_certificate, settings.client_key
        try:
            self._tls = broker_tls(*files)
        except BrokerTlsError as error:
            raise MqttError(f"mqtt.{error}") from None

    async def run(self, life: Life | None = None) -> None:
        """Deliver until cancelled."""
        tries, self._life = 0, life or _Unseen()
        while True:
            try:
                await self._connected()
            except (aiomqtt.MqttError, SpoolError) as error:
                tries = 1 if self.delivered > self._delivered_before else tries + 1
                self._delivered_before = self.delivered
                self._on_change(f"{self._settings.host}:{self._settings.port}: {error}")
                if isinstance(error, aiomqtt.MqttError) and await self._judge(str(error)):
                    continue
            pause_s = min(BACKOFF_CAP_S, BACKOFF_FIRST_S * 2.0 ** min(tries - 1, 10))
            self._life.beat(pause_s)
            await self._sleep(pause_s)

    async def _judge(self, reason: str) -> bool:
        """Set the first message aside if it is to blame; tells if the next is to be tried now."""
        first = self._sent
        if first is None or not self._suspicion.broke():
            return first is not None and self._suspicion.hurries
        tries = self._suspicion.tries + 1
        log.warning("mqtt: message %s is a dead letter: %s", first.key, reason)
        letter = DeadLetter(first.key, first.topic, first.payload, tries, reason, now_ns())
        await self._life.patiently(self._spool.bury(letter))
        return False

    async def _connected(self) -> None:
        """Deliver as long as the connection lasts. Raises the library's error."""
        self.waits, self._sent = False, None
        self._step()
        async with _connection(self._client()) as client:
            self.connections += 1
            await self._life.patiently(self._spool.count_session())
            try:
                for topic in (self._form.commands, self._form.described):
                    if topic is not None:
                        await client.subscribe(topic, qos=1)
                await self._greet(client)
                self._on_change("")
                heed_cancellation()
                await _first_to_end(self._deliver_all(client), self._obey(client))
            except asyncio.CancelledError:
                with suppress(aiomqtt.MqttError, TimeoutError):
                    async with asyncio.timeout(self._settings.timeout_s):
                        await _publish(client, self._form.farewell())
                raise

    def _step(self) -> None:
        """Begin what only the broker can hold up, and not for long."""
        self._life.beat(_STEP_TIMEOUTS * self._settings.timeout_s)

    def _client(self) -> aiomqtt.Client:
        settings = self._settings
        will = self._form.will(self._spool.sessions)
        client = aiomqtt.Client(
            settings.host,
            settings.port,
            identifier=settings.client_id,
            username=settings.user,
            password=settings.plain_password,
            tls_context=self._tls,
            timeout=settings.timeout_s,
            clean_session=True,
            will=aiomqtt.Will(will.topic, will.payload, will.qos, will.retain),
        )
        client.pending_calls_threshold = 2 * BATCH  # it warns of more
        return client

    async def _greet(self, client: aiomqtt.Client) -> None:
        """Say who we are. What waits now is old: the greeting holds the newest of it."""
        newest = self._spool.newest
        self._late_until = max((each.number for each in newest.values()), default=0)
        for packet in self._form.greeting(newest):
            self._step()
            await _publish(client, packet)

    async def _obey(self, client: aiomqtt.Client) -> None:
        """Take back what is outdated, and greet again when somebody asks for it.

        Ends, with the connection's error, with the connection.
        """
        async for heard in client.messages:
            heed_cancellation()
            commands, described = self._form.commands, self._form.described
            if commands is not None and heard.topic.matches(commands):
                if self._form.asks_for_greeting(heard.payload):
                    async with self._turn:
                        await self._greet(client)
            elif described is not None and heard.topic.matches(described):
                for packet in self._form.outdated(str(heard.topic), heard.payload):
                    await _publish(client, packet)

    async def _deliver_all(self, client: aiomqtt.Client) -> None:
        while True:
            heed_cancellation()
            self.waits = True
            await self._spool.wait()
            self.waits = False
            self._step()
            async with self._turn:
                oldest = await self._life.patiently(self._spool.oldest(BATCH))
                if oldest:
                    self._sent = oldest[0]
                    await self._deliver(client, self._suspicion.choose(oldest))
                    self._suspicion.taken()
                    self._sent = None

    async def _deliver(self, client: aiomqtt.Client, batch: list[Message]) -> None:
        """Publish a batch; what the broker has leaves the spool even if the rest fails."""
        packets = [
            (message, packet)
            for message in batch
            for packet in self._form.packets(
                message, self._spool.newest, message.number <= self._late_until
            )
        ]
        results = await asyncio.gather(
            *(_publish(client, packet) for _, packet in packets), return_exceptions=True
        )
        if self._form.commands is not None:
            # Nothing acknowledges quality of service 0. A subscription is, and a broker reads one
            # packet after the other: once it answers, it has what was sent before.
            self._step()
            await client.subscribe(self._form.commands, qos=1)
        failed = [result for result in results if isinstance(result, BaseException)]
        outcomes = zip(packets, results, strict=True)
        lost = {message.number for (message, _), result in outcomes if result is not None}
        taken = [message for message in batch if message.number not in lost]
        await self._life.patiently(self._spool.remove(taken))
        self.delivered += len(taken)
        if failed:
            raise failed[0]


@asynccontextmanager
async def _connection(client: aiomqtt.Client) -> AsyncIterator[aiomqtt.Client]:
    """A connection; asyncio would complain of errors at which the library does not look."""
    first = client._disconnected
    try:
        async with client:
            yield client
    finally:
        for ended in (first, client._disconnected):
            if ended.done() and not ended.cancelled():
                ended.exception()


async def _publish(client: aiomqtt.Client, packet: Packet) -> None:
    await client.publish(packet.topic, packet.payload, packet.qos, packet.retain)


async def _first_to_end(*jobs: Coroutine[None, None, None]) -> None:
    """Run jobs until one of them ends; end the others and raise what ended it."""
    tasks = [asyncio.ensure_future(job) for job in jobs]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
