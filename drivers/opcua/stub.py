"""An OPC UA server that serves axes by the variables that the driver's configuration names.

Like the server of a SINUMERIK it samples and publishes every 100 ms at best, and takes ten sessions
and no more: enough for features, not for 1 kHz.
"""

import asyncio
import logging
import math
import re
import time
from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC
from pathlib import Path
from typing import Any

from asyncua import ua
from asyncua.common.node import Node
from asyncua.common.utils import ServiceError
from asyncua.crypto import uacrypto
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession
from asyncua.server.server import Server
from asyncua.server.subscription_service import SubscriptionService
from asyncua.ua.object_ids import ObjectIds
from asyncua.ua.status_codes import StatusCodes
from asyncua.ua.uaerrors import UaStatusCodeError

from ..base import DriverMisconfiguredError
from ..signals import Scaling
from ..stub import Fault, FaultKind, Following, StubAxis, parse_fault
from .variables import (
    NAMESPACE,
    NodeConfig,
    OpcuaConfig,
    browse_path,
    code_of_unit,
    is_path,
    node_id,
)

logging.getLogger("asyncua").setLevel(logging.CRITICAL)
_FAULT_STATUS = {
    FaultKind.NONE: StatusCodes.Good,
    FaultKind.EXCEPTION: StatusCodes.BadDeviceFailure,
}
NODESETS = ("Di", "IA", "Machinery", "MachineTool")
"""In the order in which one needs another; files `Opc.Ua.NAME.NodeSet2.xml`."""
MACHINE_TOOL = "http://opcfoundation.org/UA/MachineTool/"
OWN = "urn:edge-service:feed-drive"
LEAST_INTERVAL_S = 0.1
MOST_SESSIONS = 10
_NOBODY = User(role=UserRole.Anonymous)


class OpcuaStub:
    """A server for all axes that share its address.

    The variable `FeedDrive/Fault` below Objects takes faults by name, e.g. `delay:0.3`.
    """

    def __init__(self, axes: Sequence[StubAxis], nodesets: Path | None = None) -> None:
        self._axes = axes
        self._nodesets = nodesets
        self._config: OpcuaConfig = axes[0].config
        self._following = Following(axes)
        self._server: Server | None = None
        self._task: asyncio.Task[None] | None = None
        self._points: list[tuple[StubAxis, NodeConfig, Scaling | None, Node]] = []
        self._fault_node: Node | None = None
        self._wanted = "none"
        self.fault = Fault()
        for axis in axes[1:]:
            if axis.config.url != self._config.url:
                raise DriverMisconfiguredError(
                    "url",
                    f"axis {axis.name} has another address than {axes[0].name}; choose --axis",
                )

    async def start(self) -> str:
        """Listen; returns the address. Raises DriverMisconfiguredError."""
        await self._following.start()
        iserver = LimitedServer(_Users(self._config.user, self._config.plain_password))
        server = Server(iserver)
        await server.init()
        server.disable_clock()
        server.set_endpoint(self._config.url)
        server.set_server_name("edge-service stub")
        await server.set_application_uri("urn:edge-service:stub")
        await self._secure(server)
        await self._fill(server)
        try:
            await server.start()
        except OSError as error:
            await self._following.close()
            raise DriverMisconfiguredError("url", f"{self._config.url}: {error}") from None
        self._server = server
        self._task = asyncio.create_task(self._serve(server))
        return self._config.url

    async def close(self) -> None:
        """Hang up on everybody; safe twice."""
        await self._following.close()
        task, self._task = self._task, None
        server, self._server = self._server, None
        if task is not None:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
        if server is not None:
            await server.stop()

    async def _secure(self, server: Server) -> None:
        config = self._config
        if config.security == "None":
            server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        else:
            assert config.certificate and config.server_certificate
            key = config.server_certificate.with_suffix(".key.pem")
            for path in (config.server_certificate, config.certificate, key):
                if not path.is_file():
                    raise DriverMisconfiguredError("server_certificate", f"{path}: no such file")
            kind = f"{config.security}_SignAndEncrypt"
            server.set_security_policy([ua.SecurityPolicyType[kind]])
            await server.load_certificate(config.server_certificate)
            await server.load_private_key(key)
            server.set_certificate_validator(_Trust(await _der(config.certificate)).check)
        if config.user is not None:
            server.set_identity_tokens([ua.UserNameIdentityToken])

    async def _fill(self, server: Server) -> None:
        await server.register_namespace(OWN)
        if self._nodesets is not None:
            await load_nodesets(server, self._nodesets)
        self._points = []
        for axis in self._axes:
            for number, signal in enumerate(axis.config.signals):
                scaling = None
                if signal.channel is not None:
                    scaling = Scaling.of(signal, axis.context.machine, f"signals[{number}]")
                node = await add_signal(server, axis.name, signal)
                self._points.append((axis, signal, scaling, node))
        folder = await server.nodes.objects.add_object(2, "FeedDrive")
        self._fault_node = await folder.add_variable(2, "Fault", "none")
        await self._fault_node.set_writable()
        for which, value in (
            (ObjectIds.Server_ServerCapabilities_MinSupportedSampleRate, 1e3 * LEAST_INTERVAL_S),
            (ObjectIds.Server_ServerCapabilities_MaxSessions, ua.UInt32(MOST_SESSIONS)),
        ):
            with suppress(ua.uaerrors.UaStatusCodeError):
                kind = ua.VariantType.Double if isinstance(value, float) else ua.VariantType.UInt32
                await server.get_node(ua.NodeId(ua.Int32(which))).write_value(
                    ua.Variant(value, kind)
                )

    async def _serve(self, server: Server) -> None:
        """Write a sample of every variable, on a fixed grid of time."""
        loop = asyncio.get_running_loop()
        due_s = loop.time()
        while True:
            await self._obey(server)
            if self.fault.kind not in (FaultKind.STALE, FaultKind.HANG):
                await self._write(server)
            due_s += LEAST_INTERVAL_S
            await asyncio.sleep(max(due_s - loop.time(), 0.0))

    async def _write(self, server: Server) -> None:
        late_s = self.fault.amount if self.fault.kind is FaultKind.DELAY else 0.0
        now = ua.DateTime.fromtimestamp(time.time() - late_s, UTC)
        code = ua.UInt32(_FAULT_STATUS.get(self.fault.kind, StatusCodes.Good))
        status = ua.StatusCode(code)
        for axis, signal, scaling, node in self._points:
            if scaling is None:
                raw = float(axis.samples)
            else:
                raw = scaling.raw(axis.latest.get(str(signal.channel), math.nan))
            value = ua.DataValue(
                ua.Variant(raw, ua.VariantType.Double), status, SourceTimestamp=now
            )
            await server.write_attribute_value(node.nodeid, value)

    async def _obey(self, server: Server) -> None:
        """Do what the fault asks for, or what somebody wrote into its variable."""
        assert self._fault_node is not None
        wanted = str(await self._fault_node.read_value())
        if wanted != self._wanted:
            self._wanted = wanted
            with suppress(ValueError):
                self.fault = parse_fault(wanted)
        transports: list[Any] = list(server.iserver.asyncio_transports)
        for transport in transports:
            if self.fault.kind is FaultKind.DROP:
                transport.abort()
            elif self.fault.kind is FaultKind.HANG:
                transport.pause_reading()
            else:
                transport.resume_reading()


class _Users:
    """Lets in the one user that is configured, or everybody where none is."""

    def __init__(self, user: str | None, password: str) -> None:
        self._known = (user, password)

    def get_user(
        self,
        iserver: Any,
        username: str | None = None,
        password: str | None = None,
        certificate: Any = None,
    ) -> User | None:
        """The user, or None for a stranger."""
        if self._known[0] is None or (username, password) == self._known:
            return User(role=UserRole.User)
        return None


class _Trust:
    """Trusts one client certificate and no other."""

    def __init__(self, trusted: bytes) -> None:
        self._trusted = trusted

    async def check(self, certificate: Any, _description: Any) -> None:
        """Raise what the library expects for a certificate that is not trusted."""
        if uacrypto.der_from_x509(certificate) != self._trusted:
            raise ServiceError(StatusCodes.BadCertificateUntrusted)


async def _der(path: Path) -> bytes:
    return bytes(uacrypto.der_from_x509(await uacrypto.load_certificate(path)))


class LimitedServer(InternalServer):
    """Gives clients longer intervals than they ask for, and refuses sessions beyond the last."""

    def __init__(self, user_manager: Any) -> None:
        super().__init__(user_manager)
        self.subscription_service = _LimitedSubscriptions(self.aspace, iserver=self)

    def create_session(
        self, name: str, user: User = _NOBODY, external: bool = False
    ) -> InternalSession:
        """A session, unless there are too many. Raises ServiceError."""
        if external and len(self._external_sessions) >= MOST_SESSIONS:
            raise ServiceError(StatusCodes.BadTooManySessions)
        return super().create_session(name, user, external)


class _LimitedSubscriptions(SubscriptionService):
    async def create_subscription(
        self, params: ua.CreateSubscriptionParameters, *args: Any, **kwargs: Any
    ) -> ua.CreateSubscriptionResult:
        """A subscription at the interval asked for, or at the shortest there is."""
        params.RequestedPublishingInterval = max(
            params.RequestedPublishingInterval, 1e3 * LEAST_INTERVAL_S
        )
        return await super().create_subscription(params, *args, **kwargs)


async def load_nodesets(server: Server, folder: Path) -> None:
    """Load the companion specifications. Raises DriverMisconfiguredError.

    Parts that rest on specifications beyond these (jobs and their control) are left out.
    """
    for name in NODESETS:
        path = folder / f"Opc.Ua.{name}.NodeSet2.xml"
        if not path.is_file():
            raise DriverMisconfiguredError("nodesets", f"{path}: no such file")
        text = path.read_text(encoding="utf-8-sig")
        known = [str(uri) for uri in await server.get_namespace_array()]
        await server.import_xml(xmlstring=_without_missing(text, known), strict_mode=False)


def _without_missing(text: str, known: list[str]) -> str:
    """A nodeset that no longer demands the models that are not there."""

    def keep(element: re.Match[str]) -> str:
        return element[0] if element[1] in known else ""

    return re.sub(r'<RequiredModel ModelUri="([^"]+)"[^>]*/>', keep, text)


async def add_signal(server: Server, axis: str, signal: NodeConfig) -> Node:
    """The variable that a signal names. Raises DriverMisconfiguredError."""
    try:
        namespaces = await _namespaces(server, signal.node)
        if is_path(signal.node):
            return await _add_at_path(server, browse_path(signal.node, namespaces), signal)
        folder = await _child(server.nodes.objects, f"2:{axis}", server)
        name = ua.QualifiedName(signal.channel or "heartbeat", ua.UInt16(2))
        return await _add_variable(folder, node_id(signal.node, namespaces), name, signal)
    except (ValueError, UaStatusCodeError) as error:
        raise DriverMisconfiguredError("signals", f"{signal.node!r}: {error}") from None


async def _namespaces(server: Server, name: str) -> list[str]:
    """All namespaces, with those that a name brings along."""
    uris = [part.partition("}")[0] for part in name.split("{")[1:]]
    if name.startswith("nsu="):
        uris.append(name.removeprefix("nsu=").partition(";")[0])
    for uri in uris:
        await server.register_namespace(uri)
    return [str(uri) for uri in await server.get_namespace_array()]


async def _add_at_path(server: Server, path: list[str], signal: NodeConfig) -> Node:
    parent = server.nodes.objects
    for step in path[:-1]:
        parent = await _child(parent, step, server)
    name = ua.QualifiedName.from_string(path[-1])
    return await _add_variable(parent, ua.NodeId(ua.Int32(0), name.NamespaceIndex), name, signal)


async def _child(parent: Node, step: str, server: Server) -> Node:
    """The object of that browse name; added where it is not there."""
    try:
        return await parent.get_child(step)
    except UaStatusCodeError:
        name = ua.QualifiedName.from_string(step)
    kind = await _machine_type(parent, server)
    new = ua.NodeId(ua.Int32(0), name.NamespaceIndex)
    return await parent.add_object(new, name, objecttype=kind, instantiate_optional=False)


async def _machine_type(parent: Node, server: Server) -> ua.NodeId | None:
    """MachineToolType for a child of Machines, else nothing."""
    namespaces = await server.get_namespace_array()
    name = await parent.read_browse_name()
    if name.Name != "Machines" or MACHINE_TOOL not in namespaces:
        return None
    index = namespaces.index(MACHINE_TOOL)
    kind = await server.nodes.base_object_type.get_child(f"{index}:MachineToolType")
    return kind.nodeid


async def _add_variable(
    parent: Node, where: ua.NodeId, name: ua.QualifiedName, signal: NodeConfig
) -> Node:
    variable = await parent.add_variable(
        where, name, ua.Variant(math.nan, ua.VariantType.Double), datatype=ua.NodeId(ua.Int32(11))
    )
    if signal.channel is not None:
        unit = signal.declared_unit if signal.scale == 1.0 else ""
        if unit:
            await variable.add_property(
                ua.NodeId(ua.Int32(0), name.NamespaceIndex),
                ua.QualifiedName("EngineeringUnits", ua.UInt16(0)),
                _engineering_unit(unit),
            )
    return variable


def _engineering_unit(unit: str) -> ua.Variant:
    text = ua.LocalizedText(unit)
    information = ua.EUInformation(NAMESPACE, ua.Int32(code_of_unit(unit)), text, text)
    return ua.Variant(information, ua.VariantType.ExtensionObject)
