"""Foreign SMTP server (aiosmtpd) that keeps what it takes, or misbehaves as it is told."""

import asyncio
import ssl
import warnings
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from email import message_from_bytes
from email.message import EmailMessage
from email.policy import default
from pathlib import Path
from typing import Any

from aiosmtpd.smtp import SMTP, AuthResult, Envelope, LoginPassword, Session

from tests.certificates import write_certificates

USER, PASSWORD = b"edge", b"a password"


@dataclass
class MailServer:
    """A server, and what it is told.

    Attributes:
        on_data: answers to the letters to come, one each; then they are taken.
        on_recipient: answer to a recipient; None accepts it.
        drops: how many of the next letters end in a connection that is reset.
        taken: letters that were taken.
        users: who signed in for each of them.
        dropped: letters whose connection was reset after they had come.
    """

    on_data: list[str] = field(default_factory=list)
    on_recipient: Callable[[str], str | None] = lambda _address: None
    on_sender: str | None = None
    drops: int = 0
    hangs: asyncio.Event | None = None
    taken: list[EmailMessage] = field(default_factory=list)
    users: list[bytes | None] = field(default_factory=list)
    dropped: list[EmailMessage] = field(default_factory=list)
    tries: int = 0
    port: int = 0

    async def handle_MAIL(
        self, server: SMTP, session: Session, envelope: Envelope, address: str, options: Any
    ) -> str:
        """Judge the sender."""
        if self.on_sender is None:
            envelope.mail_from = address
        return self.on_sender or "250 fine"

    async def handle_RCPT(
        self, server: SMTP, session: Session, envelope: Envelope, address: str, options: Any
    ) -> str:
        """Judge a recipient."""
        answer = self.on_recipient(address)
        if answer is None:
            envelope.rcpt_tos.append(address)
        return answer or "250 fine"

    async def handle_DATA(self, server: SMTP, session: Session, envelope: Envelope) -> str:
        """Judge a letter."""
        self.tries += 1
        assert isinstance(envelope.content, bytes)
        letter = message_from_bytes(envelope.content, policy=default)
        assert isinstance(letter, EmailMessage)
        if self.hangs is not None:
            self.hangs.set()
            await asyncio.Event().wait()
        if self.drops > 0:
            self.drops -= 1
            self.dropped.append(letter)
            assert server.transport is not None
            server.transport.abort()
            return "421 gone"
        if self.on_data:
            return self.on_data.pop(0)
        self.taken.append(letter)
        login = session.auth_data
        self.users.append(login.login if isinstance(login, LoginPassword) else None)
        return "250 taken"


def _knows(server: SMTP, session: Session, envelope: Envelope, _mechanism: str, data: Any) -> Any:
    right = isinstance(data, LoginPassword) and data == LoginPassword(USER, PASSWORD)
    return AuthResult(success=right, handled=False, auth_data=data)


def tls_of(folder: Path) -> ssl.SSLContext:
    """Context of a server, whose authority is `ca.pem` of the folder."""
    write_certificates(folder)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(folder / "server.pem", folder / "server.key")
    return context


@asynccontextmanager
async def mail_server(
    tls: ssl.SSLContext | None = None, *, from_the_beginning: bool = False, port: int = 0
) -> AsyncIterator[MailServer]:
    """A server for as long as the context lasts: with TLS it wants a login."""
    kept = MailServer()
    loop = asyncio.get_running_loop()
    wants: dict[str, Any] = {"hostname": "mail.test", "loop": loop, "enable_SMTPUTF8": False}
    if tls is not None:
        wants |= {"auth_required": True, "authenticator": _knows}
        if from_the_beginning:
            wants |= {"auth_require_tls": False}
        else:
            wants |= {"tls_context": tls, "require_starttls": True}

    met: list[SMTP] = []

    def meet() -> SMTP:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it does not see that TLS came before it
            met.append(SMTP(kept, **wants))
            return met[-1]

    server = await loop.create_server(
        meet, "127.0.0.1", port, ssl=tls if from_the_beginning else None
    )
    kept.port = server.sockets[0].getsockname()[1]
    try:
        yield kept
    finally:
        server.close()
        await asyncio.sleep(0)  # what was accepted has met its protocol then
        for task in asyncio.all_tasks() - {asyncio.current_task()}:
            if "_handle_client" in repr(task.get_coro()):
                task.cancel()
                await asyncio.gather(task, return_exceptions=True)
        for each in met:
            if each.transport is not None:
                each.transport.abort()
        await asyncio.sleep(0)  # which the loop does in its next turn
        await server.wait_closed()
