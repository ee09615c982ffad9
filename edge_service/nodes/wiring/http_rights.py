"""Access to the page and the API, as the configuration asks for it."""

import ssl
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

from ...config import ConfigError, HttpConfig
from ...http_api.guard import LOOPBACK_HOSTS
from ...http_api.security.doorkeeper import Doorkeeper
from ...http_api.security.tokens import TokenError, TokenFile
from ...secret_files import SecretError, expanded, read_secret
from .bus_rights import warn_if_soon

_ANY_ADDRESS = ("0.0.0.0", "::", "[::]")


def doorkeeper_of(http: HttpConfig) -> Doorkeeper:
    """Tells who asks by the configured tokens. Raises ConfigError."""
    if http.tokens_file is None:
        return Doorkeeper()
    tokens = TokenFile(http.tokens_file)
    try:
        tokens.read()
    except TokenError as error:
        raise ConfigError(f"http.tokens_file: {error}") from None
    return Doorkeeper(tokens)


def knows_of(http: HttpConfig) -> Callable[[str, str], bool] | None:
    """Answers whether a user's name and token fit; None where there are no tokens. ConfigError."""
    if http.tokens_file is None:
        return None
    doorkeeper = doorkeeper_of(http)

    def knows(user: str, password: str) -> bool:
        name = doorkeeper.identify(f"Bearer {password}", "").name
        return name is not None and name == user

    return knows


def tls_files(http: HttpConfig) -> tuple[Path, Path] | None:
    """Certificate and key of the server, which fit each other. Raises ConfigError."""
    return server_files("http", http.certificate, http.private_key)


def server_files(
    table: str, certificate: Path | None, private_key: Path | None
) -> tuple[Path, Path] | None:
    """Certificate and key of a table, which fit each other. Raises ConfigError."""
    if certificate is None or private_key is None:
        return None
    try:
        certificate.read_bytes()
        read_secret(private_key)  # which others must not be able to read
        key = expanded(private_key)
    except SecretError as error:
        raise ConfigError(f"{table}.private_key: {error}") from None
    except OSError as error:
        words = f"{certificate}: cannot be read ({error.strerror})"
        raise ConfigError(f"{table}.certificate: {words}") from None
    try:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(certificate, key, password="")
    except (ssl.SSLError, ValueError) as error:
        reason = getattr(error, "reason", None) or "not in PEM format, or the key has a password"
        pair = f"{certificate} with {private_key}"
        raise ConfigError(f"{table}.certificate: {pair}: {reason}") from None
    return certificate, key


def hosts_of(http: HttpConfig) -> tuple[str, ...]:
    """Host names by which the service may be addressed."""
    address = f"[{http.host}]" if ":" in http.host and "[" not in http.host else http.host
    own = () if http.host in _ANY_ADDRESS else (address,)
    return tuple(dict.fromkeys((*LOOPBACK_HOSTS, *own, *http.allowed_hosts)))


def check_access(http: HttpConfig) -> str:
    """Check tokens and certificates; returns a line on who is let in. Raises ConfigError."""
    doorkeeper_of(http)
    tls_files(http)
    tokens = "no tokens: anyone who can reach it may do anything"
    if http.tokens_file is not None:
        tokens = f"tokens in {http.tokens_file}"
    return f"{_validity(http.certificate)}, {tokens}"


def _validity(certificate: Path | None) -> str:
    if certificate is None:
        return "no TLS"
    from ...certificates import CertificateError, expiry  # 8 MB that plain HTTP does without

    try:
        return f"TLS until {expiry(certificate):%Y-%m-%d}"
    except CertificateError as error:
        raise ConfigError(f"http.certificate: {error}") from None


def certificate_readings(http: HttpConfig) -> Callable[[], dict[str, float]]:
    """Tells for how many days the certificate still holds, by name; warns if they are few.

    A certificate that has ended stops nothing: browsers complain, and monitoring goes on.
    """
    if http.certificate is None:
        return dict
    from ...certificates import expiry

    end = expiry(http.certificate)
    warn_if_soon(http.certificate, end)
    return lambda: {"certificate_days": (end - datetime.now(UTC)) / timedelta(days=1)}


class Address:
    """Address of the page: the port that was free at first stays, and is told once."""

    def __init__(
        self, host: str, port: int, tell: Callable[[str], None], scheme: str = "http"
    ) -> None:
        self.host, self.port, self._scheme = host, port, scheme
        self._tell: Callable[[str], None] | None = tell

    def bound(self, host: str, port: int) -> None:
        """Note that connections are taken."""
        self.port = port
        if self._tell is not None:
            shown = f"[{host}]" if ":" in host else host
            self._tell(f"{self._scheme}://{shown}:{port}/")
        self._tell = None
