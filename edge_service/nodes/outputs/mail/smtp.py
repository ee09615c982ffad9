"""One letter to an SMTP server: bounded in time, encrypted as asked for, and what came of it.

RFC 5321 (SMTP), 3207 (STARTTLS), 8314 (TLS from the beginning), 4954 (login).
"""

import asyncio
import smtplib
import socket
import ssl
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from ....config_tables import EmailConfig
from ....threads import Threads
from ..reply import Outcome, Reply

STEP_S = 10.0
"""Time for one answer of the server."""
WHOLE_S = 60.0
"""Time for a whole letter, however slowly bytes come."""


class SmtpSender:
    """Hands letters to one server. Nothing is kept from one letter to the next."""

    def __init__(self, settings: EmailConfig) -> None:
        assert settings.host is not None
        self._settings, self._host = settings, settings.host
        self._tls = trusted(settings.ca_certificate)
        self._thread = Threads("email")

    @property
    def place(self) -> str:
        """Host and port of the server."""
        return f"{self._host}:{self._settings.used_port}"

    async def send(self, letter: bytes) -> Reply:
        """Send once; whatever the other side does ends in a reply."""
        exchange = _Exchange(self._settings, self._host, self._tls)
        try:
            async with patience():
                return await self._thread.run(exchange.make, letter)
        except TimeoutError:
            return Reply(Outcome.LATER, f"took longer than {WHOLE_S:g} s")
        finally:
            exchange.end()


def trusted(ca_certificate: Path | None) -> ssl.SSLContext:
    """Context that trusts one authority, or those of the system. Raises OSError."""
    return ssl.create_default_context(cafile=ca_certificate)


def patience() -> asyncio.Timeout:
    """Time limit of one letter."""
    return asyncio.timeout(WHOLE_S)


class _Exchange:
    """One connection, used in a thread; its end may be asked for from anywhere."""

    def __init__(self, settings: EmailConfig, host: str, tls: ssl.SSLContext) -> None:
        self._settings, self._host, self._tls = settings, host, tls
        here = socket.gethostname()
        self._client = (
            smtplib.SMTP_SSL(local_hostname=here, timeout=STEP_S, context=tls)
            if settings.security == "tls"
            else smtplib.SMTP(local_hostname=here, timeout=STEP_S)
        )
        # set by the library only where it connects at once, and then nobody could end that
        self._client._host = host  # type: ignore[attr-defined]

    def make(self, letter: bytes) -> Reply:
        """Connect, sign in and hand the letter over."""
        client, settings = self._client, self._settings
        try:
            self._connect()
            refused = client.sendmail(settings.sender, settings.recipients, letter)
            with suppress(smtplib.SMTPException, OSError):
                client.quit()
        except (smtplib.SMTPException, OSError, ValueError) as error:
            return _failed(error)
        finally:
            client.close()
        return Reply(Outcome.TAKEN, _some(refused, len(settings.recipients)))

    def end(self) -> None:
        """Let whatever waits for the server fail; safe twice."""
        sock = self._client.sock
        if sock is not None:
            with suppress(OSError):
                sock.shutdown(socket.SHUT_RDWR)

    def _connect(self) -> None:
        client, settings = self._client, self._settings
        code, _ = client.connect(self._host, settings.used_port)
        if code != 220:
            raise smtplib.SMTPConnectError(code, b"")
        if settings.security == "starttls":
            client.starttls(context=self._tls)
        if settings.user is not None and settings.password is not None:
            client.login(settings.user, settings.password.get_secret_value())


_STEPS: dict[type[Exception], str] = {
    smtplib.SMTPAuthenticationError: "to the login ",
    smtplib.SMTPSenderRefused: "to the sender ",
    smtplib.SMTPConnectError: "at first ",
}


def _failed(error: Exception) -> Reply:
    """Reply for an error: a letter is refused for good only where it was judged itself.

    What the server says of us, or of nobody, may be mended: a password, a sender, a network.
    """
    if isinstance(error, smtplib.SMTPRecipientsRefused):
        return _of_codes([code for code, _ in error.recipients.values()])
    if isinstance(error, smtplib.SMTPDataError):
        return _of_codes([error.smtp_code])
    return Reply(Outcome.LATER, _cause(error))


def _of_codes(codes: Sequence[int]) -> Reply:
    """Reply for answers to the letter: refused for good only where each of them says so."""
    return Reply(Outcome.NEVER if min(codes) >= 500 else Outcome.LATER, _answered(codes))


def _answered(codes: Sequence[int]) -> str:
    if min(codes) < 200:
        return "sent an answer that is not SMTP"
    return f"answered {', '.join(str(code) for code in sorted(set(codes)))}"


def _some(refused: dict[str, tuple[int, bytes]], all_of_them: int) -> str:
    if not refused:
        return ""
    codes = _answered([code for code, _ in refused.values()])
    return f"{codes} for {len(refused)} of {all_of_them} recipients"


def _cause(error: Exception) -> str:
    match error:
        case smtplib.SMTPResponseException():
            cause = _STEPS.get(type(error), "") + _answered([error.smtp_code])
        case smtplib.SMTPNotSupportedError():  # the library's own words tell which
            cause = f"does not offer {'STARTTLS' if 'STARTTLS' in str(error) else 'a login'}"
        case ssl.SSLCertVerificationError():
            cause = f"cannot be trusted ({error.verify_message})"
        case ssl.SSLError():
            cause = f"does not speak TLS ({error.reason})"
        case TimeoutError():
            cause = f"did not answer within {STEP_S:g} s"
        case smtplib.SMTPServerDisconnected() | ConnectionResetError() | BrokenPipeError():
            cause = "closed the connection"
        case OSError(strerror=str(reason)):
            cause = f"cannot be reached ({reason})"
        case _:
            cause = f"sent an answer that is not SMTP ({type(error).__name__})"
    return cause
