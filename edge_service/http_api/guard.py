"""Guard before every route: host names, origins, headers, size of bodies; who asks, by a token."""

import asyncio
import base64
import re
import socket
from collections.abc import AsyncIterator, Iterable
from http import HTTPStatus
from typing import Annotated
from urllib.parse import urlsplit

from fastapi import Depends, Request
from pydantic import Field
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ..health.store.store import StoreFailedError
from ..health.store.tokens import Role, Token, Tokens, token_of
from ..messages.interval import Frozen
from .context import part
from .problems import problem_response

SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
LOOPBACK_HOSTS = ("127.0.0.1", "localhost", "[::1]")
JSON_BYTES, RECORDING_BYTES = 64_000, 300_000_000
BODY_IDLE_S = 20.0
"""Longest pause within a body."""
_RECORDING = re.compile(r"PUT /api/v1/recordings/[^/]+")

SECURITY_HEADERS = {
    "content-security-policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
}
_CHALLENGE = {"www-authenticate": 'Basic realm="edge-service", charset="UTF-8"'}
_USED_NS = 600_000_000_000
"""Time after which another use of a token is noted."""


def own_hosts(url: str | None = None) -> tuple[str, ...]:
    """Host names by which the service may be addressed: of loopback, this machine, and `url`."""
    name = socket.gethostname().lower()
    short = name.partition(".")[0]
    host = urlsplit(url).hostname if url else None
    return tuple(filter(None, (*LOOPBACK_HOSTS, name, short, f"{short}.local", host)))


class Guard:
    """Refuses foreign host names, so that no web page can reach the service by DNS rebinding.

    Requests that change something are refused from pages of another origin (403), bodies that are
    too long (413) or pause too long (408) as well. HEAD is answered as GET, without its body.
    """

    def __init__(self, app: ASGIApp, hosts: Iterable[str] = LOOPBACK_HOSTS) -> None:
        self._app = app
        self._hosts = frozenset(host.lower() for host in hosts)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request, or refuse it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        method, is_answered = scope["method"], False

        async def send_guarded(message: Message) -> None:
            nonlocal is_answered
            if is_answered:
                return
            if message["type"] == "http.response.start":
                answer = MutableHeaders(scope=message)
                for each, value in SECURITY_HEADERS.items():
                    answer.setdefault(each, value)
                answer.setdefault("cache-control", "no-store")
            await send(message)
            if method == "HEAD":
                is_answered = True
                await send({"type": "http.response.body", "body": b""})

        streamed = _RECORDING.fullmatch(f"{method} {scope['path']}") is not None
        most = RECORDING_BYTES if streamed else JSON_BYTES
        refused = self._refused(scope, headers, host, most)
        if refused is not None:
            await problem_response(scope["path"], *refused)(scope, receive, send_guarded)
            return
        if method == "HEAD":
            scope = {**scope, "method": "GET"}
        await self._app(scope, _bounded(receive, most), send_guarded)

    def _refused(
        self, scope: Scope, headers: Headers, host: str, most: int
    ) -> tuple[HTTPStatus, str] | None:
        """Status and words of a refusal by the head of a request; None if there is none."""
        # An address cannot be rebound; that of the socket is one of this machine's own.
        own_address = (scope.get("server") or ("",))[0]
        if name_of(host).strip("[]") != own_address and name_of(host) not in self._hosts:
            words = f"this service is not configured for the host name {host!r} (http.url)"
            return HTTPStatus.BAD_REQUEST, words
        origin, site = headers.get("origin"), headers.get("sec-fetch-site", "none")
        is_own = origin is None or origin.partition("://")[2] == host
        is_own = is_own and site in ("none", "same-origin")
        if scope["method"] not in SAFE_METHODS and not is_own:
            words = f"a page of {origin!r} may not send this request"
            return HTTPStatus.FORBIDDEN, words
        if int(headers.get("content-length", "0")) > most:
            return HTTPStatus.REQUEST_ENTITY_TOO_LARGE, _too_long(most)
        return None


def name_of(host: str) -> str:
    """Name in a Host header, in small letters and without its port."""
    name, colon, port = host.rpartition(":")
    return (name if colon and port.isdigit() else host).lower()


def _too_long(most: int) -> str:
    return f"the request body is longer than {most / 1e6:g} MB"


def _bounded(receive: Receive, most: int) -> Receive:
    """Messages of a body, in time and within its size. Raises HTTPException 408, 413."""
    size, ended = 0, False

    async def bounded() -> Message:
        nonlocal size, ended
        try:
            async with asyncio.timeout(None if ended else BODY_IDLE_S):
                message = await receive()
        except TimeoutError:
            words = "the request body did not arrive in time"
            raise HTTPException(HTTPStatus.REQUEST_TIMEOUT, words) from None
        size += len(message.get("body", b""))
        ended = not message.get("more_body", False)
        if size > most:
            raise HTTPException(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, _too_long(most))
        return message

    return bounded


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
