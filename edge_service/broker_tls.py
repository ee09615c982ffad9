"""TLS to an MQTT broker, from the files that a configuration names."""

import ssl
from pathlib import Path


class BrokerTlsError(Exception):
    """A file that cannot be used; the text is one line that begins with its key.

    Attributes:
        key: of the configuration.
        problem: the rest of the line.
    """

    def __init__(self, key: str, problem: str) -> None:
        super().__init__(f"{key}: {problem}")
        self.key, self.problem = key, problem


class _ClosingSocket(ssl.SSLSocket):
    """Socket that is closed when its handshake fails; the MQTT library would leave it open."""

    def do_handshake(self, block: bool = False) -> None:
        """Shake hands. Raises OSError, of a socket that is closed then."""
        try:
            super().do_handshake(block)
        except OSError:
            self.close()
            raise


def broker_tls(
    ca_certificate: Path | None,
    client_certificate: Path | None,
    client_key: Path | None,
    *,
    or_system: bool = False,
) -> ssl.SSLContext | None:
    """The context; without an authority None, or that of the system. Raises BrokerTlsError."""
    if ca_certificate is None and not or_system:
        return None
    key, path = "ca_certificate", ca_certificate
    try:
        context = ssl.create_default_context(cafile=None if path is None else str(path))
        context.sslsocket_class = _ClosingSocket
        if client_certificate is not None:
            key, path = "client_certificate", client_certificate
            # Without a password a key that has one would ask for it on the terminal, and wait.
            context.load_cert_chain(path, client_key, password=lambda: "")
    except (OSError, ssl.SSLError, ValueError) as error:
        raise BrokerTlsError(key, f"{path}: cannot be used ({error})") from None
    return context
