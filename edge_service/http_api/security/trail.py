"""Trail of what is changed through the interface: its intent before, its outcome after."""

import asyncio
import logging
import secrets
from http import HTTPStatus

from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ...health.events.audit import BEGUN, AuditEntry
from ...health.service_state import ServiceState
from ...threads import Threads
from ..context import Clock
from .gate import name_in
from .intent import BEGIN, SAFE_METHODS

log = logging.getLogger(__name__)
_NO_CHANGE = (400, 404, 405, 408, 411, 413, 415, 422, 431)
"""Statuses of requests that are none; whoever sends them is refused whatever their rights."""
_WRITE_S = 5.0
_THREAD = Threads("audit log")
_REFUSED_PER_MIN = 60
"""Refusals that are noted each; the next one after that minute says how many more there were."""
_ELSEWHERE = "edge_service.audited"


def audited_elsewhere(request: HTTPConnection) -> None:
    """Say that whoever did what was asked has noted it."""
    request.scope[_ELSEWHERE] = True


def signed_in(request: HTTPConnection, name: str | None) -> None:
    """Say whose sign-in succeeded."""
    request.scope["edge_service.signed_in"] = name


class Trail:
    """Notes who changes what, when and from where: before it is done, and what came of it.

    What the disk does not take now waits in memory, and stops no change: a full disk can be helped
    through the interface.
    """

    def __init__(self, app: ASGIApp, state: ServiceState, clock: Clock) -> None:
        self._app = app
        self._diary, self._clock = state.events, clock
        self._minute = self._refused = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request, and note what came of it before that is answered."""
        if scope["type"] != "http" or scope["method"] in SAFE_METHODS:
            await self._app(scope, receive, send)
            return
        request = ""

        async def begin() -> None:
            nonlocal request
            request = secrets.token_hex(6)
            await self._write(scope, BEGUN, {"request": request})

        async def send_noted(message: Message) -> None:
            nonlocal request
            if message["type"] == "http.response.start":
                await self._note(scope, message["status"], request)
                request = ""
            await send(message)

        BEGIN.set(begin)
        try:
            await self._app(scope, receive, send_noted)
        except Exception:
            if request:
                await self._note(scope, 500, request)
            raise

    async def _note(self, scope: Scope, status: int, request: str) -> None:
        if not request and (status in _NO_CHANGE or scope.get(_ELSEWHERE)):
            return
        more = self._more_refused(self._clock()) if status in (401, 403, 429) else 0
        if more is None:
            return
        data: dict[str, str | float | int | None] = {"request": request} if request else {}
        outcome = f"{status} {HTTPStatus(status).phrase}"
        await self._write(scope, outcome, data | ({"more_refused": more} if more else {}))

    async def _write(
        self, scope: Scope, outcome: str, data: dict[str, str | float | int | None]
    ) -> None:
        now_ns = self._clock()
        entry = AuditEntry(
            time_ns=now_ns,
            who=scope.get("edge_service.signed_in") or name_in(scope) or "",
            origin=(scope.get("client") or ("",))[0],
            action=f"{scope['method']} {scope['path']}"[:500],
            outcome=outcome,
            data=data,
        )
        try:
            async with asyncio.timeout(_WRITE_S):
                await asyncio.shield(_THREAD.run(self._diary.add, (), now_ns, (entry,)))
        except TimeoutError:
            log.warning("the audit log waits for the disk")

    def _more_refused(self, now_ns: int) -> int | None:
        """Number of refusals not noted before this one; None if this one is not noted."""
        minute = now_ns // 60_000_000_000
        if minute == self._minute:
            self._refused += 1
            return 0 if self._refused <= _REFUSED_PER_MIN else None
        more = max(self._refused - _REFUSED_PER_MIN, 0)
        self._minute, self._refused = minute, 1
        return more
