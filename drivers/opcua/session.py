"""A session with an OPC UA server: in, the variables, one subscription, out."""

import asyncio
import contextlib
import logging
from collections.abc import Iterator

from asyncua import ua
from asyncua.client.client import Client
from asyncua.common.node import Node
from asyncua.crypto import security_policies, uacrypto
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.status_codes import get_name_and_doc
from asyncua.ua.uaerrors import BadNodeIdInvalid, BadNodeIdUnknown, UaError, UaStatusCodeError
from cryptography import x509

from edge_service.retry import heed_cancellation

from ..base import DriverMisconfiguredError, DriverUnavailableError
from .variables import UNIT_OF_ID, NodeConfig, OpcuaConfig, node_id

# What the library finds wrong is logged once, by the driver; its own log holds tracebacks.
logging.getLogger("asyncua").setLevel(logging.CRITICAL)
SESSION_S = 20.0
"""A server keeps the session of a client that vanished for so long; it has few to give away."""
GOODBYE_S = 1.0  # longest time a server may take to close a session
ANSWER_S = LOST_AFTER_S = 2.0
MOST_WAITING = 1000
"""Publications that may wait for a reader that is too slow."""
QUEUE_SIZE = 20
"""Values that the server keeps for us between two publications."""
FAILURES = (OSError, UaError)
"""Errors raised by the library when communication with a server fails, or the server refuses."""
NOT_THERE = (BadNodeIdInvalid, BadNodeIdUnknown, ValueError)
"""Errors raised for a variable that the server does not have."""
_REFUSED = {
    "BadUserAccessDenied": "user",
    "BadIdentityToken": "user",
    "BadCertificate": "certificate",
    "BadSecurityChecksFailed": "certificate",
    "BadSecurity": "security",
}
"""Beginning of a refusal that trying again does not change -> the key to look at."""


class OpcuaSession:
    """One connection with a subscription to the variables; the handle of each is its number.

    Every failure of the library leaves as one of the two driver errors.

    Args:
        counts: the driver's; `dropped_publications` is counted here.

    Attributes:
        publishing_s, sampling_s: intervals that the server has granted.
    """

    def __init__(self, config: OpcuaConfig, counts: dict[str, int]) -> None:
        self._config, self._counts = config, counts
        self._client: Client | None = None
        self._is_lost = self._is_closed = False
        self._arrived: asyncio.Queue[ua.PublishResult | None] = asyncio.Queue(MOST_WAITING)
        self.publishing_s = self.sampling_s = config.sampling_s

    @property
    def connected(self) -> bool:
        """Return whether a session is open and no loss of it has been noticed."""
        return self._client is not None and not self._is_lost

    async def open(self) -> None:
        """Connect and subscribe. Raises DriverUnavailableError and DriverMisconfiguredError."""
        config = self._config
        client = Client(config.url, timeout=ANSWER_S)
        client.name = client.description = "edge-service"
        client.application_uri = "urn:edge-service:client"
        client.session_timeout = round(1e3 * SESSION_S)
        client.connection_lost_callback = self._note_loss
        if config.user is not None:
            client.set_user(config.user)
            client.set_password(config.plain_password)
        try:
            if config.security != "None":
                await _secure(client, config)
            with _translated(config.url):
                await client.connect()
                self._client = client
                await self._subscribe(client, await _find(client, config.signals))
            heed_cancellation()
        except BaseException:
            self._client = None
            await _leave(client)
            raise

    async def close(self) -> None:
        client, self._client = self._client, None
        self._is_closed = True
        self._put(None)
        if client is not None:
            await _leave(client)

    async def next(self, patience_s: float) -> ua.PublishResult | None:
        """The next publication; None after `close`. Raises DriverUnavailableError."""
        result, problem = None, "connection closed"
        try:
            async with asyncio.timeout(patience_s):
                result = await self._arrived.get()
        except TimeoutError:
            problem = f"no message for {patience_s:g} s"
        if result is None and not self._is_closed:
            await self.close()
            raise DriverUnavailableError(f"{self._config.url}: {problem}")
        return result

    async def _note_loss(self, _error: Exception) -> None:
        """Flag the loss, in a task of the library's that leaving would cancel."""
        self._is_lost = True
        self._put(None)

    def _put(self, result: ua.PublishResult | None) -> None:
        """Hand on, dropping the oldest where the reader is too slow."""
        if self._arrived.full():
            self._arrived.get_nowait()
            self._counts["dropped_publications"] += 1
        self._arrived.put_nowait(result)

    async def _subscribe(self, client: Client, nodes: list[Node]) -> None:
        asked_ms, session = 1e3 * self._config.sampling_s, client.uaclient.session
        keep_alive = max(int(LOST_AFTER_S / self._config.sampling_s / 3.0), 1)
        parameters = ua.CreateSubscriptionParameters(
            RequestedPublishingInterval=asked_ms,
            RequestedLifetimeCount=10 * keep_alive + 100,
            RequestedMaxKeepAliveCount=keep_alive,
            MaxNotificationsPerPublish=0,
            PublishingEnabled=True,
            Priority=0,
        )
        items = [
            ua.MonitoredItemCreateRequest(
                ItemToMonitor=ua.ReadValueId(NodeId=node.nodeid, AttributeId=AttributeIds.Value),
                MonitoringMode=ua.MonitoringMode.Reporting,
                RequestedParameters=ua.MonitoringParameters(
                    ClientHandle=number,
                    SamplingInterval=asked_ms,
                    QueueSize=QUEUE_SIZE,
                    DiscardOldest=True,
                ),
            )
            for number, node in enumerate(nodes)
        ]
        created = await session.create_subscription(parameters, self._put)
        results = await session.create_monitored_items(
            ua.CreateMonitoredItemsParameters(
                SubscriptionId=created.SubscriptionId,
                TimestampsToReturn=ua.TimestampsToReturn.Both,
                ItemsToCreate=items,
            )
        )
        for number, result in enumerate(results):
            if not result.StatusCode.is_good():
                problem = f"cannot be subscribed to: {result.StatusCode.name}"
                raise DriverMisconfiguredError(f"signals[{number}].node", problem)
        self.publishing_s = 1e-3 * created.RevisedPublishingInterval
        self.sampling_s = 1e-3 * max(result.RevisedSamplingInterval for result in results)


@contextlib.contextmanager
def _translated(url: str) -> Iterator[None]:
    try:
        yield
    except FAILURES as error:
        said = _words(error)
        key = next((key for start, key in _REFUSED.items() if said.startswith(start)), None)
        if key is not None:
            raise DriverMisconfiguredError(key, f"{url}: refused, {said}") from None
        raise DriverUnavailableError(f"{url}: {said}") from None


def _words(error: Exception) -> str:
    if isinstance(error, UaStatusCodeError):
        return str(get_name_and_doc(error.code)[0])
    if isinstance(error, TimeoutError):
        return "no answer in time"
    return str(error) or type(error).__name__


async def _secure(client: Client, config: OpcuaConfig) -> None:
    assert config.certificate and config.private_key and config.server_certificate
    for key in ("certificate", "private_key", "server_certificate"):
        path = getattr(config, key)
        if not path.is_file():
            raise DriverMisconfiguredError(key, f"{path}: no such file")
    try:
        await client.set_security(
            getattr(security_policies, f"SecurityPolicy{config.security}"),
            config.certificate,
            config.private_key,
            server_certificate=str(config.server_certificate),
            mode=ua.MessageSecurityMode.SignAndEncrypt,
        )
        ours = await uacrypto.load_certificate(config.certificate)
        with contextlib.suppress(x509.ExtensionNotFound, IndexError):
            names = ours.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
            client.application_uri = names.get_values_for_type(x509.UniformResourceIdentifier)[0]
    except (ValueError, TypeError, OSError) as error:
        raise DriverMisconfiguredError("certificate", f"cannot be used: {error}") from None


async def _find(client: Client, signals: tuple[NodeConfig, ...]) -> list[Node]:
    """The variables. Raises DriverMisconfiguredError for one not there, or in another unit."""
    namespaces = await client.get_namespace_array()
    nodes = []
    for number, signal in enumerate(signals):
        try:
            node = client.get_node(node_id(signal.node, namespaces))
            await node.read_browse_name()
        except NOT_THERE as error:
            problem = f"{signal.node!r}: {_words(error)}"
            raise DriverMisconfiguredError(f"signals[{number}].node", problem) from None
        unit, declared = await _stated_unit(node), signal.declared_unit
        if signal.channel and unit not in (None, declared) and abs(signal.scale) == 1.0:
            problem = f"{declared!r}, but the server states {unit!r} for {signal.node}"
            raise DriverMisconfiguredError(f"signals[{number}].unit", problem)
        nodes.append(node)
    return nodes


async def _stated_unit(node: Node) -> str | None:
    """Unit that a variable itself states, if it does and it is one of ours."""
    try:
        stated = await (await node.get_child("0:EngineeringUnits")).read_value()
        return UNIT_OF_ID.get(int(stated.UnitId))
    except (UaError, AttributeError, TypeError):
        return None


async def _leave(client: Client) -> None:
    """Say goodbye, or hang up if the server does not listen any more."""
    try:
        with contextlib.suppress(Exception):
            async with asyncio.timeout(GOODBYE_S):
                await client.disconnect()
    finally:
        protocol = client.uaclient.protocol
        if protocol is not None:  # the library holds the socket of a lost session to be closed
            protocol.disconnect_socket()
