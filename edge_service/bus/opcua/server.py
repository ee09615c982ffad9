"""Server of the answers about one machine: built apart, then shown again and again."""

import asyncio
import logging
from collections.abc import Sequence

from asyncua import ua
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.ua.attribute_ids import AttributeIds

from ...messages.answer import AxisAnswer
from .address_space import AddressSpace, Nodes, load_nodesets
from .application import OpcuaSettings, application_uri
from .bounds import BoundedServer, ReadOnly
from .values import data_values

logging.getLogger("asyncua").setLevel(logging.CRITICAL)  # it would write all that clients do wrong
_ENCRYPTED = [
    ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
    ua.SecurityPolicyType.Aes128Sha256RsaOaep_SignAndEncrypt,
    ua.SecurityPolicyType.Aes256Sha256RsaPss_SignAndEncrypt,
]


class AnswerServer:
    """One machine in an address space; nobody can change anything in it."""

    def __init__(self, settings: OpcuaSettings) -> None:
        self._settings = settings
        self._server = BoundedServer(_Users(settings), settings.sessions)
        self._nodes: dict[str, Nodes] = {}

    @classmethod
    def built(cls, settings: OpcuaSettings, answers: Sequence[AxisAnswer]) -> "AnswerServer":
        """A server whose address space is there; takes seconds, for a thread of its own."""
        server = cls(settings)
        asyncio.run(server._build(answers))
        return server

    @property
    def port(self) -> int:
        """The port at which it listens."""
        return 0 if self._server.bserver is None else int(self._server.bserver.port)

    @property
    def sessions(self) -> int:
        """Number of clients that are let in now."""
        return len(self._server.iserver._external_sessions)

    async def start(self) -> None:
        """Listen. Raises OSError. Being cancelled leaves nothing that `stop` does not end."""
        starting = asyncio.ensure_future(self._server.start())
        try:
            await asyncio.shield(starting)
        except asyncio.CancelledError:  # the library would lose the socket at which it listens
            await asyncio.wait([starting])
            raise

    async def stop(self) -> None:
        """End all sessions; safe without a start."""
        for transport in self._server.iserver.asyncio_transports:
            transport.abort()  # closing would wait for whoever does not read
        if self._server.bserver is not None:
            await self._server.stop()

    async def show(self, answers: Sequence[AxisAnswer]) -> None:
        """Put the answers into the address space; subscribers hear of what has changed."""
        write = self._server.iserver.aspace.write_attribute_value
        for answer in answers:
            for name, value in data_values(answer).items():
                for node in self._nodes[answer.axis][name]:
                    await write(node, AttributeIds.Value, value)

    async def _build(self, answers: Sequence[AxisAnswer]) -> None:
        server, settings = self._server, self._settings
        await server.init()
        host = f"[{settings.host}]" if ":" in settings.host else settings.host
        server.set_endpoint(f"opc.tcp://{host}:{settings.port}/edge-service/")
        server.set_server_name("edge-service")
        await server.set_application_uri(application_uri(settings.certificate))
        if settings.certificate is not None and settings.key is not None:
            await server.load_certificate(settings.certificate, format="pem")
            await server.load_private_key(settings.key, format="pem")
        encrypted = settings.certificate is not None
        policies = _ENCRYPTED if encrypted else [ua.SecurityPolicyType.NoSecurity]
        server.set_security_policy(policies, ReadOnly())
        anybody = settings.knows is None
        server.set_identity_tokens(
            [ua.AnonymousIdentityToken if anybody else ua.UserNameIdentityToken]
        )
        space = AddressSpace(server, await load_nodesets(server))
        self._nodes = await space.build(settings.machine, answers)
        await self.show(answers)


class _Users:
    """Users as the settings know them; without encryption only where none is asked for."""

    def __init__(self, settings: OpcuaSettings) -> None:
        self._settings = settings

    def get_user(
        self,
        _server: object,
        username: str | None = None,
        password: str | bytes | None = None,
        certificate: object = None,
    ) -> User | None:
        """The user, None for somebody who is not let in."""
        if self._settings.certificate is not None and certificate is None:
            return None  # by the channel that is there to find the encrypted ones
        secret = password.decode("utf-8", "replace") if isinstance(password, bytes) else password
        knows = self._settings.knows
        if knows is not None and not knows(username or "", secret or ""):
            return None
        return User(role=UserRole.User, name=username)
