"""Tokens by which people and programs prove who they are; kept as hashes, in one file."""

import hashlib
import hmac
import secrets
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ...atomic import PRIVATE, replaced_file
from .access import Role

PREFIX = "edge-"
_BYTES = 32
_OTHERS_WRITE = 0o022
RoleName = Literal["viewer", "operator", "admin"]
TokenName = Annotated[str, Field(pattern=r"^[\w.@-][\w .@-]*$", max_length=60)]
"""The length stands beside the pattern: letters of all languages 60 times over would take 6 MB."""


class TokenError(Exception):
    """A file of tokens that cannot be used, or a token that cannot be made; one line."""


class Token(BaseModel):
    """One token: whose it is, what it allows, until when, and its SHA-256."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: TokenName
    role: RoleName
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")
    created: datetime
    expires: datetime

    @property
    def rank(self) -> Role:
        """The role as it is compared."""
        return Role[self.role.upper()]


class _Document(BaseModel):
    """Content of the file."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    version: Literal["tokens/1"] = Field("tokens/1", alias="schema")
    tokens: tuple[Token, ...] = ()


def digest(secret: str) -> str:
    """SHA-256 of a secret; slow hashing is for what people can remember."""
    return hashlib.sha256(secret.encode()).hexdigest()


def read_tokens(path: Path) -> tuple[Token, ...]:
    """Tokens of a file. Raises TokenError."""
    try:
        if path.stat().st_mode & _OTHERS_WRITE:
            raise TokenError(f"{path}: others may write to it; chmod 600 it")
        return _Document.model_validate_json(path.read_bytes()).tokens
    except OSError as error:
        hint = "; `edge-service token add` makes it" if isinstance(error, FileNotFoundError) else ""
        raise TokenError(f"{path}: cannot be read ({error.strerror}){hint}") from None
    except ValidationError:
        raise TokenError(f"{path}: is not a file written by `edge-service token`") from None


def add_token(path: Path, name: str, role: RoleName, days: int, now: datetime) -> str:
    """Add a token to a file, made if it is missing; returns the secret, which is kept nowhere.

    Raises TokenError: the name is taken or makes no sense, or the file cannot be used.
    """
    tokens = read_tokens(path) if path.exists() else ()
    if any(token.name == name for token in tokens):
        raise TokenError(f"{path}: there is already a token named {name!r}; revoke it first")
    secret = PREFIX + secrets.token_urlsafe(_BYTES)
    members = {"name": name, "role": role, "sha256": digest(secret)}
    times = {"created": now, "expires": now + timedelta(days=days)}
    try:
        token = Token.model_validate(members | times)
    except ValidationError:
        raise TokenError(f"{name!r}: expected up to 60 letters, digits, blanks, . @ _ -") from None
    _write(path, (*tokens, token))
    return secret


def revoke_token(path: Path, name: str) -> None:
    """Take a token out of a file. Raises TokenError."""
    tokens = read_tokens(path)
    left = [token for token in tokens if token.name != name]
    if len(left) == len(tokens):
        there = ", ".join(token.name for token in tokens) or "none"
        raise TokenError(f"{path}: no token named {name!r}; there are: {there}")
    _write(path, left)


def _write(path: Path, tokens: Iterable[Token]) -> None:
    document = _Document(version="tokens/1", tokens=tuple(tokens))
    try:
        with replaced_file(path, PRIVATE) as file:
            file.write(document.model_dump_json(by_alias=True, indent=1) + "\n")
    except OSError as error:
        raise TokenError(f"{path}: cannot be written ({error.strerror})") from None


class TokenFile:
    """Tokens of a file that may change at any time: what is revoked ends at once."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._seen: tuple[int, int, int] | None = None
        self._tokens: tuple[Token, ...] = ()

    def read(self) -> tuple[Token, ...]:
        """The tokens as of now. Raises TokenError, and then nobody is let in."""
        try:
            there = self._path.stat()
            seen = (there.st_mtime_ns, there.st_ino, there.st_size)
        except OSError:
            seen = None
        if seen is None or seen != self._seen:
            self._tokens = read_tokens(self._path)
            self._seen = seen
        return self._tokens

    def find(self, sha256: str, now: datetime) -> Token | None:
        """The token with this hash, unless it has ended; takes as long for any. TokenError."""
        matching = [each for each in self.read() if hmac.compare_digest(each.sha256, sha256)]
        return next((token for token in matching if now < token.expires), None)


def utc(now_ns: int) -> datetime:
    """UNIX time in ns as a moment."""
    return datetime.fromtimestamp(now_ns / 1e9, UTC)
