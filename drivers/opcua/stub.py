"""An OPC UA server that serves axes by the variables that the driver's configuration names.

Like the server of a SINUMERIK it has new values every 100 ms at best.
"""

import asyncio
import logging
import math
import time
from collections.abc import Sequence
from datetime import UTC
from typing import Any

from asyncua import ua
from asyncua.common.node import Node
from asyncua.common.utils import ServiceError
from asyncua.crypto import uacrypto
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.internal_server import InternalServer
from asyncua.server.server import Server
from asyncua.ua.status_codes import StatusCodes
from asyncua.ua.uaerrors import UaStatusCodeError

from ..base import DriverMisconfiguredError
from ..signals import Scaling, scalings
from ..stub import Fault, FaultKind, Following, StubAxis
from .variables import NodeConfig, OpcuaConfig, node_id, split_node

logging.getLogger("asyncua").setLevel(logging.CRITICAL)
OWN = "urn:edge-service:feed-drive"
LEAST_INTERVAL_S = 0.1


class OpcuaStub:
    """A server for all axes that share its address."""

    def __init__(self, axes: Sequence[StubAxis]) -> None:
        self._axes = axes
        self._config: OpcuaConfig = axes[0].config
        self._following = Following(axes, lambda config: config.url)
        self._server: Server | None = None
        self._task: asyncio.Task[None] | None = None
        self._points: list[tuple[StubAxis, NodeConfig, Scaling | None, Node]] = []
        self.fault = Fault()

    async def start(self) -> str:
        await self._following.start()
        users: Any = _Users(self._config.user, self._config.plain_password)
        iserver = InternalServer(users)
        server = Server(iserver)
        await server.init()
        server.disable_clock()
        server.set_endpoint(self._config.url)
        server.set_server_name("edge-service stub")
        await server.set_application_uri("urn:edge-service:stub")
        await self._secure(server)
        await server.register_namespace(OWN)
        self._points = []
        for axis in self._axes:
            known = scalings(axis.config.signals, axis.context.machine, "signals")
            for signal in axis.config.signals:
                node = await _add_variable(server, axis.name, signal)
                self._points.append((axis, signal, known.get(signal.channel), node))
        try:
            await server.start()
        except OSError as error:
            await self._following.close()
            raise DriverMisconfiguredError("url", f"{self._config.url}: {error}") from None
        self._server = server
        self._task = asyncio.create_task(self._serve(server))
        return self._config.url

    async def close(self) -> None:
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
            server.set_security_policy([ua.SecurityPolicyType[f"{config.security}_SignAndEncrypt"]])
            await server.load_certificate(config.server_certificate)
            await server.load_private_key(key)
            ours = uacrypto.der_from_x509(await uacrypto.load_certificate(config.certificate))

            async def check(theirs: Any, _description: Any) -> None:
                if uacrypto.der_from_x509(theirs) != ours:
                    raise ServiceError(StatusCodes.BadCertificateUntrusted)

            server.set_certificate_validator(check)
        if config.user is not None:
            server.set_identity_tokens([ua.UserNameIdentityToken])

    async def _serve(self, server: Server) -> None:
        """Write a sample of every variable, on a fixed grid of time."""
        loop = asyncio.get_running_loop()
        due_s = loop.time()
        while True:
            for transport in list(server.iserver.asyncio_transports):
                if self.fault.kind is FaultKind.DROP:
                    transport.abort()
                elif self.fault.kind is FaultKind.HANG:
                    transport.pause_reading()
                else:
                    transport.resume_reading()
            if self.fault.kind not in (FaultKind.STALE, FaultKind.HANG):
                await self._write(server)
            due_s += LEAST_INTERVAL_S
            await asyncio.sleep(max(due_s - loop.time(), 0.0))

    async def _write(self, server: Server) -> None:
        late_s = self.fault.amount if self.fault.kind is FaultKind.DELAY else 0.0
        now = ua.DateTime.fromtimestamp(time.time() - late_s, UTC)
        fails = self.fault.kind is FaultKind.EXCEPTION
        code = StatusCodes.BadDeviceFailure if fails else StatusCodes.Good
        status = ua.StatusCode(ua.UInt32(code))
        for axis, signal, scaling, node in self._points:
            if scaling is None:
                raw = float(axis.samples)
            else:
                raw = scaling.raw(axis.latest.get(str(signal.channel), math.nan))
            told = raw if signal.index is None else [math.nan] * signal.index + [raw]
            value = ua.DataValue(
                ua.Variant(told, ua.VariantType.Double), status, SourceTimestamp=now
            )
            await server.write_attribute_value(node.nodeid, value)


class _Users:
    """Lets in the one user that is configured, or everybody where none is."""

    def __init__(self, user: str | None, password: str) -> None:
        self._known = (user, password)

    def get_user(
        self, _server: Any, username: Any = None, password: Any = None, certificate: Any = None
    ) -> User | None:
        if self._known[0] is None or (username, password) == self._known:
            return User(role=UserRole.User)
        return None


async def _add_variable(server: Server, axis: str, signal: NodeConfig) -> Node:
    """The variable that a signal names. Raises DriverMisconfiguredError."""
    try:
        uri, _ = split_node(signal.node)
        if uri:
            await server.register_namespace(uri)
        namespaces = [str(each) for each in await server.get_namespace_array()]
        name = ua.QualifiedName(f"{axis}.{signal.channel or 'heartbeat'}", ua.UInt16(2))
        value = ua.Variant(math.nan, ua.VariantType.Double)
        return await server.nodes.objects.add_variable(
            node_id(signal.node, namespaces), name, value, datatype=ua.NodeId(ua.Int32(11))
        )
    except (ValueError, UaStatusCodeError) as error:
        raise DriverMisconfiguredError("signals", f"{signal.node!r}: {error}") from None
