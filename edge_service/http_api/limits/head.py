"""HEAD on every path that takes GET: the same answer without its body."""

import asyncio
from contextlib import suppress

from starlette.types import ASGIApp, Message, Receive, Scope, Send

_EMPTY: Message = {"type": "http.response.body", "body": b""}


class Head:
    """Answers HEAD as GET would be answered, and ends it once the headers are known."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request; a stream without end is not waited for."""
        if scope["type"] != "http" or scope["method"] != "HEAD":
            await self._app(scope, receive, send)
            return
        known = asyncio.Event()

        async def send_headers(message: Message) -> None:
            if message["type"] == "http.response.start" and not known.is_set():
                await send(message)
                await send(_EMPTY)
                known.set()

        answer = asyncio.ensure_future(self._app({**scope, "method": "GET"}, receive, send_headers))
        waiting = asyncio.ensure_future(known.wait())
        try:
            await asyncio.wait((answer, waiting), return_when=asyncio.FIRST_COMPLETED)
        finally:
            waiting.cancel()
            await _ended(answer, known.is_set())


async def _ended(answer: "asyncio.Future[None]", is_answered: bool) -> None:
    """End what goes on behind an answer that is complete; its failure is no answer's."""
    if not is_answered:
        await answer
        return
    answer.cancel()
    with suppress(asyncio.CancelledError, Exception):
        await answer
