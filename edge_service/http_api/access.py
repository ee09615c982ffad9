"""Access: who asks, by a token, and whether they may."""

import base64
from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import Depends, Request
from pydantic import Field
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection

from ..health.store.store import StoreFailedError
from ..health.store.tokens import Role, Token, Tokens, token_of
from ..messages.interval import Frozen
from .context import part
from .guard import SAFE_METHODS

_CHALLENGE = {"www-authenticate": 'Basic realm="edge-service", charset="UTF-8"'}
_USED_NS = 600_000_000_000
"""Time after which another use of a token is noted."""


class Caller(Frozen):
    """Whoever asks: name and role of the token, and the address."""

    name: str | None = Field(description="Null where no token is needed.")
    role: Role
    origin: str


class Authenticator:
    """Callers of requests, by the tokens as they were when `refresh` was called last.

    Attributes:
        problem: reason for which the tokens were not read yet, so nobody is let in; else empty.
    """

    def __init__(self, tokens: Tokens | None = None, *, required: bool = False) -> None:
        self.tokens = tokens
        self._required = required
        self._known: tuple[Token, ...] = ()
        self._used: set[str] = set()
        self.problem = ""
        try:
            self._known = () if tokens is None else tokens.all()
        except StoreFailedError as error:
            self.problem = str(error)

    @property
    def kept(self) -> Tokens:
        """The tokens; 503 where none are kept."""
        if self.tokens is None:
            raise HTTPException(503, "this service keeps no tokens")
        return self.tokens

    def refresh(self, now_ns: int) -> None:
        """Read the tokens, and note which were used. Raises StoreFailedError."""
        if self.tokens is None:
            return
        used, self._used = self._used, set()
        for token in self._known:
            if token.name in used and now_ns - (token.used_ns or 0) > _USED_NS:
                self.tokens.note_use(token.name, now_ns)
        self._known = self.tokens.all()
        self.problem = ""

    @property
    def needs_token(self) -> bool:
        """A request without a token is refused."""
        lost = self.tokens is not None and self.tokens.may_be_lost
        return self._required or bool(self._known) or lost

    def caller(self, request: HTTPConnection) -> Caller | None:
        """Caller of a request; None if its token is missing or unknown."""
        origin = request.client.host if request.client else ""
        if not self.needs_token:
            return Caller(name=None, role="operator", origin=origin)
        scheme, _, secret = request.headers.get("authorization", "").partition(" ")
        if scheme.lower() == "basic":  # the token is the password
            try:
                secret = base64.b64decode(secret, validate=True).decode().partition(":")[2]
            except ValueError:
                return None
        elif scheme.lower() != "bearer":
            return None
        token = token_of(secret.strip(), self._known)
        if token is None:
            return None
        self._used.add(token.name)
        return Caller(name=token.name, role=token.role, origin=origin)


AuthenticatorDep = Annotated[Authenticator, part("authenticator")]


async def authorized(request: Request, authenticator: AuthenticatorDep) -> Caller:
    """Caller of a route that may take it; every route but `/healthz` depends on this."""
    if authenticator.problem:
        raise HTTPException(503, f"nobody knows who may be let in: {authenticator.problem}")
    caller = authenticator.caller(request)
    if caller is None:
        words = "a token is needed: Authorization: Bearer TOKEN, or as the password of a browser"
        raise HTTPException(401, words, headers=_CHALLENGE)
    if caller.role == "viewer" and request.method not in SAFE_METHODS:
        request.app.state.note_change(caller, f"refused {request.method} {request.url.path}")
        raise HTTPException(403, f"this needs the role operator; {caller.name} is a viewer")
    return caller


CallerDep = Annotated[Caller, Depends(authorized)]


async def noted(request: Request, caller: CallerDep) -> AsyncIterator[None]:
    """Take note of a change that was made."""
    yield
    if request.method not in SAFE_METHODS:
        request.app.state.note_change(caller, f"{request.method} {request.url.path}")
