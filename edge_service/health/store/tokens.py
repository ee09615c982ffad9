"""Tokens by which people and programs prove who they are; the store keeps their hashes."""

import hashlib
import hmac
import re
import secrets
import sqlite3
from typing import Literal

from pydantic import Field, ValidationError

from ...exit_status import BadInputError
from ...messages.interval import Frozen, TimeNs
from .store import Store

SCHEMA = """
CREATE TABLE IF NOT EXISTS tokens (
    name TEXT PRIMARY KEY,
    role TEXT NOT NULL CHECK (role IN ('viewer', 'operator')),
    hash TEXT NOT NULL,
    created_ns INTEGER NOT NULL,
    used_ns INTEGER
)
"""
PREFIX = "edge-"
_BYTES = 32
NAME = r"^[\w.@-][\w .@-]*$"
MOST_LETTERS = 60
Role = Literal["viewer", "operator"]
"""A viewer reads; an operator may do everything."""


class TokenError(BadInputError):
    """A token that cannot be made or revoked; the text is one line."""


class Token(Frozen):
    """One token, which JSON has without its hash."""

    name: str = Field(examples=["kim"])
    role: Role
    hash: str = Field(pattern=r"^[0-9a-f]{64}$", exclude=True)
    created_ns: TimeNs = Field(serialization_alias="created_at")
    used_ns: TimeNs | None = Field(
        serialization_alias="used_at", description="Last use, to some ten minutes; null before it."
    )


class Tokens:
    """Table of the tokens in the store. Every call may raise StoreFailedError."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._is_damaged = False
        store.define(SCHEMA)

    @property
    def may_be_lost(self) -> bool:
        """The file or the table was damaged, so that none are left opens nothing."""
        return self._store.is_new_file or self._is_damaged

    def all(self) -> tuple[Token, ...]:
        """All tokens by name."""
        columns = ", ".join(Token.model_fields)
        rows = self._store.read(
            lambda file: file.execute(f"SELECT {columns} FROM tokens ORDER BY name").fetchall()
        )
        tokens = []
        for row in rows:
            try:
                tokens.append(Token.model_validate(dict(zip(Token.model_fields, row, strict=True))))
            except ValidationError:
                if not self._is_damaged:
                    self._store.damages.append("a token is damaged and left out")
                self._is_damaged = True
        return tuple(tokens)

    def add(self, name: str, role: Role, now_ns: int) -> str:
        """Add a token; returns its secret, which is kept nowhere. Raises TokenError."""
        if not re.fullmatch(NAME, name) or len(name) > MOST_LETTERS:
            raise TokenError(
                f"{name!r}: expected up to {MOST_LETTERS} letters, digits, blanks, . @ _ -"
            )
        secret = PREFIX + secrets.token_urlsafe(_BYTES)
        row = (name, role, digest(secret), now_ns)
        try:
            self._store.write(
                lambda file: file.execute(
                    "INSERT INTO tokens (name, role, hash, created_ns) VALUES (?, ?, ?, ?)", row
                )
            )
        except sqlite3.IntegrityError:
            raise TokenError(f"there is a token named {name!r}; revoke it first") from None
        return secret

    def revoke(self, name: str) -> None:
        """Remove a token. Raises TokenError: there is none of that name."""

        def remove(file: sqlite3.Connection) -> int:
            return file.execute("DELETE FROM tokens WHERE name = ?", (name,)).rowcount

        if not self._store.write(remove):
            there = ", ".join(token.name for token in self.all()) or "none"
            raise TokenError(f"no token is named {name!r}; there are: {there}")

    def note_use(self, name: str, now_ns: int) -> None:
        update = "UPDATE tokens SET used_ns = ? WHERE name = ?"
        self._store.write(lambda file: file.execute(update, (now_ns, name)))


def digest(secret: str) -> str:
    """SHA-256 of a secret; slow hashing is for what people can remember."""
    return hashlib.sha256(secret.encode()).hexdigest()


def token_of(secret: str, tokens: tuple[Token, ...]) -> Token | None:
    """The token with this secret; takes as long for any."""
    sent = digest(secret)
    matching = [token for token in tokens if hmac.compare_digest(token.hash, sent)]
    return matching[0] if matching else None
