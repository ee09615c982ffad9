"""Questions on the bus: who asks gets one answer, or learns at once that nobody is there."""

import asyncio
from collections.abc import Callable
from functools import partial

import zenoh

from ..messages.codec import JSON_ENCODING

MOST_OPEN = 64
"""Questions that are answered at a time; further ones get no answer."""
MOST_BYTES = 16_384
"""Length of a question; a longer one gets no answer."""

Answer = Callable[[str, bytes, Callable[[bytes | None], None]], None]
"""(key, question, reply): replies now or later; None says that there is no answer.

A question is the payload, or without one the parameters of the selector.
"""


class Answering:
    """Answers the questions that are put on a key expression, in JSON."""

    def __init__(self, session: zenoh.Session, key_expr: str, answer: Answer) -> None:
        self._answer, self._key_expr = answer, key_expr
        self._loop = asyncio.get_running_loop()
        self._open: set[zenoh.Query] = set()
        self._closed = False
        self._queryable = session.declare_queryable(
            key_expr, zenoh.handlers.Callback(self._on_query, indirect=False), complete=True
        )

    def _on_query(self, query: zenoh.Query) -> None:
        """Runs in a thread of Zenoh; a flood of questions ends here, and not in the loop."""
        payload = query.payload
        asked = str(query.parameters).encode() if payload is None else payload.to_bytes()
        is_fit = len(asked) <= MOST_BYTES and len(self._open) < MOST_OPEN
        if not is_fit or self._loop.is_closed():
            query.drop()
            return
        self._open.add(query)
        self._loop.call_soon_threadsafe(self._begin, query, asked)

    def _begin(self, query: zenoh.Query, question: bytes) -> None:
        if self._closed:
            self._reply(query, None)
        elif query in self._open:
            self._answer(str(query.key_expr), question, partial(self._reply, query))

    def _reply(self, query: zenoh.Query, answer: bytes | None) -> None:
        if query in self._open:
            self._open.discard(query)
            if answer is not None:
                asked = query.key_expr
                key = self._key_expr if "*" in str(asked) else asked  # many are asked at once
                query.reply(key, answer, encoding=zenoh.Encoding(JSON_ENCODING))
            query.drop()

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._queryable.undeclare()
            for query in tuple(self._open):
                self._reply(query, None)
