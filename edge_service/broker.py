"""An MQTT broker: what a user sets of it, and a client for it."""

import ssl
from pathlib import Path
from typing import Any, Self
from urllib.parse import unquote, urlsplit

import aiomqtt
from pydantic import BaseModel, SecretStr, model_validator

from .messages.addresses import is_loopback
from .plugins import MisconfiguredError

ANSWER_S = 5.0
"""Time that a broker has for each answer."""
_PORTS = {"mqtt": 1883, "mqtts": 8883}


class BrokerConfig(BaseModel):
    """Settings of a connection to a broker.

    Attributes:
        url: `mqtt://[USER@]HOST[:PORT]`, or `mqtts://` for TLS.
        password: of the user.
        password_file: that holds it.
        ca_certificate: of the authority that signed the broker's certificate; the system's without.
        client_certificate, client_key: ours, for a broker that asks for them.
    """

    url: str
    password: SecretStr | None = None
    password_file: Path | None = None
    ca_certificate: Path | None = None
    client_certificate: Path | None = None
    client_key: Path | None = None

    @model_validator(mode="after")
    def _check_broker(self) -> Self:
        try:
            parts = urlsplit(self.url)
            host, _ = parts.hostname, parts.port
        except ValueError:
            host = None
        if not host or parts.scheme not in _PORTS or parts.path.strip("/"):
            raise ValueError("url: expected mqtt://HOST:PORT or mqtts://USER@HOST:PORT")
        if parts.password is not None:
            raise ValueError("url: holds a password; name a file of it by password_file")
        if self.password is not None and not parts.username:
            raise ValueError("url: names no user, there is a password")
        if parts.username and parts.scheme == "mqtt" and not is_loopback(host):
            raise ValueError("url: a user needs mqtts://, or the password could be read")
        if (self.client_certificate is None) != (self.client_key is None):
            missing = "client_key" if self.client_key is None else "client_certificate"
            raise ValueError(f"{missing}: missing, the two go together")
        if (self.ca_certificate or self.client_certificate) and parts.scheme == "mqtt":
            raise ValueError("url: expected mqtts://, as there is a certificate")
        return self

    @property
    def where(self) -> str:
        """Host and port."""
        parts = urlsplit(self.url)
        return f"{parts.hostname}:{parts.port or _PORTS[parts.scheme]}"

    def client(self, identifier: str | None, **more: Any) -> aiomqtt.Client:
        """A client of that name; None lets the library choose one. Raises MisconfiguredError."""
        parts = urlsplit(self.url)
        client = aiomqtt.Client(
            parts.hostname or "",
            parts.port or _PORTS[parts.scheme],
            identifier=identifier,
            username=None if parts.username is None else unquote(parts.username),
            password=None if self.password is None else self.password.get_secret_value(),
            tls_context=self.tls(),
            timeout=ANSWER_S,
            **more,
        )
        # who gave a silent broker up asks no more why the connection ended, and asyncio logs that
        client._disconnected.add_done_callback(lambda end: end.cancelled() or end.exception())
        return client

    def tls(self) -> ssl.SSLContext | None:
        """The context for `mqtts://`; None for `mqtt://`. Raises MisconfiguredError."""
        if urlsplit(self.url).scheme == "mqtt":
            return None
        key, path = "ca_certificate", self.ca_certificate
        try:
            context = ssl.create_default_context(cafile=None if path is None else str(path))
            context.sslsocket_class = _ClosingSocket
            if self.client_certificate is not None:
                key, path = "client_certificate", self.client_certificate
                # Without a password a key that has one would ask for it on the terminal, and wait.
                context.load_cert_chain(path, self.client_key, password=lambda: "")
        except (OSError, ValueError) as error:
            raise MisconfiguredError(key, f"{path}: cannot be used ({error})") from None
        return context


class _ClosingSocket(ssl.SSLSocket):
    """Socket that is closed when its handshake fails; the MQTT library would leave it open."""

    def do_handshake(self, block: bool = False) -> None:
        """Shake hands. Raises OSError, of a socket that is closed then."""
        try:
            super().do_handshake(block)
        except OSError:
            self.close()
            raise
