"""One connection: uvicorn's protocol with bounds of number and time, which uvicorn has not.

Its `limit_concurrency` answers 503 without words and only once a request is read; its
`timeout_keep_alive` ends with the first byte of a request; nothing bounds the head or a reader.
"""

import asyncio
from collections.abc import Callable
from functools import partial
from http import HTTPStatus
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from ..problems import problem_response
from .connections import Connections
from .settings import HttpLimits

_REFUSED = {
    HTTPStatus.SERVICE_UNAVAILABLE: "all connections are in use; try again",
    HTTPStatus.TOO_MANY_REQUESTS: "this address has too many connections",
}
_RETRY = {"connection": "close", "retry-after": "1"}


class BoundedProtocol(H11Protocol):
    """A connection with a place among all, and a deadline for whatever its client has to do."""

    def __init__(self, limits: HttpLimits, places: Connections, **wiring: Any) -> None:
        super().__init__(**wiring)
        self.address = ""
        self._limits, self._places = limits, places
        self._due: asyncio.TimerHandle | None = None
        self._stalled: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a place, or say that there is none."""
        super().connection_made(transport)
        self.address = self.client[0] if self.client else ""
        refused = self._places.admit(self)
        if refused is None:
            self._expect(self._limits.head_s, self._head_is_late)
        else:
            self._refuse(refused, _REFUSED[refused])

    def connection_lost(self, exc: Exception | None) -> None:
        """Free the place."""
        self._places.leave(self)
        self._expect(None)
        self.resume_writing()
        super().connection_lost(exc)

    def give_way(self) -> None:
        """Close: another one needs the place."""
        self._expect(None)
        self.transport.abort()

    def data_received(self, data: bytes) -> None:
        """Begin to count the time with the first byte of a request."""
        if self.transport.is_closing():
            return
        if self._due is None and (self.cycle is None or self.cycle.response_complete):
            self._expect(self._limits.head_s, self._head_is_late)
        super().data_received(data)

    def handle_events(self) -> None:
        """Note a request that has begun."""
        before = self.cycle
        super().handle_events()
        if self.cycle is not before and not self.cycle.response_complete:
            self._expect(None)
            self._places.busy(self)

    def on_response_complete(self) -> None:
        """Wait for the next request, or shortly for the rest of a body that nobody reads."""
        self._places.idle(self)
        if self.conn.their_state is h11.SEND_BODY:
            self._expect(self._limits.linger_s, self.give_way)
        super().on_response_complete()

    def send_400_response(self, msg: str) -> None:
        """Answer what is no HTTP with a problem, as every other error."""
        self._refuse(HTTPStatus.BAD_REQUEST, f"this is not an HTTP request: {msg}")

    def pause_writing(self) -> None:
        """Give a client that does not read some time."""
        super().pause_writing()
        self._stalled = self.loop.call_later(self._limits.stall_s, self.give_way)

    def resume_writing(self) -> None:
        """Note that the client reads."""
        super().resume_writing()
        if self._stalled is not None:
            self._stalled.cancel()
            self._stalled = None

    def _expect(self, within_s: float | None, late: Callable[[], None] = lambda: None) -> None:
        """Set the one deadline of the client; None: it has nothing to do."""
        if self._due is not None:
            self._due.cancel()
        self._due = None if within_s is None else self.loop.call_later(within_s, late)

    def _head_is_late(self) -> None:
        self._due = None
        if self.conn.trailing_data[0]:
            self._refuse(HTTPStatus.REQUEST_TIMEOUT, "the request did not arrive in time")
        else:
            self.transport.close()

    def _refuse(self, status: HTTPStatus, words: str) -> None:
        """Say why, if it can still be said, and close."""
        answer = problem_response("/", status, words, headers=_RETRY)
        head = h11.Response(status_code=status, headers=answer.raw_headers, reason=status.phrase)
        try:
            for event in (head, h11.Data(data=bytes(answer.body)), h11.EndOfMessage()):
                self.transport.write(self.conn.send(event) or b"")
        except h11.LocalProtocolError:
            self.transport.abort()
        self.transport.close()


def bounded_protocol(limits: HttpLimits, places: Connections) -> Any:
    """Maker of the protocol of each new connection, for `uvicorn.Config(http=...)`."""
    return partial(BoundedProtocol, limits, places)
