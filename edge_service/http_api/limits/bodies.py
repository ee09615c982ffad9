"""Bodies of requests: bounded in size and time before any route reads them."""

import asyncio
import re
from http import HTTPStatus

from fastapi import HTTPException
from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ..problems import problem_response
from .settings import MB, HttpLimits

TRACE_TYPES = {"text/csv": "csv", "application/vnd.apache.parquet": "parquet"}
"""Content types of a recording, and the suffix of its name."""
_RECORDING = re.compile(r"/api/v1/recordings/[^/]+")
_DIAGNOSE = re.compile(r"/api/v1/axes/[^/]+/diagnose")


class BodyLimits:
    """Refuses bodies that are too long (413) or come too slowly (408), on every route.

    A recording is streamed to its route. Any other body is read here, whole, and then handed on:
    no route can hold more of it, and none waits for it.
    """

    def __init__(self, app: ASGIApp, limits: HttpLimits) -> None:
        self._app, self._limits = app, limits

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request, or refuse it."""
        if scope["type"] != "http" or not _has_body(scope):
            await self._app(scope, receive, send)
            return
        streamed = is_recording(scope)
        most = self._limits.upload_bytes if streamed else self._limits.json_bytes
        body = _Body(receive, self._limits, most)
        try:
            body.check_declared(scope)
            handed_on = body.receive if streamed else await body.whole()
        except ClientDisconnect:
            return
        except HTTPException as refused:
            answer = problem_response(scope["path"], refused.status_code, refused.detail)
            await answer(scope, receive, send)
        else:
            await self._app(scope, handed_on, send)


def is_recording(scope: Scope) -> bool:
    """Tell whether the body of a request is a recording, which its route streams."""
    method, path = scope["method"], scope["path"]
    if method == "PUT":
        return _RECORDING.fullmatch(path) is not None
    if method != "POST" or _DIAGNOSE.fullmatch(path) is None:
        return False
    return content_type(scope) in TRACE_TYPES


def content_type(scope: Scope) -> str:
    """Content type of a request's body, without parameters; empty if it does not say."""
    return Headers(scope=scope).get("content-type", "").partition(";")[0].strip().lower()


class _Body:
    """One body as it comes. Raises HTTPException 413 and 408."""

    def __init__(self, receive: Receive, limits: HttpLimits, most_bytes: int) -> None:
        self._receive, self._limits, self._most = receive, limits, most_bytes
        self._size, self._waited_s, self._ended = 0, 0.0, False

    def check_declared(self, scope: Scope) -> None:
        """Refuse a body that says itself that it is too long."""
        declared = Headers(scope=scope).get("content-length", "0")
        if int(declared) > self._most:
            raise self._too_long()

    async def receive(self) -> Message:
        """The next message of the request, in time, and within its size."""
        if self._ended:
            return await self._receive()
        message = await self._in_time()
        self._size += len(message.get("body", b""))
        self._ended = not message.get("more_body", False)
        if self._size > self._most:
            raise self._too_long()
        return message

    async def whole(self) -> Receive:
        """Read all of it; what hands it on as one message. Raises ClientDisconnect."""
        parts = []
        while not self._ended:
            message = await self.receive()
            if message["type"] != "http.request":
                raise ClientDisconnect
            parts.append(message.get("body", b""))
        messages: list[Message] = [{"type": "http.request", "body": b"".join(parts)}]

        async def handed_on() -> Message:
            return messages.pop() if messages else await self._receive()

        return handed_on

    async def _in_time(self) -> Message:
        limits, clock = self._limits, asyncio.get_running_loop().time
        granted_s = limits.body_s + self._size / limits.body_bytes_per_s - self._waited_s
        began_s = clock()
        try:
            async with asyncio.timeout(min(limits.body_idle_s, granted_s)):
                message = await self._receive()
        except TimeoutError:
            words = "the request body did not arrive in time"
            raise HTTPException(HTTPStatus.REQUEST_TIMEOUT, words) from None
        self._waited_s += clock() - began_s
        return message

    def _too_long(self) -> HTTPException:
        words = f"the request body is longer than {self._most / MB:g} MB"
        return HTTPException(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, words)


def _has_body(scope: Scope) -> bool:
    headers = Headers(scope=scope)
    return "transfer-encoding" in headers or headers.get("content-length", "0").strip("0") != ""
