"""A server of OPC UA that nobody can make grow: bounded sessions, messages, buffers; read-only."""

import asyncio
from typing import Any

from asyncua import ua
from asyncua.common.connection import TransportLimits
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import USER_TYPES, SimpleRoleRuleset, User, UserRole
from asyncua.server.binary_server_asyncio import BinaryServer, OPCUAProtocol
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession
from asyncua.server.server import Server
from asyncua.ua.object_ids import ObjectIds
from asyncua.ua.status_codes import StatusCodes

_MESSAGE_BYTES, _CHUNK_BYTES = 1_000_000, 65_535
_UNREAD_BYTES = 4_000_000
"""Bytes that may wait for a client that does not read; then it is cut off."""
_NOBODY = User(role=UserRole.Anonymous)
_REFUSED = (
    ObjectIds.WriteRequest_Encoding_DefaultBinary,
    ObjectIds.CallRequest_Encoding_DefaultBinary,
    ObjectIds.HistoryReadRequest_Encoding_DefaultBinary,
)


class ReadOnly(SimpleRoleRuleset):
    """Rights of whoever is let in: to look."""

    def __init__(self) -> None:
        self._allowed = {ua.NodeId(ua.Int32(each)) for each in USER_TYPES if each not in _REFUSED}

    def check_validity(self, user: User, action_type_id: ua.NodeId, body: Any) -> bool:
        """Tell whether a request is allowed."""
        return action_type_id in self._allowed


class _Protocol(OPCUAProtocol):
    """A connection that is cut off when it sends or leaves unread too much."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        transport.set_write_buffer_limits(high=_UNREAD_BYTES)
        super().connection_made(transport)

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if len(self._buffer) > _MESSAGE_BYTES and self.transport is not None:
            self.transport.abort()

    def pause_writing(self) -> None:
        if self.transport is not None:
            self.transport.abort()


class _Listener(BinaryServer):
    def _make_protocol(self) -> OPCUAProtocol:
        return _Protocol(
            self.iserver, self._policies, self.clients, self.closing_tasks, self.limits
        )


class _Sessions(InternalServer):
    def __init__(self, user_manager: Any, sessions: int) -> None:
        super().__init__(user_manager)
        self._most = sessions
        self.max_connections = 2 * sessions
        self.max_pending_activation_seconds = 10.0
        self.max_pending_messages_per_connection = 50
        self.max_subscriptions = 4 * sessions
        self.max_monitored_item_queue_size = 100
        self.max_unacked_messages_per_subscription = 100
        self.allow_remote_admin = False

    def create_session(
        self, name: str, user: User = _NOBODY, external: bool = False
    ) -> InternalSession:
        """A session, unless there are too many. Raises ServiceError."""
        if external and len(self._external_sessions) >= self._most:
            raise ServiceError(StatusCodes.BadTooManySessions)
        return super().create_session(name, user, external)

    def register_server(self, server: Any, conf: Any = None) -> None:
        """Refuse: it is no discovery server, and would keep whatever it is told."""
        raise ServiceError(StatusCodes.BadServiceUnsupported)

    def register_server2(self, params: Any) -> None:
        """Refuse as well."""
        raise ServiceError(StatusCodes.BadServiceUnsupported)


class BoundedServer(Server):
    """Server with these bounds.

    Args:
        user_manager: tells who is let in.
        sessions: how many there may be at once.
    """

    def __init__(self, user_manager: Any, sessions: int) -> None:
        super().__init__(_Sessions(user_manager, sessions))
        chunks = _MESSAGE_BYTES // _CHUNK_BYTES + 1
        self.limits = TransportLimits(_CHUNK_BYTES, _CHUNK_BYTES, chunks, _MESSAGE_BYTES)

    async def start(self) -> None:
        """Listen. Raises OSError."""
        if not self._policies:  # or a second try would offer all twice
            await self._setup_server_nodes()
        await self.iserver.start()
        host, port = self.endpoint.hostname, self.endpoint.port
        self.bserver = _Listener(self.iserver, host or "", port or 0, self.limits)
        self.bserver.set_policies(self._policies)
        try:
            await self.bserver.start()
        except OSError:
            await self.iserver.stop()
            self.bserver = None
            raise
