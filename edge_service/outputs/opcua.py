"""OPC UA: a server that shows all axes, read-only, and that nobody can make grow."""

import asyncio
import gc
import logging
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from asyncua import ua
from asyncua.common.callback import CallbackType, ServerItemCallback
from asyncua.common.connection import TransportLimits
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import SimpleRoleRuleset, User, UserRole
from asyncua.server.binary_server_asyncio import BinaryServer, OPCUAProtocol
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession
from asyncua.server.server import Server
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.object_ids import ObjectIds
from asyncua.ua.status_codes import StatusCodes
from cryptography import x509
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from pydantic import model_validator

from ..messages.answer import AxisAnswer
from ..plugins import MisconfiguredError
from ..secret_files import SecretError, expanded, read_secret
from ..threads import Threads
from .base import ListeningConfig, Message, Output, OutputContext, OutputUnavailableError
from .opcua_nodes import AddressSpace, data_values

URI = "urn:edge-service"
OLD_S = 1.0
"""Time without a new answer after which a value that is read is the last usable one."""
SESSIONS = 20
"""Clients that there may be at once."""
_MESSAGE_BYTES, _CHUNK_BYTES = 1_000_000, 65_535
_UNREAD_BYTES = 4_000_000
"""Bytes that may wait for a client that does not read; then it is cut off."""
_OLD = ua.StatusCode(ua.UInt32(StatusCodes.UncertainLastUsableValue))
_NOBODY = User(role=UserRole.Anonymous)
_REFUSED = (
    ObjectIds.WriteRequest_Encoding_DefaultBinary,
    ObjectIds.CallRequest_Encoding_DefaultBinary,
    ObjectIds.HistoryReadRequest_Encoding_DefaultBinary,
)
_ENCRYPTED = [
    ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
    ua.SecurityPolicyType.Aes128Sha256RsaOaep_SignAndEncrypt,
    ua.SecurityPolicyType.Aes256Sha256RsaPss_SignAndEncrypt,
]
_BUILDERS = Threads("opcua")
logging.getLogger("asyncua").setLevel(logging.CRITICAL)  # it would write all that clients do wrong


@dataclass
class _Guest(User):
    secret: str = ""


class OpcuaConfig(ListeningConfig):
    scheme, usual_port = "opc.tcp", 4840
    endpoint: str = "opc.tcp://127.0.0.1:4840"  # where clients connect
    # certificate, private_key: of the server, in PEM, for encryption; needed beyond loopback
    certificate: Path | None = None
    private_key: Path | None = None

    @model_validator(mode="after")
    def _guarded(self) -> "OpcuaConfig":
        if (self.certificate is None) != (self.private_key is None):
            lone = "private_key" if self.private_key is None else "certificate"
            raise ValueError(f"{lone}: missing; certificate and private_key are needed together")
        if not self.is_local and self.certificate is None:
            problem = "is not a loopback address: it needs certificate and private_key"
            raise ValueError(f"endpoint: {self.place[0]!r} {problem}")
        return self


class OpcuaOutput(Output):
    """One machine in an address space; nobody can change anything in it."""

    config_model = OpcuaConfig
    open_s = 120.0  # in which the address space is there, on a slow and busy machine

    def __init__(self, config: OpcuaConfig, context: OutputContext) -> None:
        super().__init__(config, context)
        if not config.is_local and context.knows("", "") is None:
            problem = "beyond loopback it needs a token (edge-service token)"
            raise MisconfiguredError("endpoint", problem)
        self._uri = URI
        if config.certificate is not None and config.private_key is not None:
            self._uri = application_uri(config.certificate, config.private_key)
        self._server: BoundedServer | None = None
        self._space: AddressSpace | None = None
        self._limited, self._told_s, self._looked_s = set[str](), 0.0, 0.0

    @property
    def port(self) -> int:
        """The port at which it listens; 0 before."""
        listener = None if self._server is None else self._server.bserver
        return 0 if listener is None else int(listener.port)

    @property
    def readings(self) -> dict[str, float]:
        sessions = () if self._server is None else self._server.iserver._external_sessions
        return {"sessions": float(len(sessions))}

    async def open(self) -> None:
        """Build the address space, in a thread as it takes seconds, and listen."""
        if self._server is None:
            server = BoundedServer(self)
            await _BUILDERS.run(asyncio.run, self._build(server))
            self._server = server
        if self._server.bserver is None:
            try:
                await self._server.start()
            except OSError as error:
                host, port = self.config.place
                raise OutputUnavailableError(f"{host}:{port}: {error.strerror}") from None

    async def take(self, message: Message) -> None:
        if self._server is None or self._server.bserver is None or self._space is None:
            raise OutputUnavailableError("not open")
        assert isinstance(message, AxisAnswer)
        if message.axis not in self._limited and message.health.limits is not None:
            await self._space.set_limits(message)
            self._limited.add(message.axis)
        self._told_s = time.monotonic()
        if self._told_s - self._looked_s >= OLD_S:
            self._looked_s = self._told_s
            for session in (*self._server.iserver._external_sessions.values(),):
                guest = session.user  # whose token was revoked, or who needed none at first
                if isinstance(guest, _Guest) and not await _BUILDERS.run(self._lets_in, guest):
                    await session.close_session()
        write = self._server.iserver.aspace.write_attribute_value
        for name, value in data_values(message).items():
            for node in self._space.shown[message.axis][name]:
                await write(node, AttributeIds.Value, value)

    async def close(self) -> None:
        server, self._server, self._space = self._server, None, None
        self._limited.clear()
        if server is None:
            return
        for transport in server.iserver.asyncio_transports:
            transport.abort()  # closing would wait for whoever does not read
        if server.bserver is not None:
            await server.stop()

    async def _build(self, server: "BoundedServer") -> None:
        gc.collect()  # of one before 50 MB lie in circles, which a quiet service would not look for
        await server.init()
        server.subscribe_server_callback(CallbackType.PostRead, self._mark_old)
        host, port = self.config.place
        shown = f"[{host}]" if ":" in host else host
        server.set_endpoint(f"opc.tcp://{shown}:{port}/edge-service/")
        server.set_server_name("edge-service")
        await server.set_application_uri(self._uri)
        policies = [ua.SecurityPolicyType.NoSecurity]
        if self.config.certificate is not None:
            await server.load_certificate(self.config.certificate, format="pem")
            await server.load_private_key(expanded(self.config.private_key), format="pem")
            policies = _ENCRYPTED
        server.set_security_policy(policies, read_only())
        kinds = [ua.AnonymousIdentityToken, ua.UserNameIdentityToken]
        server.set_identity_tokens(kinds[0 if self._lets_in(_Guest()) else 1 :])
        self._space = AddressSpace(server)
        machine = f"{self.context.site}/{self.context.machine}"
        await self._space.build(machine, self.context.axes)

    def _mark_old(self, read: ServerItemCallback, _service: object) -> None:
        """Mark what is read of the axes after a stall, before there are new answers."""
        space, values = self._space, read.response_params
        if space is None or time.monotonic() - self._told_s < OLD_S:
            return
        for number, node in enumerate(read.request_params.NodesToRead):
            if node.NodeId in space.told and values[number].SourceTimestamp:
                values[number] = replace(values[number], StatusCode=_OLD)

    def get_user(
        self,
        _server: object,
        username: str | None = None,
        password: str | bytes | None = None,
        certificate: object = None,
    ) -> User | None:
        """The user, None for somebody who is not let in; asked by the library."""
        if self.config.certificate is not None and certificate is None:
            return None  # by the channel that is there to find the encrypted ones
        secret = password.decode("utf-8", "replace") if isinstance(password, bytes) else password
        guest = _Guest(UserRole.User, username, secret or "")
        return guest if self._lets_in(guest) else None

    def _lets_in(self, guest: _Guest) -> bool:
        known = self.context.knows(guest.name or "", guest.secret)
        return self.config.is_local if known is None else known


def application_uri(certificate: Path, private_key: Path) -> str:
    """Name of the server that its certificate states. Raises MisconfiguredError."""
    key, problem = "private_key", f"{private_key}: expected a key in PEM, without a password"
    try:
        own = load_pem_private_key(read_secret(private_key).encode(), None).public_key()
        key = "certificate"
        problem = f"{certificate}: expected an RSA certificate in PEM that belongs to {private_key}"
        problem += f" and has a URI, such as {URI}, in subjectAltName"
        held = x509.load_pem_x509_certificate(certificate.read_bytes())
        names = held.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        (uri, *_) = names.get_values_for_type(x509.UniformResourceIdentifier)
        if held.public_key() != own or "rsa" not in type(own).__module__:
            raise ValueError(problem)
    except SecretError as error:
        raise MisconfiguredError(key, str(error)) from None
    except OSError as error:
        problem = f"{certificate}: cannot be read ({error.strerror})"
        raise MisconfiguredError(key, problem) from None
    except (ValueError, TypeError, x509.ExtensionNotFound):
        raise MisconfiguredError(key, problem) from None
    return str(uri)


def read_only() -> SimpleRoleRuleset:
    """Rights of whoever is let in: to look."""
    rules = SimpleRoleRuleset()
    rules._permission_dict[UserRole.User] -= {ua.NodeId(ua.Int32(each)) for each in _REFUSED}
    return rules


class _Protocol(OPCUAProtocol):
    """A connection that is cut off when it sends or leaves unread too much."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        transport.set_write_buffer_limits(high=_UNREAD_BYTES)
        super().connection_made(transport)

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if len(self._buffer) > _MESSAGE_BYTES:
            self.pause_writing()

    def pause_writing(self) -> None:
        if self.transport is not None:
            self.transport.abort()


class _Listener(BinaryServer):
    def _make_protocol(self) -> OPCUAProtocol:
        known = self._policies, self.clients, self.closing_tasks, self.limits
        return _Protocol(self.iserver, *known)


class _Sessions(InternalServer):
    def create_session(
        self, name: str, user: User = _NOBODY, external: bool = False
    ) -> InternalSession:
        """A session, unless there are too many. Raises ServiceError."""
        if external and len(self._external_sessions) >= SESSIONS:
            raise ServiceError(StatusCodes.BadTooManySessions)
        return super().create_session(name, user, external)

    def register_server(self, server: Any, conf: Any = None) -> None:
        """Refuse: it is no discovery server, and would keep whatever it is told."""
        raise ServiceError(StatusCodes.BadServiceUnsupported)

    def register_server2(self, params: Any) -> None:
        self.register_server(params)


class BoundedServer(Server):
    """Server with bounded sessions, messages and buffers."""

    def __init__(self, user_manager: Any) -> None:
        bounds = _Sessions(user_manager)
        bounds.max_connections = 2 * SESSIONS
        bounds.max_pending_activation_seconds = 10.0
        bounds.max_pending_messages_per_connection = 50
        bounds.max_subscriptions = 4 * SESSIONS
        bounds.max_monitored_item_queue_size = 100
        bounds.max_unacked_messages_per_subscription = 100
        bounds.allow_remote_admin = False
        super().__init__(bounds)
        chunks = _MESSAGE_BYTES // _CHUNK_BYTES + 1
        self.limits = TransportLimits(_CHUNK_BYTES, _CHUNK_BYTES, chunks, _MESSAGE_BYTES)

    async def start(self) -> None:
        """Listen. Raises OSError."""
        if not self._policies:  # or a second try would offer all twice
            await self._setup_server_nodes()
        await self.iserver.start()
        host, port = self.endpoint.hostname, self.endpoint.port
        listener = _Listener(self.iserver, host or "", port or 0, self.limits)
        listener.set_policies(self._policies)
        try:
            await listener.start()
        except OSError:
            await self.iserver.stop()
            raise
        self.bserver = listener
