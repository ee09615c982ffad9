"""A session with an OPC UA server: in, the limits, the variables, one subscription, out."""

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass

from asyncua import ua
from asyncua.client.client import Client
from asyncua.common.node import Node
from asyncua.crypto import security_policies, uacrypto
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.object_ids import ObjectIds
from asyncua.ua.status_codes import StatusCodes, get_name_and_doc
from asyncua.ua.uaerrors import (
    BadBrowseNameInvalid,
    BadNodeIdInvalid,
    BadNodeIdUnknown,
    BadNoMatch,
    UaError,
    UaStatusCodeError,
    UaStringParsingError,
)
from cryptography import x509

from edge_service.retry import heed_cancellation

from ..base import DriverMisconfiguredError, DriverUnavailableError
from .variables import NodeConfig, OpcuaConfig, browse_path, is_path, node_id, unit_of_code

# What the library finds wrong is logged once, by the driver; its own log holds tracebacks.
logging.getLogger("asyncua").setLevel(logging.CRITICAL)
SESSION_S = 20.0
"""A server keeps the session of a client that vanished for so long; it has few to give away."""
GOODBYE_S = 1.0
"""Longest time a server may take to close a session."""
APPLICATION_URI = "urn:edge-service:client"
"""Ours, where no certificate of ours says another."""
ANSWER_S = LOST_AFTER_S = 2.0
MOST_ITEMS = ua.NodeId(
    ua.Int32(ObjectIds.Server_ServerCapabilities_OperationLimits_MaxMonitoredItemsPerCall)
)
MOST_WAITING = 1000
"""Publications that may wait for a reader that is too slow."""
QUEUE_SIZE = 20
"""Values that the server keeps for us between two publications."""
FAILURES = (OSError, TimeoutError, UaError)
"""Errors raised by the library when communication with a server fails, or the server refuses."""
NOT_THERE = (
    BadBrowseNameInvalid,
    BadNoMatch,
    BadNodeIdInvalid,
    BadNodeIdUnknown,
    UaStringParsingError,
    ValueError,
)
"""Errors raised for a variable that the server does not have, or for an invalid name."""
_REFUSED = {
    StatusCodes.BadUserAccessDenied: "user",
    StatusCodes.BadIdentityTokenRejected: "user",
    StatusCodes.BadIdentityTokenInvalid: "user",
    StatusCodes.BadSecurityChecksFailed: "certificate",
    StatusCodes.BadCertificateUntrusted: "certificate",
    StatusCodes.BadCertificateInvalid: "certificate",
    StatusCodes.BadCertificateTimeInvalid: "certificate",
    StatusCodes.BadCertificateUriInvalid: "certificate",
    StatusCodes.BadSecurityPolicyRejected: "security",
    StatusCodes.BadSecurityModeRejected: "security",
}
"""A refusal that trying again does not change -> the key to look at."""


@asynccontextmanager
async def translated(url: str) -> AsyncIterator[None]:
    """Every failure inside becomes one of the two driver errors."""
    try:
        yield
    except FAILURES as error:
        key = _REFUSED.get(error.code) if isinstance(error, UaStatusCodeError) else None
        if key is not None:
            raise DriverMisconfiguredError(key, f"{url}: refused, {say(error)}") from None
        raise DriverUnavailableError(f"{url}: {say(error)}") from None


def say(error: Exception) -> str:
    """An error in a few words."""
    if isinstance(error, UaStatusCodeError):
        return str(get_name_and_doc(error.code)[0])
    if isinstance(error, TimeoutError):
        return "no answer in time"
    return str(error) or type(error).__name__


@dataclass(frozen=True, slots=True)
class Granted:
    """Granted parameters: intervals in s, and values that the server queues."""

    publishing_s: float
    sampling_s: float
    queue_size: int


class OpcuaSession:
    """One connection. Every failure of the library leaves as one of the two driver errors."""

    def __init__(self, config: OpcuaConfig, counts: dict[str, int]) -> None:
        self._config, self._counts = config, counts
        self._client: Client | None = None
        self._is_lost = self._is_closed = False
        self._waiting: asyncio.Queue[ua.PublishResult | None] = asyncio.Queue(MOST_WAITING)

    @property
    def connected(self) -> bool:
        """True while a session is open and no loss of it has been noticed."""
        return self._client is not None and not self._is_lost

    async def connect(self) -> None:
        """Connect. Raises DriverUnavailableError and DriverMisconfiguredError."""
        config = self._config
        client = Client(config.url, timeout=ANSWER_S)
        client.name = client.description = "edge-service"
        client.application_uri = APPLICATION_URI
        client.session_timeout = round(1e3 * SESSION_S)
        client.connection_lost_callback = self._note_loss
        if config.user is not None:
            client.set_user(config.user)
            client.set_password(config.plain_password)
        await self._secure(client)
        try:
            async with translated(self._config.url):
                await client.connect()
        except BaseException:
            await _leave(client)
            raise
        self._client = client

    async def close(self) -> None:
        """Leave, which ends `next`; safe twice."""
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
                result = await self._waiting.get()
        except TimeoutError:
            problem = f"no message for {patience_s:g} s"
        if result is None and not self._is_closed:
            await self.close()
            heed_cancellation()
            raise DriverUnavailableError(f"{self._config.url}: {problem}")
        return result

    async def find(self, signals: Sequence[NodeConfig]) -> list[Node]:
        """The variables. Raises DriverMisconfiguredError for one that is not there."""
        client = self._require()
        async with translated(self._config.url):
            namespaces = await client.get_namespace_array()
        nodes = []
        for number, signal in enumerate(signals):
            key = f"signals[{number}]"
            try:
                if is_path(signal.node):
                    path = browse_path(signal.node, namespaces)
                    node = await client.nodes.objects.get_child(path)
                else:
                    node = client.get_node(node_id(signal.node, namespaces))
                await node.read_browse_name()
            except NOT_THERE as error:
                raise DriverMisconfiguredError(
                    f"{key}.node", f"{signal.node!r}: {say(error)}"
                ) from None
            except FAILURES as error:
                raise DriverUnavailableError(f"{self._config.url}: {say(error)}") from None
            unit, declared = await _stated_unit(node), signal.declared_unit
            if unit is not None and unit != declared and signal.scale == 1.0:
                raise DriverMisconfiguredError(
                    f"{key}.unit",
                    f"{declared!r}, but the server states {unit!r} for {signal.node}",
                )
            nodes.append(node)
        return nodes

    async def subscribe(self, nodes: Sequence[Node]) -> Granted:
        """Subscribe to all nodes; the client handle of a node is its number."""
        config, session = self._config, self._require().uaclient.session
        asked_ms = 1e3 * config.sampling_s
        keep_alive = max(int(LOST_AFTER_S / config.sampling_s / 3.0), 1)
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
        async with translated(self._config.url):
            (most,) = await session.read_attributes([MOST_ITEMS], AttributeIds.Value)
            at_once = (most.Value.Value if most.Value is not None else 0) or len(items)
            created = await session.create_subscription(parameters, self._receive)
            results = []
            for start in range(0, len(items), at_once):
                results += await session.create_monitored_items(
                    ua.CreateMonitoredItemsParameters(
                        SubscriptionId=created.SubscriptionId,
                        TimestampsToReturn=ua.TimestampsToReturn.Both,
                        ItemsToCreate=items[start : start + at_once],
                    )
                )
        for number, result in enumerate(results):
            if not result.StatusCode.is_good():
                raise DriverMisconfiguredError(
                    f"signals[{number}].node", f"cannot be subscribed to: {result.StatusCode.name}"
                )
        return Granted(
            1e-3 * created.RevisedPublishingInterval,
            1e-3 * max(result.RevisedSamplingInterval for result in results),
            min(int(result.RevisedQueueSize) for result in results),
        )

    async def _secure(self, client: Client) -> None:
        config = self._config
        if config.security == "None":
            return
        assert config.certificate and config.private_key and config.server_certificate
        for key in ("certificate", "private_key", "server_certificate"):
            path = getattr(config, key)
            if not path.is_file():
                raise DriverMisconfiguredError(key, f"{path}: no such file")
        policy = getattr(security_policies, f"SecurityPolicy{config.security}")
        try:
            await client.set_security(
                policy,
                config.certificate,
                config.private_key,
                server_certificate=str(config.server_certificate),
                mode=ua.MessageSecurityMode.SignAndEncrypt,
            )
            ours = await uacrypto.load_certificate(config.certificate)
            with contextlib.suppress(x509.ExtensionNotFound, IndexError):
                names = ours.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
                uris = names.get_values_for_type(x509.UniformResourceIdentifier)
                client.application_uri = uris[0]
        except (ValueError, TypeError, OSError) as error:
            raise DriverMisconfiguredError("certificate", f"cannot be used: {error}") from None

    async def _note_loss(self, _error: Exception) -> None:
        self._is_lost = True
        self._put(None)

    def _receive(self, result: ua.PublishResult) -> None:
        self._counts["publications"] += 1
        self._put(result)

    def _put(self, result: ua.PublishResult | None) -> None:
        """Hand on, dropping the oldest where the reader is too slow."""
        if self._waiting.full():
            self._waiting.get_nowait()
            self._counts["dropped_publications"] += 1
        self._waiting.put_nowait(result)

    def _require(self) -> Client:
        if self._client is None:
            raise DriverUnavailableError(f"{self._config.url}: the session is not open")
        return self._client


async def _stated_unit(node: Node) -> str | None:
    """Unit that a variable itself states, if it does and it is one of ours."""
    try:
        stated = await (await node.get_child("0:EngineeringUnits")).read_value()
        return unit_of_code(int(stated.UnitId))
    except (*FAILURES, AttributeError, TypeError):
        return None


async def _leave(client: Client) -> None:
    """Say goodbye, or hang up if the server does not listen any more."""
    with contextlib.suppress(Exception):
        async with asyncio.timeout(GOODBYE_S):
            await client.disconnect()
    with contextlib.suppress(Exception):
        client.disconnect_socket()
