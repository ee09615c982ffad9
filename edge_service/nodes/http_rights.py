"""Access to the page and the API, as the configuration asks for it."""

import ssl
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ..config import ConfigError, EdgeConfig, HttpConfig
from ..health.store.store import FILE_NAME, Store, StoreFailedError
from ..health.store.tokens import Tokens, token_of
from ..secret_files import SecretError, expanded, read_secret


def tokens_of(config: EdgeConfig) -> Tokens:
    """Tokens in the store of a configuration, which only the service mends; in memory without."""
    path = config.store.folder and config.store.folder / FILE_NAME
    return Tokens(Store(path, mends=path is None or not path.exists()))


def knows_of(config: EdgeConfig) -> Callable[[str, str], bool | None]:
    """Answers whether a user's name and token fit; None while there are no tokens."""
    tokens = tokens_of(config)

    def knows(user: str, password: str) -> bool | None:
        with suppress(StoreFailedError):  # nobody is known while none can be read
            known = tokens.all()
            token = token_of(password, known)
            fits = token is not None and token.name == user
            return fits if known or tokens.may_be_lost else None
        return False

    return knows


def check_access(config: EdgeConfig) -> str:
    """Check tokens and certificate; returns a line on who is let in. Raises ConfigError."""
    http, folder = config.http, config.store.folder
    encrypted = "no TLS" if server_files(http) is None else "TLS"
    try:
        there = folder is not None and (folder / FILE_NAME).exists()
        count = len(tokens_of(config).all()) if there else 0
    except (StoreFailedError, OSError) as error:  # others may not look into the folder
        return f"{encrypted}, tokens cannot be read ({error})"
    if count == 0 and http.needs_token:
        key, mend = "url" if http.url else "host", "edge-service token CONFIG --add NAME"
        raise ConfigError(f"http.{key}: beyond loopback a token is needed: {mend} --role operator")
    people = f"whoever has one of {count} tokens" if count else "any user of this machine"
    return f"{encrypted}, for {people}"


def server_files(http: HttpConfig) -> tuple[Path, Path] | None:
    """Certificate and key, which fit each other; None without. Raises ConfigError."""
    certificate, private_key = http.certificate, http.private_key
    if certificate is None or private_key is None:
        return None
    try:
        read_secret(private_key)  # which others must not be able to read
        key = expanded(private_key)
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, password="")
    except SecretError as error:
        raise ConfigError(f"http.private_key: {error}") from None
    except (OSError, ValueError) as error:  # those of ssl are OSErrors
        name = "reason" if isinstance(error, ssl.SSLError) else "strerror"
        reason = getattr(error, name, None) or "not in PEM format, or the key has a password"
        raise ConfigError(f"http.certificate: {certificate} with {private_key}: {reason}") from None
    return certificate, key
